"""Plots of a correction: the errors look by look, and the robot before and after."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ..arrays import Floats
from ..detect import read_picture
from ..figure_settings import literal
from ..measurement import (
    Measurement,
    MeasureOptions,
    NothingMeasuredError,
    measure,
    nominal_camera_from_board,
)
from ..mirror import IDEAL_MIRROR
from ..optics import see_in_mirror
from ..output_files import new_file
from ..picture_files import write_picture
from ..picture_marks import MEASURED_BGR, WANTED_BGR, Pixels, draw_label, draw_mark
from ..session import Session, load_session
from .outcome import LookReport, Outcome

MILLIMETRES = 1000.0
CROP_PX = 39
"""Half the width of the closer look at a marker."""
ZOOM = 5
GAP_PX = 6
LONGEST_NAMES = 40
"""Letters of the names of markers that were not seen: more do not fit beside the axis, and are counted."""
LEAST_SHOWN_M = 5e-5
"""The lower end of the logarithmic axis: below it measurements are noise."""


@literal
def plot_convergence(outcome: Outcome, file: Path, tolerance_m: float) -> None:
    """Each marker's distance from its target by look, mm, with the bound below which it surely is, and the tolerance."""
    import matplotlib
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, NullFormatter

    figure = Figure(figsize=(8.0, 4.6), layout="constrained")
    axis = figure.subplots()
    colors = matplotlib.colormaps["tab10"]
    count = len(outcome.looks)
    unseen: dict[int, list[tuple[str, Any]]] = {}
    for index, name in enumerate(outcome.markers):
        rows = [(look, m) for look in outcome.looks for m in look.markers if m.marker == name]
        seen = [
            (k.look, m.distance_m, m.below_m) for k, m in rows if m.distance_m is not None and m.doubt is None
        ]
        color = colors(index % 10)
        if seen:
            look, distance, below = (np.array(column, dtype=float) for column in zip(*seen, strict=True))
            distance = np.maximum(distance, LEAST_SHOWN_M)
            axis.plot(look, distance * MILLIMETRES, "o-", color=color, label=name, markersize=5)
            axis.fill_between(
                look, distance * MILLIMETRES, below * MILLIMETRES, color=color, alpha=0.15, linewidth=0
            )
        doubted = [
            (k.look, m.distance_m) for k, m in rows if m.distance_m is not None and m.doubt is not None
        ]
        if doubted:
            look, distance = (np.array(column, dtype=float) for column in zip(*doubted, strict=True))
            axis.plot(
                look, distance * MILLIMETRES, "x", color=color, markersize=9, label=f"{name}, not believed"
            )
        for missed in [k.look for k, m in rows if m.distance_m is None]:
            axis.axvline(missed, color=color, linewidth=6.0, alpha=0.12)
            unseen.setdefault(missed, []).append((name, color))
    for missed, those in unseen.items():
        # One text a look: those of several markers would lie on top of each other.
        names = ", ".join(name for name, _ in those)
        axis.annotate(
            f"{names if len(names) <= LONGEST_NAMES else f'{len(those)} markers'} not seen", (missed, 1.0),
            xycoords=("data", "axes fraction"), rotation=90, ha="right", va="top", fontsize=8,
            color=those[0][1] if len(those) == 1 else "0.35",
        )  # fmt: skip
    axis.axhline(tolerance_m * MILLIMETRES, color="0.35", linestyle="--", linewidth=1.0)
    axis.annotate(
        f"tolerance {tolerance_m * MILLIMETRES:g} mm", (1.0, tolerance_m * MILLIMETRES),
        xycoords=("axes fraction", "data"), xytext=(-4, 4), textcoords="offset points", ha="right", fontsize=8,
        color="0.35",
    )  # fmt: skip
    axis.set_yscale("log")
    # Plain numbers at 1, 2 and 5 of each decade: a few millimetres read badly as powers of ten.
    axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.yaxis.set_major_formatter("{x:g}")
    axis.yaxis.set_minor_formatter(NullFormatter())
    axis.set_xlim(0.6, max(count, 2) + 0.4)
    axis.set_xticks(range(1, max(count, 2) + 1, max(1, count // 15)))
    axis.set_xlabel("look")
    axis.set_ylabel("distance from the target, mm")
    axis.grid(alpha=0.25, which="both")
    if axis.get_legend_handles_labels()[0]:
        axis.legend(loc="upper right", fontsize=9)
    axis.set_title(textwrap.fill(outcome.stop.sentence, 105), fontsize=9, loc="left")
    with new_file(file) as part:
        figure.savefig(part, dpi=120)


def write_before_and_after(folder: Path, outcome: Outcome, file: Path) -> bool:
    """The first and the last accepted look side by side, from similar viewpoints, with each marker's
    surroundings enlarged.

    Green ring: where the marker was measured; red cross: its target; both as seen in the mirror of that
    picture. False for a recording without pictures, or without a measured look.
    """
    session = load_session(folder)
    believed = [look for look in outcome.looks if look.rms_m is not None]
    if not believed or not any(session.image_files):
        return False
    first, last = believed[0], believed[-1]
    try:
        measurement = measure(session, MeasureOptions())
    except NothingMeasuredError:
        return False
    rows = _like_rows(session, measurement, first.posture, last.posture)
    if rows is None:
        return False
    panels = []
    for title, look, row in (("before", first, rows[0]), ("after", last, rows[1])):
        panels.append(_panel(session, measurement, outcome, look, row, title))
    height = max(panel.shape[0] for panel in panels)
    padded = [
        cv2.copyMakeBorder(p, 0, height - p.shape[0], 0, 12, cv2.BORDER_CONSTANT, value=(255, 255, 255))
        for p in panels
    ]
    write_picture(file, np.hstack(padded))
    return True


def _like_rows(session: Session, measurement: Measurement, first: int, last: int) -> tuple[int, int] | None:
    """A frame of each posture with picture and mirror, such that the two mirrors are as similar as
    possible."""

    def usable(posture: int) -> list[int]:
        mine = np.flatnonzero(session.frames.posture == posture).tolist()
        return [r for r in mine if session.image_files[r] is not None and measurement.mirrors.measured[r]]

    normal = measurement.mirrors.normal
    pairs = [(a, b) for a in usable(first) for b in usable(last)]
    return max(pairs, key=lambda pair: float(normal[pair[0]] @ normal[pair[1]]), default=None)


def _panel(
    session: Session, measurement: Measurement, outcome: Outcome, look: LookReport, row: int, title: str
) -> Pixels:
    """One picture with rings and crosses, and below it each marker enlarged."""
    file, camera = session.image_files[row], session.camera
    assert file is not None and camera is not None
    picture = read_picture(file)
    canvas = picture.copy()
    names = list(outcome.markers)
    camera_from_board = measurement.camera_from_nominal_camera @ nominal_camera_from_board(session)[row]
    target = np.array([outcome.target_in_board_m[name] for name in names])
    error = np.array([_error(look, name) for name in names])
    glass = (session.mirror or IDEAL_MIRROR).glass

    def pixels(points_in_board: Floats) -> Floats:
        in_camera = points_in_board @ camera_from_board[:3, :3].T + camera_from_board[:3, 3]
        seen = see_in_mirror(camera, measurement.mirrors.foot_m[row], in_camera, **glass)
        return np.where(seen.valid[:, None], seen.pixels_px, np.nan)

    wanted, measured = pixels(target), pixels(target - np.nan_to_num(error))
    crops = []
    for index, name in enumerate(names):
        distance = next((m.distance_m for m in look.markers if m.marker == name), None)
        text = f"{name}: " + ("not measured" if distance is None else f"{distance * MILLIMETRES:.2f} mm")
        crops.append(_crop(picture, wanted[index], None if distance is None else measured[index], text))
        for pixel, color, shape in (
            (measured[index], MEASURED_BGR, "ring"),
            (wanted[index], WANTED_BGR, "cross"),
        ):
            if np.isfinite(pixel).all() and not (shape == "ring" and distance is None):
                draw_mark(canvas, shape, pixel, color, 1)
    draw_label(canvas, f"{title}: look {look.look}, {look.steps} steps", (10, 24), 0.6)
    draw_label(canvas, "green ring: measured, red cross: target", (10, canvas.shape[0] - 12), 0.45)
    side = crops[0].shape[0]
    across = max(1, (canvas.shape[1] + GAP_PX) // (side + GAP_PX))
    lines = []
    for start in range(0, len(crops), across):
        line = np.full((side + GAP_PX, canvas.shape[1], 3), 255, dtype=np.uint8)
        for place, crop in enumerate(crops[start : start + across]):
            left = place * (side + GAP_PX)
            line[GAP_PX:, left : left + side] = crop
        lines.append(line)
    return np.vstack([canvas, *lines])


def _error(look: LookReport, name: str) -> Sequence[float]:
    found = next((m.error_m for m in look.markers if m.marker == name), None)
    return (np.nan,) * 3 if found is None else found


def _crop(
    picture: Pixels,
    wanted: Floats,
    measured: Floats | None,
    text: str,
) -> Pixels:
    """The surroundings of a target, enlarged."""
    side = 2 * CROP_PX + 1
    middle = wanted if np.isfinite(wanted).all() else np.array(picture.shape[1::-1]) / 2.0
    corner = np.round(middle).astype(int) - CROP_PX
    shift = np.array([[1.0, 0.0, -corner[0]], [0.0, 1.0, -corner[1]]])
    small = cv2.warpAffine(picture, shift, (side, side), borderValue=(60, 60, 60))
    canvas = cv2.resize(small, None, fx=ZOOM, fy=ZOOM, interpolation=cv2.INTER_CUBIC)

    def enlarged(pixel: Floats) -> Floats:
        # Pixel centres: (0, 0) is the middle of the top-left pixel, in both pictures.
        result: Floats = (pixel - corner + 0.5) * ZOOM - 0.5
        return result

    if measured is not None and np.isfinite(measured).all():
        if np.isfinite(wanted).all():
            ends = [tuple(int(v) for v in np.round(enlarged(p))) for p in (measured, wanted)]
            cv2.line(canvas, ends[0], ends[1], (255, 255, 255), 2, cv2.LINE_AA)
        draw_mark(canvas, "ring", enlarged(measured), MEASURED_BGR, 2)
    if np.isfinite(wanted).all():
        draw_mark(canvas, "cross", enlarged(wanted), WANTED_BGR, 2)
    draw_label(canvas, text, (8, 24), 0.6)
    return canvas
