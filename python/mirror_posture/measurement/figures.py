"""Plots of a measurement: measured against model for each marker, and both drawn into the session's
pictures."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from ..arrays import Floats
from ..detect import read_picture
from ..mirror import IDEAL_MIRROR
from ..optics import see_in_mirror
from ..output_files import new_file
from ..pages.drawing import styled
from ..picture_files import write_picture
from ..picture_marks import MEASURED_BGR, WANTED_BGR, Pixels, draw_label, draw_mark
from ..session import Session
from .differences import MILLIMETRES, draw_differences
from .types import Measurement


@styled
def plot_measured_against_model(measurement: Measurement, file: Path) -> None:
    """One panel a marker: measured minus model along x, y, z of the root frame in each posture, mm, with 1 σ bars."""
    figure = draw_differences(measurement)
    figure.suptitle(
        f"Markers measured in the mirror ({measurement.estimator}); root frame; bars: one standard deviation"
    )
    with new_file(file) as part:
        figure.savefig(part, dpi=110)


def draw_measured_and_model(session: Session, measurement: Measurement, row: int) -> Pixels | None:
    """A frame's picture with each marker where it was measured (green ring) and where the model predicts it
    (red cross).

    Both are drawn where they would be seen in the mirror of this frame. None for a frame without picture or
    mirror.
    """
    file, camera = session.image_files[row], session.camera
    if file is None or camera is None or not measurement.mirrors.measured[row]:
        return None
    picture = read_picture(file)
    scale = 2 if picture.shape[1] < 1000 else 1
    canvas = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
    markers = measurement.markers
    mine = np.flatnonzero(markers.posture == session.frames.posture[row])
    foot = measurement.mirrors.foot_m[row]
    glass = (session.mirror or IDEAL_MIRROR).glass
    for points, color, shape in (
        (markers.point_in_camera_m, MEASURED_BGR, "ring"),
        (markers.model_in_camera_m, WANTED_BGR, "cross"),
    ):
        if not len(mine):
            continue
        seen = see_in_mirror(camera, foot, points[mine], **glass)
        pixels = np.where(seen.valid[:, None], seen.pixels_px, -np.inf)
        # From left to right, the names alternately above and below, so that neighbours do not cover each other.
        for order, i in enumerate(np.argsort(pixels[:, 0])):
            k, pixel = mine[i], pixels[i]
            inside = (pixel >= 0).all() and pixel[0] < picture.shape[1] and pixel[1] < picture.shape[0]
            if not inside or (shape == "ring" and not markers.measured[k]):
                continue
            at = (pixel + 0.5) * scale - 0.5
            draw_mark(canvas, shape, at, color, scale)
            if shape == "ring":
                text = f"{measurement.marker_names[markers.marker[k]]} {markers.distance_m[k] * MILLIMETRES:.1f} mm"
                _label(canvas, text, at + np.array([0.0, 34.0 if order % 2 else -22.0]) * scale, scale)
    legend = f"frame {session.frames.frame[row]}: green ring measured, red cross model, distance between them"
    _label(canvas, legend, np.array([0.0, canvas.shape[0] - 10.0]), scale)
    return canvas


def write_measured_and_model(session: Session, measurement: Measurement, row: int, file: Path) -> bool:
    """Writes `draw_measured_and_model` as a picture; False where there is nothing to draw."""
    canvas = draw_measured_and_model(session, measurement, row)
    if canvas is None:
        return False
    write_picture(file, canvas)
    return True


def _label(canvas: Pixels, text: str, at: Floats, scale: int) -> None:
    """Text on a dark plate, centred on a place and kept inside of the picture."""
    size = 0.4 * scale
    (width, height), base = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, size, 1)
    x = int(np.clip(at[0] - width / 2, 4, max(4, canvas.shape[1] - width - 6)))
    y = int(np.clip(at[1], height + 4, canvas.shape[0] - base - 2))
    draw_label(canvas, text, (x, y), size)
