"""The middle of a seen board with its pattern drawn there: what the picture would be without lens, pane and camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ..board import Board
from .types import BoardView, FloatArray, Pixels

# The part of the board that is looked at, squares each way from its middle: enough for a ghost of a fiftieth.
HALF_ACROSS, HALF_DOWN = 2.2, 1.5
# Samples a pixel each way of the drawn pattern.
FINE = 2
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
    u = left + (np.arange((right - left) * FINE) + 0.5) / FINE - 0.5
    v = top + (np.arange((bottom - top) * FINE) + 0.5) / FINE - 0.5
    fine = _edges(u[None, :], v[:, None], homography)
    pattern = fine.reshape(bottom - top, FINE, right - left, FINE).mean(axis=(1, 3)).astype(np.float32)
    square = float(np.sqrt(abs(np.linalg.det(np.linalg.inv(homography)[:2, :2]))))
    return DrawnBoard(gray[top:bottom, left:right], pattern, 2.0 * square, (int(left), int(top)))


def _edges(u: npt.NDArray[Any], v: npt.NDArray[Any], homography: FloatArray) -> FloatArray:
    """The pattern at pixels u (1, W) and v (H, 1), its edges as wide as a sample: their places are kept to more than that."""
    depth = homography[2, 0] * u + homography[2, 1] * v + homography[2, 2]
    result: FloatArray = np.ones(depth.shape)
    for row in homography[:2]:
        cell = (row[0] * u + row[1] * v + row[2]) / depth
        across, down = row[0] - cell * homography[2, 0], row[1] - cell * homography[2, 1]
        # (A hypotenuse by its squares: `np.hypot` takes most of the time of all this.)
        slope = np.sqrt(across * across + down * down) / np.abs(depth)
        # A triangle wave has the squares' signs; cut at half a sample from where it is zero.
        wave = np.abs((cell + 0.5) % 2.0 - 1.0) - 0.5
        result *= np.clip(wave * (2.0 * FINE) / slope, -1.0, 1.0)
    return result
