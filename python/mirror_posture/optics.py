"""Forward optics of real mirrors: glass in front of the silver, a slight curvature, and balls instead of
points.

A mirror is given by the foot of the camera's perpendicular, `f = d n` (m): of the glass's front face, or of
the tangent plane of a curved mirror there. Rows without a result are masked: `valid` is False, their
numbers are NaN, `reasons` says why.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from . import _core
from .arguments import checked_arguments
from .arrays import Floats, Mask
from .camera import Camera
from .mirror import FLOAT_GLASS_INDEX
from .short_repr import ShortRepr, from_core


@dataclass(frozen=True, eq=False, repr=False)
class SeenInMirror(ShortRepr):
    """N points seen in mirrors: `pixels_px` (N, 2) and how they depend on the point (px/m), on the mirror's foot point
    (px/m), on the thickness of its glass (px/m) and on its curvature (px m), also where these are 0."""

    pixels_px: Floats
    by_point: Floats
    by_foot_point: Floats
    by_thickness: Floats
    by_curvature: Floats
    valid: Mask
    reasons: Mapping[int, str]


@dataclass(frozen=True, eq=False, repr=False)
class Pixels(ShortRepr):
    """N pixels (N, 2), px."""

    pixels_px: Floats
    valid: Mask
    reasons: Mapping[int, str]


@checked_arguments
def see_in_mirror(
    camera: Camera,
    foot_points_m: npt.ArrayLike,
    points_in_camera_m: npt.ArrayLike,
    *,
    glass_thickness_m: float = 0.0,
    refractive_index: float = FLOAT_GLASS_INDEX,
    curvature_per_m: float = 0.0,
) -> SeenInMirror:
    """The pixels of points (N, 3) in mirrors (N, 3), or all in one mirror (3,); curvature is positive for a concave mirror."""
    core = _core.see_in_mirror(
        camera.core,
        np.atleast_2d(np.asarray(foot_points_m, dtype=np.float64)),
        points_in_camera_m,
        glass_thickness_m,
        refractive_index,
        curvature_per_m,
    )
    return from_core(SeenInMirror, core)


@checked_arguments
def ball_centroids(camera: Camera, centers_in_camera_m: npt.ArrayLike, diameter_m: float) -> Pixels:
    """The centroids of balls' pictures, px, from their centres (N, 3); a ball in a mirror is a ball behind it."""
    return Pixels(*_core.ball_centroids(camera.core, centers_in_camera_m, diameter_m))


@checked_arguments
def ball_center_pixels(
    camera: Camera, centroids_px: npt.ArrayLike, diameter_m: float, distances_m: npt.ArrayLike
) -> Pixels:
    """From the centroids of balls' pictures (N, 2) to the pictures of their centres: the correction that lets a ball be
    triangulated as a point. `distances_m` (N,) are the lengths of the light's paths; rough ones do."""
    return Pixels(*_core.ball_center_pixels(camera.core, centroids_px, diameter_m, distances_m))
