"""Where a camera shows a ball, and how large."""

from __future__ import annotations

import numpy as np

from .._core import MirrorPostureError
from ..camera import Camera
from .types import FloatArray

# A ball's least depth, as a share of its distance: farther off the axis no pinhole camera shows it.
LEAST_DEPTH_SHARE = 0.2


def shown_ball(
    center_m: FloatArray, radius_m: float, camera: Camera
) -> tuple[tuple[float, float], float] | None:
    """Where a camera of any model shows a ball before it (3,), and the root of its half axes' product, px; None where it does not.

    The half axes are those of the disc across the line of sight: off the axis a pinhole camera's grow by cos⁻³ of the angle in area, a fisheye's by angle over sine.
    """
    away = float(np.linalg.norm(center_m))
    if camera.distortion_model != "equidistant" and center_m[2] < LEAST_DEPTH_SHARE * away:
        return None
    across = np.linalg.svd(center_m[None])[2][1:] * radius_m
    try:
        pixels = camera.project(center_m + np.concatenate([np.zeros((1, 3)), across, -across]))
    except MirrorPostureError:
        return None
    (a, b), (c, d) = 0.5 * (pixels[1:3] - pixels[3:5])
    return (float(pixels[0, 0]), float(pixels[0, 1])), float(np.sqrt(abs(a * d - b * c)))
