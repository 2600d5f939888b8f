"""The plot of measured minus model: a panel a marker, for the page and for a file of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..pages import figure
from ..pages.drawing import AFTER, BAR_ALPHA, BEFORE, GOOD, INK, MANY_POINTS
from .types import Measurement

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MILLIMETRES = 1000.0
COLUMNS = 3
AXES = (("x", BEFORE), ("y", GOOD), ("z", AFTER))


def draw_differences(measurement: Measurement, most: int | None = None) -> Figure:
    """Along x, y, z of the root frame in each posture, mm, with bars of one standard deviation; `most` panels. To be called by a function that is `styled`."""
    markers, names = measurement.markers, measurement.marker_names
    difference = MILLIMETRES * (markers.point_in_root_m - markers.model_in_root_m)
    std = MILLIMETRES * np.sqrt(np.diagonal(markers.covariance_in_root_m2, axis1=1, axis2=2))
    shown = [i for i in range(len(names)) if (markers.measured & (markers.marker == i)).any()][:most]
    columns = 2 if len(shown) == 4 else min(COLUMNS, max(1, len(shown)))
    rows = max(1, -(-len(shown) // columns))
    drawn, axes = figure(11.0, 2.4 * rows + 0.6, rows, columns, sharey=True)
    for panel, ax in enumerate(axes.flat):
        if panel >= len(shown):
            ax.set_visible(False)
            continue
        mine = markers.measured & (markers.marker == shown[panel])
        many = int(mine.sum()) > MANY_POINTS
        for axis, (name, colour) in enumerate(AXES):
            ax.errorbar(
                markers.posture[mine] + 0.12 * (axis - 1),
                difference[mine, axis],
                std[mine, axis],
                fmt="o",
                color=colour,
                ecolor=(colour, BAR_ALPHA),
                markersize=1.2 if many else 3.5,
                linewidth=1.0,
                rasterized=many,
                label=name,
            )
        ax.axhline(0.0, color=INK, linewidth=0.6)
        rms_mm = MILLIMETRES * float(np.sqrt((markers.distance_m[mine] ** 2).mean()))
        ax.set_title(f"{names[shown[panel]]}: {rms_mm:.2f} mm RMS", fontsize=10, loc="left", color=INK)
        # A single posture would be drawn on a scale of hundredths.
        ax.set_xlim(markers.posture[mine].min() - 0.5, markers.posture[mine].max() + 0.5)
        ax.xaxis.get_major_locator().set_params(integer=True)
        if panel % columns == 0:
            ax.set_ylabel("measured − model, mm")
        if panel + columns >= len(shown):
            ax.set_xlabel("posture")
    if shown:
        drawn.legend(
            *axes.flat[0].get_legend_handles_labels(),
            fontsize=9,
            frameon=False,
            loc="outside lower right",
            ncols=3,
        )
    return drawn
