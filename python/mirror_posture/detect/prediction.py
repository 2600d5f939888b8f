"""Expected corners of a view from what is known of the board, to choose between labellings that look the same."""

from __future__ import annotations

import cv2
import numpy as np

from .types import BoardPrediction, BoardSpec, CameraSpec, FloatArray, Via


def predicted_corners_px(
    grid: FloatArray,
    board: BoardSpec,
    camera: CameraSpec | None,
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
    points = board.points_in_board_m() @ camera_from_board[:3, :3].T + camera_from_board[:3, 3]
    if via == "mirror":
        centre = camera_from_board[:3, 3]
        reflected = grid_center_in_camera(grid, board, camera)
        if reflected is None or np.linalg.norm(reflected - centre) < 1e-9:
            return None
        normal = (reflected - centre) / np.linalg.norm(reflected - centre)
        offset = float(normal @ (0.5 * (reflected + centre)))
        points = points + 2.0 * (offset - points @ normal)[:, None] * normal
    if np.any(points[:, 2] <= 0.0):
        return None
    projected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.matrix, camera.distortion)
    return projected.reshape(-1, 2).astype(np.float64)


def grid_center_in_camera(grid: FloatArray, board: BoardSpec, camera: CameraSpec) -> FloatArray | None:
    """Position of the seen board's centre in the camera frame, m. The labelling does not matter for it, only right-handed ones are valid."""
    along_x = np.mean(np.diff(grid, axis=1), axis=(0, 1))
    along_y = np.mean(np.diff(grid, axis=0), axis=(0, 1))
    # A pose solver wants labels of a thing that exists: right-handed with z away from the camera, as OpenCV's boards are.
    right_handed = along_x[0] * along_y[1] - along_x[1] * along_y[0] > 0.0
    pixels = (grid if right_handed else grid[:, ::-1]).reshape(-1, 1, 2)
    ok, _, translation = cv2.solvePnP(
        board.points_in_board_m(),
        np.ascontiguousarray(pixels),
        camera.matrix,
        camera.distortion,
        flags=cv2.SOLVEPNP_ITERATIVE,
    )
    if not ok or not np.isfinite(translation).all() or translation[2, 0] <= 0.0:
        return None
    return translation.reshape(3).astype(np.float64)
