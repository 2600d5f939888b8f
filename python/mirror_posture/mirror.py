"""Mirrors from the reflected board: one interface to all mirror estimators, and the virtual rays.

A mirror is the plane `n·x = d` in the camera frame, n away from the camera, d > 0; its covariance is that
of its foot point `f = d n` (m²). Corners are `(N, nx * ny, 2)` px in the order `index = iy * nx + ix` of
their TRUE labels, a pair of NaN where a corner was not seen. A view without a result is masked: `valid` is
False, its numbers are NaN and `reasons` says why.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, TypedDict

import numpy as np
import numpy.typing as npt

from . import _core
from .arguments import checked_arguments
from .arrays import Floats, Mask
from .board import Board
from .camera import Camera
from .formats.session_keys import FLOAT_GLASS_INDEX as FLOAT_GLASS_INDEX
from .short_repr import ShortRepr, from_core

Estimator = Literal["pose", "pose_snapped", "point_pair", "maximum_likelihood"]
Loss = Literal["squared", "huber", "cauchy"]

ESTIMATORS: tuple[Estimator, ...] = ("pose", "pose_snapped", "point_pair", "maximum_likelihood")
"""Eq. 1 of the paper, Eq. 1 snapped to the nearest reflection, Eq. 2 (the paper's method), maximum likelihood."""


class GlassArguments(TypedDict, total=False):
    """What the optics' functions take of a mirror's glass."""

    glass_thickness_m: float
    refractive_index: float


@dataclass(frozen=True)
class Mirror:
    """The mirror's construction: a pane of glass, silvered behind; a thickness of 0 m is a front-surface
    mirror.

    Its size and its centre's place (in the root's frame) are for plans and pictures, None where they are
    not stated. No fit uses them: a mirror's plane is estimated from the board's reflection.
    """

    glass_thickness_m: float = 0.0
    refractive_index: float = FLOAT_GLASS_INDEX
    width_m: float | None = None
    height_m: float | None = None
    center_in_root_m: tuple[float, float, float] | None = None

    @property
    def glass(self) -> GlassArguments:
        """The glass as keyword arguments of the optics' functions."""
        return {"glass_thickness_m": self.glass_thickness_m, "refractive_index": self.refractive_index}


IDEAL_MIRROR = Mirror()
"""A front-surface mirror: the default of a session that states nothing."""


@dataclass(frozen=True, eq=False, repr=False)
class Rig(ShortRepr):
    """What stays the same in all views: camera, board, how they are fixed to each other, the mirror's glass.

    `camera_from_board` is (4, 4);
    `camera_from_board_covariance` (6, 6) in the tangent `camera_from_board ∘ (Exp ω, v)`, rotation first (rad, m), None
    for "exact". Maximum likelihood uses the glass; the paper's estimators take every mirror as ideal.
    Raises `MirrorPostureError` for invalid values.
    """

    camera: Camera
    board: Board
    camera_from_board: Floats
    camera_from_board_covariance: Floats | None = None
    glass_thickness_m: float = 0.0
    refractive_index: float = FLOAT_GLASS_INDEX
    _core: _core.Rig = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        core = _core.Rig(
            self.camera.core,
            self.board.corners,
            self.board.square_m,
            self.camera_from_board,
            self.camera_from_board_covariance,
            self.glass_thickness_m,
            self.refractive_index,
        )
        object.__setattr__(self, "_core", core)


@dataclass(frozen=True, eq=False, repr=False)
class MirrorEstimates(ShortRepr):
    """Mirrors of N views.

    `covariances_m2` (N, 3, 3) of the foot points is the sum of `measurement_covariances_m2` (the view's own
    noise) and of the contribution of the camera-board transform's covariance through
    `foot_by_camera_from_board` (N, 3, 6), which the views share. `camera_from_virtual` (N, 4, 4) is the
    reflection, or Eq. 1's map for the estimator `pose` (whose plane is that of the nearest reflection).
    `rms_px` is the RMS length of the corners' residuals, `noise_px` the standard deviation of one axis from
    which the covariance is computed.
    """

    estimator: Estimator
    normals: Floats
    offsets_m: Floats
    covariances_m2: Floats
    measurement_covariances_m2: Floats
    foot_by_camera_from_board: Floats
    camera_from_virtual: Floats
    rms_px: Floats
    noise_px: Floats
    valid: Mask
    reasons: Mapping[int, str]
    _core: _core.Mirrors = field(repr=False, compare=False)

    @property
    def foot_points_m(self) -> Floats:
        """The feet of the camera's perpendiculars on the mirrors, (N, 3)."""
        return self.normals * self.offsets_m[:, None]


@dataclass(frozen=True, eq=False, repr=False)
class VirtualRays(ShortRepr):
    """M rays from virtual cameras through the real markers, in the camera frame.

    `covariances` (M, 6, 6) is of (origin m, unit direction): pixel, mirror and camera-board transform.
    """

    origins_m: Floats
    directions: Floats
    covariances: Floats
    valid: Mask
    reasons: Mapping[int, str]


@dataclass(frozen=True, eq=False, repr=False)
class PlanarPoses(ShortRepr):
    """Poses of a flat board in N views.

    `camera_from_pattern` (N, 4, 4) maps (x, y, 0) of a corner to where the camera sees it: the board's pose
    where it is seen directly, the paper's right-handed frame D where it is seen in a mirror. `covariances`
    (N, 6, 6) in the tangent with rotation first (rad, m). `alternative_rms_px` is the residual of the other
    pose that explains the view, infinite where there is none. If it is close to `rms_px`, the picture does
    not determine the sign of the tilt.
    """

    camera_from_pattern: Floats
    covariances: Floats
    rms_px: Floats
    noise_px: Floats
    alternative_rms_px: Floats
    valid: Mask
    reasons: Mapping[int, str]


@checked_arguments
def estimate_mirrors(
    rig: Rig,
    corners_px: npt.ArrayLike,
    *,
    estimator: Estimator = "maximum_likelihood",
    noise_px: float | None = None,
    loss: Loss = "squared",
) -> MirrorEstimates:
    """The mirrors of N views from their corners, `(N, nx * ny, 2)` px, on all cores.

    `noise_px` is the standard deviation of a corner along one axis; None estimates it from each view's residual.
    `loss` "huber" or "cauchy" bounds the pull of wrong corners. Raises `MirrorPostureError` for a wrong shape or an
    unknown name; a view that has no result is masked.
    """
    core = rig._core.estimate_mirrors(corners_px, estimator, noise_px, loss)
    return from_core(MirrorEstimates, core, estimator=estimator, _core=core)


@checked_arguments
def virtual_rays(
    mirrors: MirrorEstimates, mirror_rows: npt.ArrayLike, pixels_px: npt.ArrayLike, *, noise_px: float
) -> VirtualRays:
    """The virtual rays of pixels `(M, 2)`, each seen in the mirror of a row `(M,)`: Eq. 3 of the paper.

    `noise_px` is the standard deviation of a pixel along one axis.
    """
    core = _core.virtual_rays(mirrors._core, np.asarray(mirror_rows, dtype=np.int64), pixels_px, noise_px)
    return from_core(VirtualRays, core)


@checked_arguments
def planar_poses(
    camera: Camera,
    board: Board,
    corners_px: npt.ArrayLike,
    *,
    noise_px: float | None = None,
    loss: Loss = "squared",
) -> PlanarPoses:
    """The poses of a flat board from the pixels of its corners `(N, columns * rows, 2)`: closed form, then refinement."""
    core = _core.planar_poses(camera.core, board.corners, board.square_m, corners_px, noise_px, loss)
    return from_core(PlanarPoses, core)
