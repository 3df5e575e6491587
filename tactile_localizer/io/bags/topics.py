"""Topics of a bag."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class BagTopics:
    """Topics of a bag.

    Parameters
    ----------
    strain : ``StrainVectors``
    pose : ``PoseStamped``, measured palm pose
    truth : ``PoseStamped``, true palm pose; optional
    status : ``ScanStatus`` of the mapping node, which delimits sweeps; optional
    posterior : ``Posterior`` of the filter node, which shows global localizations; optional
    """

    strain: str = "/strain"
    pose: str = "/palm_pose"
    truth: str = "/simulator/ground_truth"
    status: str = "/mapping/status"
    posterior: str = "/filter/posterior"
