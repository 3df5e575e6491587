"""Whether what lies outside a region of the feature proves featureless: held-out sweeps say so."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from tactile_localizer.core.fit import held_out_log_densities
from tactile_localizer.core.likelihood.sum_of_gaussians import SumOfGaussians, training_pairs
from tactile_localizer.core.null_model import NullModel
from tactile_localizer.core.region import Proposal, propose_region
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.spacing import base_widths
from tactile_localizer.scene import Scene

BELIEVED_REGION = 0.5
"""Confidence above which a proposed region of the feature is believed."""


def with_region(scan: Scan, scene: Scene) -> Scene:
    """The scene, with a region proposed from the scan where it gave none and the scan confirms one."""
    if scene.feature is not None:
        return scene
    proposal, confidence = judged_proposal(scan, scene)
    return dataclasses.replace(scene, feature=proposal.region) if confidence > BELIEVED_REGION else scene


def judged_proposal(scan: Scan, scene: Scene) -> tuple[Proposal, float]:
    """A region proposed from the scan, and its :func:`region_confidence`: zero where there is no region."""
    proposal = propose_region(scan, scene)
    if proposal.region is None:
        return proposal, 0.0
    return proposal, region_confidence(scan, dataclasses.replace(scene, feature=proposal.region))


def region_confidence(scan: Scan, scene: Scene) -> float:
    """Share of held-out strains outside the scene's region that prove featureless; NaN where there are none.

    Those are explained no better by knowing the position than by the featureless null. Kernels as wide as
    the sweeps' spacing and disagreement will do for that.
    """
    positions, strain = training_pairs(scan, scene)
    widths = base_widths(scan, scene)
    tried, of_map, _ = held_out_log_densities(
        scan,
        scene,
        np.flatnonzero(~scene.on_feature(positions)),
        lambda rest: SumOfGaussians(rest, scene, *widths),
    )
    if len(tried) == 0:
        return math.nan
    null = NullModel.of_scan(scan, scene, widths[1], blur=widths[1])
    present = np.ones(len(scene.phalanges), dtype=bool)
    return float(np.mean(of_map <= [null.credit(each, present).best for each in strain[tried]]))
