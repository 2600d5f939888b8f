"""Marker positions from virtual rays: the paper's midpoint, closed forms, maximum likelihood, with
covariance.

All in the camera frame, m. A marker without a result is masked: `valid` is False, its numbers are NaN and
`reasons` says why (too little parallax, with the actual and the required angle; a point behind the mirror;
…).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from . import _core
from .arguments import checked_arguments
from .arrays import Floats, Mask
from .camera import Camera
from .mirror import MirrorEstimates
from .short_repr import ShortRepr, from_core

Triangulator = Literal["midpoint", "lee_civera_mid2", "unbiased", "maximum_likelihood"]

TRIANGULATORS: tuple[Triangulator, ...] = ("midpoint", "lee_civera_mid2", "unbiased", "maximum_likelihood")
"""The paper's (least squares for more than two rays); two closed forms of two rays; in pixels, N views."""


@dataclass(frozen=True, eq=False, repr=False)
class MarkerPositions(ShortRepr):
    """Positions of M markers.

    `covariances_m2` (M, 3, 3) contains the noise of pixels and corners (`measurement_covariances_m2`) and
    the covariance of the camera-board transform, through `point_by_camera_from_board` (M, 3, 6).
    `parallax_rad` is the largest angle between two of a marker's rays. `rms_px` and `chi_squared` (2 V − 3
    degrees of freedom) are of maximum likelihood alone, NaN otherwise.
    """

    triangulator: Triangulator
    points_in_camera_m: Floats
    covariances_m2: Floats
    measurement_covariances_m2: Floats
    point_by_camera_from_board: Floats
    parallax_rad: Floats
    rms_ray_distance_m: Floats
    rms_px: Floats
    chi_squared: Floats
    valid: Mask
    reasons: Mapping[int, str]


@dataclass(frozen=True, eq=False, repr=False)
class TwoViewMarkers(ShortRepr):
    """Positions of N markers by the paper's measurement, (N, 3) m in the camera frame."""

    points_in_camera_m: Floats
    valid: Mask
    reasons: Mapping[int, str]


@checked_arguments
def triangulate(
    mirrors: MirrorEstimates,
    mirror_rows: npt.ArrayLike,
    pixels_px: npt.ArrayLike,
    *,
    noise_px: float,
    triangulator: Triangulator = "maximum_likelihood",
    least_parallax_rad: float | None = None,
) -> MarkerPositions:
    """Markers from pixels `(M, V, 2)`, each seen in the mirror of a row `(M, V)`, on all cores.

    A negative row is a view that did not see the marker. `noise_px` is the standard deviation of a pixel along one axis;
    `least_parallax_rad` defaults to 1°. Raises `MirrorPostureError` for a wrong shape or name.
    """
    core = _core.triangulate(
        mirrors._core,
        np.asarray(mirror_rows, dtype=np.int64),
        pixels_px,
        noise_px,
        triangulator,
        least_parallax_rad,
    )
    return from_core(MarkerPositions, core, triangulator=triangulator)


@checked_arguments
def two_view_markers(
    camera: Camera,
    board_in_camera_m: npt.ArrayLike,
    reflected_boards_m: npt.ArrayLike,
    pixels_px: npt.ArrayLike,
    *,
    least_parallax_rad: float | None = None,
) -> TwoViewMarkers:
    """The paper's measurement in bulk: two mirrors by Eq. 2, two virtual rays, their midpoint, for each of N markers.

    `board_in_camera_m` (3,) is the board's origin b, `reflected_boards_m` (N, 2, 3) its reflection b′ in both views,
    `pixels_px` (N, 2, 2) the marker in both views.
    """
    core = _core.two_view_markers(
        camera.core, board_in_camera_m, reflected_boards_m, pixels_px, least_parallax_rad
    )
    return from_core(TwoViewMarkers, core)
