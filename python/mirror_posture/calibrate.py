"""Calibrating the camera-board transform: from mirror views alone, or with a second camera as in the paper.

`camera_from_board` is (4, 4). Its covariance (6, 6) is in the tangent `camera_from_board ∘ (Exp ω, v)`,
rotation first (rad, m). Corners are `(V, nx * ny, 2)` px in the order `index = iy * nx + ix` of their TRUE
labels, a pair of NaN where a corner was not seen. Every function raises `MirrorPostureError` for what it
cannot do, with what was given and what was required.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from . import _core
from .arguments import checked_arguments
from .arrays import Floats, Integers
from .board import Board
from .camera import Camera
from .mirror import FLOAT_GLASS_INDEX, Loss
from .short_repr import ShortRepr, from_core

DEFAULT_GATE_PX = 1.0
"""A view whose own best flat board leaves more than this (px RMS) is refused."""


@dataclass(frozen=True, eq=False, repr=False)
class WeakDirection(ShortRepr):
    """A direction of the transform and how badly it is known: unit axis in the board frame, standard deviation in rad or m."""

    motion: Literal["rotation", "translation"]
    axis_in_board: Floats
    std: float
    text: str

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True, eq=False, repr=False)
class CameraBoardCalibration(ShortRepr):
    """A camera-board transform from mirror views.

    `views` are the rows that were used, `reasons` says why the others were not. `normals` (U, 3),
    `offsets_m` (U,) and `plane_covariances_m2` (U, 3, 3, of the foot points) are their mirrors in the
    camera frame. `reprojection_mean_px` is the mean length of all corners' residuals, `view_rms_px` (U,)
    the RMS length by view, `corner_std_px` the standard deviation of a corner along one axis, from which
    the covariance is computed. `warning` names the directions that the views hardly determine and says what
    to do (None where all are known well); `weak_direction` is the worst of them. `determined` is False
    where some direction is not determined at all: a prior of 0.3 rad and 0.3 m then holds it near the
    closed form.
    """

    camera_from_board: Floats
    covariance: Floats
    worst_translation: WeakDirection
    worst_rotation: WeakDirection
    weak_direction: WeakDirection | None
    warning: str | None
    determined: bool
    views: Integers
    reasons: Mapping[int, str]
    normals: Floats
    offsets_m: Floats
    plane_covariances_m2: Floats
    reprojection_mean_px: float
    view_rms_px: Floats
    corner_std_px: float


@dataclass(frozen=True, eq=False, repr=False)
class SecondCameraCalibration(ShortRepr):
    """A camera-board transform from K snapshots of a second camera.

    `chi_squared` sums the snapshots' squared normalised deviations from the mean; it should be about
    `degrees_of_freedom` = 6 (K - 1). The `snapshot_…` arrays are the results of each snapshot alone.
    """

    camera_from_board: Floats
    covariance: Floats
    worst_translation: WeakDirection
    worst_rotation: WeakDirection
    weak_direction: WeakDirection | None
    warning: str | None
    chi_squared: float
    degrees_of_freedom: int
    snapshot_camera_from_board: Floats
    snapshot_covariances: Floats
    snapshot_chi_squared: Floats
    snapshot_rms_px: Floats


def _weakness(core: _core.CameraBoardCalibration | _core.SecondCameraCalibration) -> dict[str, Any]:
    """The fields that describe the poorly known directions."""
    translation, rotation, weak, warning = core.weakness

    def direction(parts: _core._Direction) -> WeakDirection:
        text, motion, axis, std = parts
        return WeakDirection(motion, np.asarray(axis), std, text)

    return {
        "worst_translation": direction(translation),
        "worst_rotation": direction(rotation),
        "weak_direction": None if weak is None else direction(weak),
        "warning": warning,
    }


@checked_arguments
def calibrate_from_mirror_views(
    camera: Camera,
    board: Board,
    corners_px: npt.ArrayLike,
    *,
    corner_std_px: float | None = None,
    loss: Loss = "huber",
    nominal_camera_from_board: npt.ArrayLike | None = None,
    nominal_covariance: npt.ArrayLike | None = None,
    gate_px: float = DEFAULT_GATE_PX,
    glass_thickness_m: float = 0.0,
    refractive_index: float = FLOAT_GLASS_INDEX,
) -> CameraBoardCalibration:
    """The transform from three or more views of the board in a mirror that is turned and tilted between them.

    Closed form from the reflected board's poses (after Takahashi et al. 2012), then all corners of all views at once, each with
    its own mirror: `argmin Σ ρ(|pixel − observed| / σ)` over the transform and each view's plane.

    Args:
        camera: The camera that sees the board in the mirror.
        board: The board; its corners are those of `corners_px`.
        corners_px: (V, nx * ny, 2), px: the corners of V views, with their true labels; a pair of NaN where one was not seen.
        corner_std_px: σ, the standard deviation of a corner along one axis. None: estimated from the residuals.
        loss: How a residual of length r (in σ) counts: "squared" `r²`; "huber" the same up to r = 2, then linear; "cauchy"
            `9 ln(1 + r²/9)`, by which gross errors lose their pull.
        nominal_camera_from_board: (4, 4), the centre of a prior. With one, a single view is enough.
        nominal_covariance: (6, 6), the prior's covariance in the tangent `camera_from_board ∘ (Exp ω, v)`: rotation before
            translation, rad² and m². Both of the prior or neither.
        gate_px: A view whose own best flat board leaves more than this, px RMS, is refused; `reasons` says so.
        glass_thickness_m: Thickness of the mirror's pane; 0: silvered in front.
        refractive_index: Of the pane.

    Raises:
        MirrorPostureError: a wrong shape or a number that is out of range; one of the prior's two parts without the other;
            without a prior, fewer than three views that can be used (with the reason of the first refused one); views that do
            not determine the transform. A single weak direction is no error: `warning` and `determined` tell it.
    """
    core = _core.calibrate_mirror_views(
        camera.core,
        board.corners,
        board.square_m,
        corners_px,
        corner_std_px,
        loss,
        nominal_camera_from_board,
        nominal_covariance,
        gate_px,
        glass_thickness_m,
        refractive_index,
    )
    return from_core(CameraBoardCalibration, core, **_weakness(core))


@checked_arguments
def calibrate_with_second_camera(
    robot_camera: Camera,
    second_camera: Camera,
    chest_board: Board,
    stand_board: Board,
    *,
    stand_in_robot_camera_px: npt.ArrayLike,
    stand_in_second_camera_px: npt.ArrayLike,
    chest_in_second_camera_px: npt.ArrayLike,
) -> SecondCameraCalibration:
    """The transform the paper's way: `camera_from_stand · second_from_stand⁻¹ · second_from_chest` of each
    of K snapshots.

    A second camera sees the board on the chest and a board in the robot's view; both are seen directly.
    Between snapshots the second camera and the other board may move. The result is the mean of the snapshots'
    chains, each weighted by its covariance.

    Args:
        robot_camera: The robot's camera.
        second_camera: The other camera.
        chest_board: The board on the robot, `board` of the result.
        stand_board: The board in the robot's view, with n_s corners.
        stand_in_robot_camera_px: (K, n_s, 2), px: its corners in the robot's camera; NaN where one was not seen.
        stand_in_second_camera_px: (K, n_s, 2), px: its corners in the second camera.
        chest_in_second_camera_px: (K, n_c, 2), px: the n_c corners of the chest's board in the second camera.

    Raises:
        MirrorPostureError: a wrong shape, another number of snapshots in one of the three, no snapshot, or a snapshot in which
            the pose of a board cannot be estimated (with its number).
    """
    core = _core.calibrate_second_camera(
        robot_camera.core,
        second_camera.core,
        (*chest_board.corners, chest_board.square_m),
        (*stand_board.corners, stand_board.square_m),
        stand_in_robot_camera_px,
        stand_in_second_camera_px,
        chest_in_second_camera_px,
    )
    return from_core(SecondCameraCalibration, core, **_weakness(core))
