"""Figure of early against false convergence."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from tactile_localizer.offline.axes import MM
from tactile_localizer.offline.evaluation.convergence_curve import WITHIN_M, CurvePoint


def curve_figure(points: Sequence[CurvePoint], default: float) -> Figure:
    """Figure of early against false convergence, a point per threshold."""
    figure = Figure(figsize=(10.0, 4.2), layout="constrained")
    curve, thresholds = figure.subplots(1, 2)
    false = [100 * point.seam_strains for point in points]
    for column, travel in enumerate(WITHIN_M):
        fractions = [100 * point.within[column] for point in points]
        (line,) = curve.plot(false, fractions, "o-", ms=4, label=f"within {travel * MM:g} mm of contact")
        for point, x, y in zip(points, false, fractions, strict=True):
            place = {"xytext": (4, 4), "textcoords": "offset points", "size": 7}
            curve.annotate(f"{point.probability:g}", (x, y), **place)
            if point.probability == default:
                curve.plot(x, y, "o", ms=11, mfc="none", mec=line.get_color())
    curve.set_xlabel("falsely converged strains on a seam, %")
    curve.set_ylabel("converged sweeps over the feature, %")
    curve.set_ylim(-3.0, 110.0)
    complement = [1.0 - point.probability for point in points]
    for label, name in (
        ("before contact", "before"),
        ("blank sweeps", "blank"),
        ("featureless sweeps", "featureless"),
        ("seam sweeps", "seam_sweeps"),
        ("seam strains", "seam_strains"),
    ):
        thresholds.plot(complement, [100 * getattr(point, name) for point in points], "o-", ms=4, label=label)
    thresholds.axvline(1.0 - default, color="0.5", ls=":", label="configuration")
    thresholds.set_xscale("log")
    thresholds.invert_xaxis()
    thresholds.set_xticks(complement, [f"{point.probability:g}" for point in points], fontsize=8)
    thresholds.minorticks_off()
    thresholds.set_xlabel("convergence_probability")
    thresholds.set_ylabel("false convergence, %")
    for plot in (curve, thresholds):
        plot.grid(color="0.92")
        plot.legend(fontsize=7)
    return figure
