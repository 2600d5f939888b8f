"""The middle of a seen board with its pattern drawn there: what the picture would be without lens, pane and camera."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from .. import _core
from ..board import Board
from .types import BoardView, FloatArray, Pixels

# The part of the board that is looked at, squares each way from its middle: enough for a ghost of a fiftieth.
HALF_ACROSS, HALF_DOWN = 2.2, 1.5
# Parts of fewer pixels a side tell nothing.
LEAST_SIDE_PX = 8


@dataclass(frozen=True, eq=False)
class DrawnBoard:
    """A part of a picture: its grey levels (H, W) uint8, the board's pattern there (1 and −1 by square, edges averaged over each pixel), two squares' side, px,
    and the first pixel (u, v)."""

    gray: Pixels
    pattern: Pixels
    side_px: float
    corner: tuple[int, int]

    @property
    def size(self) -> tuple[int, int]:
        """Pixels across and down."""
        return (self.gray.shape[1], self.gray.shape[0])

    def mean(self, values: Pixels) -> Pixels:
        """Means over two squares each way: light changes slowly across the board."""
        odd = 2 * round(0.5 * self.side_px) + 1
        result: Pixels = cv2.boxFilter(values, -1, (odd, odd), borderType=cv2.BORDER_REFLECT)
        return result


def drawn_board(gray: Pixels, view: BoardView, board: Board) -> DrawnBoard | None:
    """The middle of a board in a view of `gray` (H, W) uint8, drawn through the homography of its corners; None where too little of it is in the picture."""
    if view.corners_px is None:
        return None
    seen = np.ones(board.corner_count, dtype=bool) if view.visible is None else view.visible
    middle = 0.5 * (np.array(board.corners) - 1.0)
    grid = board.corner_in_board_m[:, :2] / board.square_m + middle
    found, _ = cv2.findHomography(view.corners_px[seen], grid[seen])
    if found is None or not np.isfinite(found).all():
        return None
    homography: FloatArray = found.astype(np.float64)
    half = np.minimum([HALF_ACROSS, HALF_DOWN], middle)
    corners = middle + half * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    outline = cv2.perspectiveTransform(corners[None], np.linalg.inv(homography))[0]
    height, width = gray.shape
    # An upright box within the outline's extent: beyond the part is more of the board, or its edge.
    left, top = np.maximum(np.ceil(outline.min(axis=0)), 0).astype(int)
    right, bottom = np.minimum(np.floor(outline.max(axis=0)) + 1, [width, height]).astype(int)
    if right - left < LEAST_SIDE_PX or bottom - top < LEAST_SIDE_PX:
        return None
    size = (int(right - left), int(bottom - top))
    pattern = _core.drawn_pattern(homography.tolist(), [float(left), float(top)], size)
    square = float(np.sqrt(abs(np.linalg.det(np.linalg.inv(homography)[:2, :2]))))
    return DrawnBoard(gray[top:bottom, left:right], pattern, 2.0 * square, (int(left), int(top)))
