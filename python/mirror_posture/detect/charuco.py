"""ChArUco boards, direct or mirrored: corners with printed labels, so that a part of the board is enough.

A mirrored marker carries no valid code. The picture is flipped (x → W − 1 − x exactly, pixel centres are whole numbers), the board is
found as if seen directly, and the corners are flipped back.

OpenCV's board has its origin at the printed top left and z into the board; the session format has z out of the printed face. So one axis is
turned round: y, or x where only that makes the square beyond corner 0 dark. (With two odd counts OpenCV's pattern cannot meet that rule; the
printed codes settle the labels all the same, and corner 0 is the printed lower left.)
"""

from __future__ import annotations

import cv2
import numpy as np

from ..arguments import checked_arguments
from ..board import Board
from ..camera import Camera
from . import corners
from .board import BoardOptions
from .types import BoardView, DetectionError, Pixels, Via, check_board

# Fewer corners than this cannot show a residual against a plane.
MIN_CORNERS = 6


@checked_arguments
def detect_charuco(
    gray: Pixels, board: Board, camera: Camera | None = None, options: BoardOptions | None = None
) -> tuple[BoardView, ...]:
    """Detects the expected views of a ChArUco board in a grey picture (H, W) uint8, one view of each kind."""
    check_board(board)
    options = options or BoardOptions()
    detector = cv2.aruco.CharucoDetector(charuco_board(board))
    return tuple(_detect_view(gray, board, detector, camera, via, options) for via in options.views)


def charuco_board(board: Board) -> cv2.aruco.CharucoBoard:
    """OpenCV's board for a session's `[board]`. Raises `DetectionError` for a dictionary that OpenCV does not have."""
    name = str(board.dictionary)
    names = sorted(one for one in dir(cv2.aruco) if one.startswith("DICT_"))
    if name not in names:
        raise DetectionError(f"board dictionary = {name!r}: valid are {', '.join(names)}")
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
    size = (board.columns + 1, board.rows + 1)
    needed = size[0] * size[1] // 2
    held = len(dictionary.bytesList)
    if needed > held:
        raise DetectionError(
            f"board dictionary = {name!r}: holds {held} markers, a board of {size[0]} × {size[1]} squares needs {needed}"
        )
    return cv2.aruco.CharucoBoard(size, board.square_m, float(board.marker_size_m or 0.0), dictionary)


def _detect_view(
    gray: Pixels,
    board: Board,
    detector: cv2.aruco.CharucoDetector,
    camera: Camera | None,
    via: Via,
    options: BoardOptions,
) -> BoardView:
    mirrored = via == "mirror"
    picture = np.ascontiguousarray(gray[:, ::-1]) if mirrored else gray
    try:
        found, ids, _, _ = detector.detectBoard(picture)
    except cv2.error as error:
        return BoardView(
            False, f"the ChArUco detector refused the picture: {error.err}", via, method="charuco"
        )
    count = 0 if ids is None else len(ids)
    if count < MIN_CORNERS:
        what = "mirrored " if mirrored else ""
        return BoardView(
            False,
            f"{count} corners of a {what}ChArUco board found, needed {MIN_CORNERS}: not in the picture, hidden or too small",
            via,
        )
    points = np.asarray(found, dtype=np.float64).reshape(-1, 2)
    if mirrored:
        points[:, 0] = gray.shape[1] - 1 - points[:, 0]
    ix, iy = np.asarray(ids).reshape(-1) % board.columns, np.asarray(ids).reshape(-1) // board.columns
    # The pattern's top left square is dark; a corner square is dark again after an even count of squares.
    if board.rows % 2 == 1 and board.columns % 2 == 0:
        ix = board.columns - 1 - ix
    else:
        iy = board.rows - 1 - iy
    index = iy * board.columns + ix
    pixels = np.zeros((board.corner_count, 2))
    pixels[index] = points
    visible = np.zeros(board.corner_count, dtype=bool)
    visible[index] = True
    refined = corners.refine(gray, pixels, board, camera, options.gate, visible)
    noise = corners.noise_covariances(gray, refined.corners_px, refined.window_half_px, board, visible)
    covariances = corners.scale_by_residual(noise, refined.residual, visible)
    reason = refined.residual.reason
    return BoardView(
        ok=not reason,
        reason=reason,
        via=via,
        corners_px=refined.corners_px,
        covariances_px2=covariances,
        visible=visible,
        residual_rms_px=refined.residual.rms_px,
        residual_limit_px=refined.residual.limit_px,
        method="charuco",
        corners_x=board.columns,
    )
