"""A ball's outline to a fraction of a pixel: start circles go to the core, fitted outlines come back.

The core reads sub-pixel edges, fits the cone of rays that touch a sphere, and returns the centre's
covariance; all balls of a picture at once, on all threads.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from .. import _core
from ..camera import Camera
from ..short_repr import ShortRepr
from .types import Ellipse, FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class Circle(ShortRepr):
    """A circle in the picture, px."""

    center_px: FloatArray
    radius_px: float


@dataclass(frozen=True, eq=False, repr=False)
class Start(ShortRepr):
    """Where a ball may be: a circle, and the radii that it may have, px."""

    circle: Circle
    min_radius_px: float
    max_radius_px: float


@dataclass(frozen=True, eq=False, repr=False)
class OutlineFit(ShortRepr):
    """A fitted outline: its centroid and ellipse in the picture, the sphere's centre, and the agreement of
    the edges.

    `arc_fraction` is the share of the outline that agreeing edges cover, `blur_px` the standard deviation
    of the picture's blur there in its widest direction, `narrow_blur_px` in its narrowest: much less where
    ball or camera moved; `lens_blur_px` over all directions, without the codec's blur of colours.
    `curve_deviations` is by how many deviations of the covariance's allowance the channels show another
    tone curve (None where they do not determine it), `curve_moved_px` how far one deviation moves the
    centre.
    """

    centroid_px: FloatArray
    centroid_covariance_px2: FloatArray
    sphere_center_px: FloatArray
    ellipse: Ellipse
    boundary_px: FloatArray
    mean_radius_px: float
    arc_fraction: float
    residual_rms_px: float
    blur_px: float
    narrow_blur_px: float
    lens_blur_px: float
    curve_deviations: float | None = None
    curve_moved_px: FloatArray = field(default_factory=lambda: np.zeros(2))


def measure_balls(
    bgr: npt.NDArray[np.uint8],
    starts: Sequence[Start],
    camera: Camera,
    chroma_step_px: tuple[int, int] = (1, 1),
    curve: float = 0.0,
) -> list[OutlineFit | None]:
    """The ball at each start in a colour picture `(H, W, 3)` BGR, or None where no outline of a sphere of a fitting size is there.

    `curve`: by how many deviations of the covariances' allowance the camera's tone curve differs from sRGB's; the light is sRGB's to the power `1.085^curve`.
    """
    if not starts:
        return []
    circles = [[*one.circle.center_px, one.circle.radius_px] for one in starts]
    radii = [[one.min_radius_px, one.max_radius_px] for one in starts]
    found = _core.measure_balls(
        np.ascontiguousarray(bgr), np.array(circles), np.array(radii), camera.core, chroma_step_px, curve
    )
    return [None if one is None else _as_fit(one) for one in found]


def measure_blurred_balls(
    bgr: npt.NDArray[np.uint8],
    starts: Sequence[Circle],
    radius_std_share: float,
    camera: Camera,
    curve: float = 0.0,
) -> list[OutlineFit | None]:
    """The ball of a circle's size near each circle, measured from all of its pixels: for balls that are
    blurred over much of their radius. None where none is found.

    Three or more share their blur, as far as they determine one. `curve` as in `measure_balls`.

    `arc_fraction` is the share of its rim whose pixels fit, `residual_rms_px` the edge error that
    corresponds to its pixels' residuals.
    """
    if not starts:
        return []
    expected = [
        [float(one.center_px[0]), float(one.center_px[1]), one.radius_px, radius_std_share * one.radius_px]
        for one in starts
    ]
    found = _core.measure_blurred_balls(np.ascontiguousarray(bgr), expected, camera.core, curve)
    return [None if one is None else _as_fit(one) for one in found]


def fit_circle(
    points_px: FloatArray, min_radius_px: float, max_radius_px: float, tolerance_px: float
) -> Circle | None:
    """The circle with the most points `(N, 2)` within the tolerance, by random triples (the same answer each time)."""
    found = _core.fit_circle_by_consensus(points_px, min_radius_px, max_radius_px, tolerance_px)
    return None if found is None else Circle(np.array(found[:2]), found[2])


def _as_fit(one: _core.BallOutline) -> OutlineFit:
    u, v, major, minor, angle = one.ellipse
    return OutlineFit(
        centroid_px=np.array(one.centroid_px),
        centroid_covariance_px2=one.centroid_covariance_px2,
        sphere_center_px=np.array(one.sphere_center_px),
        ellipse=Ellipse((u, v), major, minor, angle),
        boundary_px=one.boundary_px,
        mean_radius_px=one.mean_radius_px,
        arc_fraction=one.arc_fraction,
        residual_rms_px=one.residual_rms_px,
        blur_px=one.blur_px,
        narrow_blur_px=one.narrow_blur_px,
        lens_blur_px=one.lens_blur_px,
        curve_deviations=one.curve_deviations,
        curve_moved_px=np.array(one.curve_moved_px),
    )
