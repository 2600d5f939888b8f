"""The pose of a detected board by the core's planar solver, for the calibrated gate and for distances.

A pose solver cannot detect a wrong handedness, because both labellings reproject equally well. So a
mirrored view has a pose too: that of a board seen from behind, with the same residual and the same centre.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .. import _core
from ..board import Board
from ..camera import Camera
from ..short_repr import ShortRepr
from .types import FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class BoardPose(ShortRepr):
    """Centre of the seen board in the camera frame, m, and RMS distance of its corners from their reprojection, px."""

    center_in_camera_m: FloatArray
    rms_px: float


def board_pose(
    corners_px: FloatArray,
    board: Board,
    camera: Camera,
    visible: npt.NDArray[np.bool_] | None = None,
) -> BoardPose | None:
    """Pose of a view, corners `(N, 2)` in any of the board's orders, by those that are `visible` `(N,)`; None where the solver finds none."""
    if visible is not None:
        corners_px = np.where(visible[:, None], corners_px, np.nan)
    poses = _core.planar_poses(camera.core, board.corners, board.square_m, corners_px.reshape(1, -1, 2))
    if not poses.valid[0]:
        return None
    return BoardPose(np.asarray(poses.camera_from_pattern)[0, :3, 3], float(poses.rms_px[0]))
