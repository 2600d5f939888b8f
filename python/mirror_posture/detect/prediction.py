"""Predicted corners of a view from what is known of the board, to select among ambiguous labellings."""

from __future__ import annotations

import numpy as np

from .._core import MirrorPostureError
from ..board import Board
from ..camera import Camera
from .pose import board_pose
from .types import BoardPrediction, FloatArray, Via


def predicted_corners_px(
    grid: FloatArray,
    board: Board,
    camera: Camera | None,
    prediction: BoardPrediction | None,
    via: Via,
) -> FloatArray | None:
    """Expected pixels `(N, 2)` of the labelled corners, or None where nothing is known.

    From `camera_from_board` alone, a direct view is a projection. For a mirrored one the plane comes from the point pair (paper,
    Eq. 2): through the midpoint of the board's centre b and of its reflection b′, normal to b′ − b. It needs only the reflection's
    position, which is the same for every labelling.
    """
    if prediction is None:
        return None
    if prediction.corners_px is not None:
        return np.asarray(prediction.corners_px, dtype=np.float64).reshape(-1, 2)
    if prediction.camera_from_board is None or camera is None:
        return None
    camera_from_board = np.asarray(prediction.camera_from_board, dtype=np.float64)
    points = board.corner_in_board_m @ camera_from_board[:3, :3].T + camera_from_board[:3, 3]
    if via == "mirror":
        centre = camera_from_board[:3, 3]
        pose = board_pose(grid.reshape(-1, 2), board, camera)
        if pose is None:
            return None
        reflected = pose.center_in_camera_m
        if np.linalg.norm(reflected - centre) < 1e-9:
            return None
        normal = (reflected - centre) / np.linalg.norm(reflected - centre)
        offset = float(normal @ (0.5 * (reflected + centre)))
        points = points + 2.0 * (offset - points @ normal)[:, None] * normal
    try:
        return camera.project(points)
    except MirrorPostureError:
        # Behind the camera, or beyond its lens.
        return None
