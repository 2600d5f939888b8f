"""The ghost of a pane in a picture, told by the board: its strength and where it lies.

The board's pattern is drawn through its corners' homography, in linear light, with several blurs; the core fits the light by it.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from .. import _core
from ..board import Board
from .ghost_light import Ghost, Pane, linear_light
from .types import BoardView, Pixels

# The part of the board that is looked at, squares each way from its middle: enough for a ghost of a fiftieth.
HALF_ACROSS, HALF_DOWN = 2.2, 1.5
# Samples a pixel each way of the drawn pattern.
FINE = 2
# Blurs of the drawn pattern that are tried, px.
BLURS_PX = (0.45, 0.7, 1.0, 1.4, 2.0)
# The farthest ghost that is looked for, px, and as a share of a square; the nearest, below which it looks like blur.
REACH_PX, REACH_SQUARES = 7, 0.6
NEAREST_PX = 1.9


def board_ghost(gray: Pixels, view: BoardView, board: Board, pane: Pane | None = None) -> Ghost | None:
    """The ghost in a view of the board `gray` (H, W) uint8, of strength 0 where it shows none; None where the board is too small to determine it. Where it lies as one of a `pane` does, the odds of the two are told too: a pane's differs across the board."""
    drawn = _drawn(gray, view, board)
    if drawn is None:
        return None
    light, pattern, side, corner = drawn
    reach = min(REACH_PX, int(REACH_SQUARES * 0.5 * side))
    if reach < NEAREST_PX or min(light.shape) < 4 * reach:
        return None
    models = [_without_shade(cv2.GaussianBlur(pattern, (0, 0), blur), side) for blur in BLURS_PX]
    found = _core.pattern_ghost(_without_shade(light, side), models, reach)
    if found is None:
        return None
    ghost = Ghost(found.strength, found.shift_px, found.weakest)
    if pane is None or ghost.strength == 0.0:
        return ghost
    return _or_of_pane(ghost, pane, found, corner, (light.shape[1], light.shape[0]))


def _or_of_pane(
    ghost: Ghost, pane: Pane, found: _core.PatternGhost, corner: tuple[int, int], size: tuple[int, int]
) -> Ghost:
    """How probable it is that a ghost is the pane's, by what each explains."""
    right, bottom = size[0] - 1.0, size[1] - 1.0
    shift = np.array(ghost.shift_px)
    moved_m = pane.moved_m(np.array(corner) + 0.5 * np.array([right, bottom]), shift)
    # Between the region's corners the way changes evenly.
    ways = pane.way_px(
        np.array(corner) + np.array([[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]])
    )
    if moved_m is None or ways is None:
        return ghost
    by_pane, alike = found.explained_by(ways * moved_m), found.explained_by(np.tile(shift, (4, 1)))
    odds = float(np.clip(0.5 * (by_pane - alike), -30.0, 30.0))
    return replace(ghost, pane=pane, moved_m=moved_m, probability=float(1.0 / (1.0 + np.exp(-odds))))


def _drawn(
    gray: Pixels, view: BoardView, board: Board
) -> tuple[Pixels, Pixels, float, tuple[int, int]] | None:
    """The middle of a seen board, linear light, its pattern drawn there (1 and −1), the side of two squares, and the first pixel, px."""
    if view.corners_px is None:
        return None
    seen = np.ones(board.corner_count, dtype=bool) if view.visible is None else view.visible
    grid = board.corner_in_board_m[:, :2] / board.square_m + 0.5 * (np.array(board.corners) - 1.0)
    homography, _ = cv2.findHomography(view.corners_px[seen], grid[seen])
    if homography is None or not np.isfinite(homography).all():
        return None
    middle = 0.5 * (np.array(board.corners) - 1.0)
    half = np.minimum([HALF_ACROSS, HALF_DOWN], middle)
    corners = middle + half * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    outline = cv2.perspectiveTransform(corners[None], np.linalg.inv(homography))[0]
    height, width = gray.shape
    # An upright box within the outline's extent: beyond the part is more of the board, or its edge.
    left, top = np.maximum(np.ceil(outline.min(axis=0)), 0).astype(int)
    right, bottom = np.minimum(np.floor(outline.max(axis=0)) + 1, [width, height]).astype(int)
    if right - left < 8 or bottom - top < 8:
        return None
    u = left + (np.arange((right - left) * FINE) + 0.5) / FINE - 0.5
    v = top + (np.arange((bottom - top) * FINE) + 0.5) / FINE - 0.5
    places = np.stack([*np.meshgrid(u, v), np.ones((len(v), len(u)))], axis=-1) @ homography.T
    x, y = places[..., 0] / places[..., 2], places[..., 1] / places[..., 2]
    signs = 1.0 - 2.0 * ((np.floor(x) + np.floor(y)) % 2.0)
    pattern = signs.reshape(bottom - top, FINE, right - left, FINE).mean(axis=(1, 3)).astype(np.float32)
    light = linear_light(gray[top:bottom, left:right])
    square = float(np.sqrt(abs(np.linalg.det(np.linalg.inv(homography)[:2, :2]))))
    return light, pattern, 2.0 * square, (int(left), int(top))


def _without_shade(values: Pixels, side: float) -> Pixels:
    """Values less their mean over two squares each way: light changes slowly across the board."""
    odd = 2 * round(0.5 * side) + 1
    result: Pixels = values - cv2.boxFilter(values, -1, (odd, odd), borderType=cv2.BORDER_REFLECT)
    return result
