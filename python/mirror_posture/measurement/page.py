"""A measurement as one HTML page."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .._core import __version__
from ..output_files import write_file
from ..pages import Drawing, finished, inline, render, styled
from ..session import Session
from .differences import MILLIMETRES, draw_differences
from .table import summarise
from .types import Measurement
from .used import used

TEMPLATE = "measure.html.j2"
MOST_ROWS = 2000
MOST_PANELS = 12


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
    return finished(draw_differences(measurement, MOST_PANELS), "measured")
