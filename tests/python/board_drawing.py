"""Draws flat boards through a given homography, by point sampling: it shares nothing with detection but the session format."""

from __future__ import annotations

import numpy as np


def chessboard_picture(
    corners_x: int,
    corners_y: int,
    picture_from_board: np.ndarray,
    size: tuple[int, int] = (480, 360),
    noise_levels: float = 2.0,
    seed: int = 1,
    first_dark: bool = True,
) -> np.ndarray:
    """Grey picture of a chessboard. `picture_from_board` (3, 3) maps board coordinates, in squares from the centre, to px."""
    width, height = size
    picture = np.full((height, width), 120.0)
    columns, rows = _reach(corners_x, corners_y, picture_from_board, size)
    board_from_picture = np.linalg.inv(picture_from_board)
    for top in range(rows.start, rows.stop, 16):
        few = range(top, min(top + 16, rows.stop))
        picture[few.start : few.stop, columns.start : columns.stop] = _rows(
            board_from_picture, columns, few, (corners_x, corners_y), first_dark
        )
    picture += np.random.default_rng(seed).normal(0.0, noise_levels, picture.shape)
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


def _reach(
    corners_x: int, corners_y: int, picture_from_board: np.ndarray, size: tuple[int, int]
) -> tuple[range, range]:
    """Columns and rows of the picture that the paper can touch: all where a part of it is behind the camera."""
    x, y = (corners_x + 1) / 2.0 + 0.9, (corners_y + 1) / 2.0 + 0.9
    paper = picture_from_board @ np.array([[-x, x, x, -x], [-y, -y, y, y], [1.0, 1.0, 1.0, 1.0]])
    if not (np.all(paper[2] > 0.0) or np.all(paper[2] < 0.0)):
        return range(size[0]), range(size[1])
    ends = paper[:2] / paper[2]
    low, high = np.floor(ends.min(axis=1)) - 1, np.ceil(ends.max(axis=1)) + 2
    low, high = np.clip(low, 0, size).astype(int), np.clip(high, 0, size).astype(int)
    return range(low[0], high[0]), range(low[1], high[1])


def _rows(
    board_from_picture: np.ndarray, columns: range, rows: range, corners: tuple[int, int], first_dark: bool
) -> np.ndarray:
    """A part of the picture, each pixel the mean of 4 x 4 samples: few rows at a time stay in the processor's cache."""
    fine = 4
    offsets = (np.arange(fine) + 0.5) / fine - 0.5
    u = (np.array(columns)[:, None] + offsets).reshape(-1)
    v = (np.array(rows)[:, None] + offsets).reshape(-1, 1)
    x, y, w = (a * u + (b * v + c) for a, b, c in board_from_picture)
    corners_x, corners_y = corners
    x, y = x / w + (corners_x + 1) / 2.0, y / w + (corners_y + 1) / 2.0
    column, row = np.floor(x), np.floor(y)
    inside = (column >= 0) & (row >= 0) & (column <= corners_x) & (row <= corners_y)
    paper = (x > -0.8) & (y > -0.8) & (x < corners_x + 1.8) & (y < corners_y + 1.8)
    dark = inside & ((column + row) % 2 == (0 if first_dark else 1))
    value = np.where(dark, 40.0, np.where(paper, 210.0, 120.0))
    return value.reshape(len(rows), fine, len(columns), fine).mean(axis=(1, 3))


def corners_px(corners_x: int, corners_y: int, picture_from_board: np.ndarray) -> np.ndarray:
    """True pixels `(N, 2)` of the inner corners, index = iy * corners_x + ix."""
    iy, ix = np.divmod(np.arange(corners_x * corners_y), corners_x)
    board = np.stack([ix - (corners_x - 1) / 2.0, iy - (corners_y - 1) / 2.0, np.ones(len(ix))])
    picture = picture_from_board @ board
    return (picture[:2] / picture[2]).T


def view(
    turn_rad: float, mirrored: bool, pitch_px: float = 26.0, center: tuple[float, float] = (240.0, 180.0)
) -> np.ndarray:
    """A mildly perspective `picture_from_board`; a direct view has y up in the picture (z comes out of the face), a mirrored one not."""
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    hand = np.diag([1.0, 1.0 if mirrored else -1.0, 1.0])
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    tilt = np.array([[pitch_px, 0.0, center[0]], [0.0, 0.93 * pitch_px, center[1]], [0.0, 0.0, 1.0]])
    perspective = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.006, 0.004, 1.0]])
    return tilt @ perspective @ turn @ hand
