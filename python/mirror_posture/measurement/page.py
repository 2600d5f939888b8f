"""A measurement as one HTML page."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .._core import __version__
from ..output_files import write_file
from ..pages import Drawing, figure, finished, inline, render, styled
from ..pages.drawing import AFTER, BAR_ALPHA, BEFORE, GOOD, INK, MANY_POINTS
from ..session import Session
from .table import summarise
from .types import Measurement
from .used import used

TEMPLATE = "measure.html.j2"
MILLIMETRES = 1000.0
MOST_ROWS = 2000
MOST_PANELS = 12
COLUMNS = 3
AXES = (("x", BEFORE), ("y", GOOD), ("z", AFTER))


@dataclass(frozen=True)
class Row:
    """A marker of a posture, as the page shows it; values are empty where it is not measured."""

    posture: int
    marker: str
    views: int
    values: tuple[str, ...]


def write_measure_page(session: Session, measurement: Measurement, file: str | os.PathLike[str]) -> Path:
    """Writes the page; returns its path. Raises `MirrorPostureError` where it cannot be written."""
    markers, names = measurement.markers, measurement.marker_names
    good = markers.measured
    point, std, distance = markers.point_in_root_m, markers.std_m, markers.distance_m
    rows = []
    for k in range(len(markers)):
        numbers = (*point[k], std[k], distance[k]) if good[k] else ()
        cells = tuple(f"{MILLIMETRES * v:.2f}" for v in numbers) or ("",) * 5
        rows.append(Row(int(markers.posture[k]), names[markers.marker[k]], int(markers.views[k]), cells))
    reasons: dict[str, int] = {}
    for k, reason in enumerate(markers.reason):
        if reason is not None:
            text = f"{names[markers.marker[k]]}: {reason}"
            reasons[text] = reasons.get(text, 0) + 1
    for reason in measurement.mirrors.reason:
        if reason is not None:
            reasons[f"a mirror: {reason}"] = reasons.get(f"a mirror: {reason}", 0) + 1
    rms = _mm(float(np.sqrt((distance[good] ** 2).mean()))) if good.any() else ""
    typical = _mm(float(np.median(std[good]))) if good.any() else ""
    values = {
        "version": __version__,
        "session": session.folder.resolve().name,
        "estimator": measurement.estimator,
        "corner_noise_px": measurement.corner_noise_px,
        "marker_noise_px": measurement.marker_noise_px,
        "measured": int(good.sum()),
        "rms": rms,
        "typical": typical,
        "rows": rows,
        "most": MOST_ROWS,
        "warnings": measurement.warnings,
        "used": used(session, measurement).sentence,
        "summary": [s for s in summarise(measurement) if s.postures],
        "mm": _mm,
        "reasons": [f"{text} ({count} times)" if count > 1 else text for text, count in reasons.items()],
        "picture": inline(
            _draw(measurement),
            f"Measured less model of each marker, posture by posture: {rms} mm RMS, measured to {typical} mm.",
        )
        if good.any()
        else None,
    }
    return write_file(file, render("mirror_posture.pages", TEMPLATE, values))


def _mm(value: float | None) -> str:
    return "" if value is None else f"{MILLIMETRES * value:.2f}"


@styled
def _draw(measurement: Measurement) -> Drawing:
    markers = measurement.markers
    difference = MILLIMETRES * (markers.point_in_root_m - markers.model_in_root_m)
    std = MILLIMETRES * np.sqrt(np.diagonal(markers.covariance_in_root_m2, axis1=1, axis2=2))
    shown = [
        i for i in range(len(measurement.marker_names)) if (markers.measured & (markers.marker == i)).any()
    ][:MOST_PANELS]
    height = -(-len(shown) // COLUMNS)
    drawn, axes = figure(11.0, 2.4 * height + 0.4, height, COLUMNS, sharey=True)
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
        ax.set_title(measurement.marker_names[shown[panel]], fontsize=10, loc="left", color=INK)
        # A single posture would be drawn on a scale of hundredths.
        ax.set_xlim(markers.posture[mine].min() - 0.5, markers.posture[mine].max() + 0.5)
        ax.xaxis.get_major_locator().set_params(integer=True)
        if panel % COLUMNS == 0:
            ax.set_ylabel("measured − model, mm")
        if panel + COLUMNS >= len(shown):
            ax.set_xlabel("posture")
    drawn.legend(
        *axes.flat[0].get_legend_handles_labels(),
        fontsize=9,
        frameon=False,
        loc="outside upper right",
        ncols=3,
    )
    return finished(drawn, "measured")
