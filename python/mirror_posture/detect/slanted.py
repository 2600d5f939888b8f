"""Corners of boards whose edges cross at a slant or lie a few pixels apart, by a fit of the pattern.

Where blur fills the window, the point to which gradients are perpendicular (`corners`) is no longer the
corner. At a saddle whose curvatures differ by more than a factor of two, as where edges cross at less than
70°, the iteration converges to a point beside it, by up to a pixel and in all corners alike, so no residual
shows it. Here the squares around each corner are rendered from the grid, blurred like the picture, and
shifted until they fit. On sharp, wide squares both methods agree; a pane's ghost pulls this one more.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from ..medians import median
from .types import FloatArray, Pixels

# Single precision is enough for a drawn pattern, and takes half of the time.
Single = npt.NDArray[np.float32]

# Edges that cross at less than this, degrees, and lines of the grid nearer to each other than this, px, are read here (medians over the board; measured: beyond both, corners off by
# 0.05 px at most in clean pictures, below either up to 1.3).
LEAST_ANGLE_DEG = 60.0
LEAST_APART_PX = 8.0
# Of each square this share is compared, at most so many pixels from the corner, at least so many.
COMPARED_SHARE = 0.7
MOST_REACH_PX, LEAST_REACH_PX = 6, 3
# Samples of the rendered pattern a pixel, each way, and its margin beyond the compared part, px.
FINE = 2
BEYOND_PX = 3
# Blurs that are tried, px, on so many corners of the board.
BLURS_PX = (0.5, 0.8, 1.2, 1.8, 2.7)
BLUR_CORNERS = 8
# A pixel averages over a square: its variance, px².
PIXEL_VARIANCE_PX2 = 1.0 / 12.0
ROUNDS = 4
# Fewer points or smaller cells than these are no grid that could be drawn.
LEAST_POINTS = 4
LEAST_AREA_PX2 = 1.0
SETTLED_PX = 0.03
# Steps are cut at this, px; a quadratic is fitted to find where to begin in a window of this half side, in so many rounds.
MOST_STEP_PX = 1.0
START_REACH_PX = 2
START_ROUNDS = 8


def is_slanted(grid: FloatArray, seen: npt.NDArray[np.bool_]) -> bool:
    """Whether the edges of a grid `(ny, nx, 2)` px cross at a small angle, or its lines lie near each other, at the corners that are seen `(ny, nx)`."""
    across, down = np.gradient(grid, axis=1)[seen], np.gradient(grid, axis=0)[seen]
    wide, high = np.linalg.norm(across, axis=1), np.linalg.norm(down, axis=1)
    area = np.abs(across[:, 0] * down[:, 1] - across[:, 1] * down[:, 0])
    sine = area / np.maximum(wide * high, 1e-9)
    apart = area / np.maximum(np.maximum(wide, high), 1e-9)
    return bool(median(sine) < np.sin(np.radians(LEAST_ANGLE_DEG)) or median(apart) < LEAST_APART_PX)


def fitted_corners(gray: Pixels, corners_px: FloatArray, cells: FloatArray) -> tuple[FloatArray, int]:
    """Corners `(N, 2)` px of a board whose drawn squares fit the picture best, and the half side of the window that was compared; `cells` `(N, 2)`: their columns and rows."""
    at = _quadratic_saddles(gray, corners_px)
    reach, blur_px = LEAST_REACH_PX, 0.0
    for number in range(ROUNDS):
        to_cells = _cells_per_pixel(cells, at)
        if to_cells is None:
            return corners_px, reach
        if number == 0:
            extent = float(np.abs(np.linalg.inv(to_cells)).sum(axis=2).max())
            reach = int(np.clip(np.ceil(COMPARED_SHARE * extent), LEAST_REACH_PX, MOST_REACH_PX))
            some = np.linspace(0, len(at) - 1, min(BLUR_CORNERS, len(at))).astype(int)
            left = [median(_step(gray, at[some], to_cells[some], reach, blur)[1]) for blur in BLURS_PX]
            blur_px = BLURS_PX[int(np.argmin(left))]
        step, _ = _step(gray, at, to_cells, reach, blur_px)
        at = at + _cut(step)
        if _is_settled(step):
            break
    return at, reach


def _cut(step: FloatArray) -> FloatArray:
    """Steps (N, 2) px of no more than the most that one may be."""
    away = np.linalg.norm(step, axis=1, keepdims=True)
    cut: FloatArray = step * np.minimum(1.0, MOST_STEP_PX / np.maximum(away, 1e-9))
    return cut


def _is_settled(step: FloatArray) -> bool:
    return float(np.linalg.norm(step, axis=1).max()) < SETTLED_PX


def _cells_per_pixel(cells: FloatArray, at: FloatArray) -> FloatArray | None:
    """Columns and rows for each pixel (N, 2, 2) at cells (N, 2) that are seen at pixels (N, 2); None where these are no grid."""
    if len(at) < LEAST_POINTS:
        return None
    homography, _ = cv2.findHomography(cells, at)
    if homography is None:
        return None
    mapped = np.column_stack([cells, np.ones(len(cells))]) @ homography.T
    place, depth = mapped[:, :2] / mapped[:, 2:], mapped[:, 2, None, None]
    pixels_per_cell = (homography[:2, :2] - place[:, :, None] * homography[2, :2]) / depth
    area = np.abs(np.linalg.det(pixels_per_cell))
    if not np.isfinite(area).all() or float(area.min()) < LEAST_AREA_PX2:
        return None
    result: FloatArray = np.linalg.inv(pixels_per_cell)
    return result


def _step(
    gray: Pixels, at: FloatArray, to_cells: FloatArray, reach: int, blur_px: float
) -> tuple[FloatArray, FloatArray]:
    """Shifts (N, 2) px that make the drawn squares around corners fit the picture, and the sums of squares (N,) that are left."""
    whole = np.rint(at)
    part = (at - whole).astype(np.float32)
    drawn_side = FINE * (2 * (reach + BEYOND_PX) + 1)
    fine = ((np.arange(drawn_side) + 0.5) / FINE - 0.5 - (reach + BEYOND_PX)).astype(np.float32)
    pixel = np.arange(-reach, reach + 1)
    inverse = to_cells.astype(np.float32)
    pattern = np.ones((), dtype=np.float32)
    for axis in (0, 1):
        cell = _cell(inverse[:, axis], part, fine)
        # A triangle wave has the squares' signs; cut at half a sample it is an edge that lies between samples.
        wave = 0.5 - np.abs((cell + 0.5) % 2.0 - 1.0)
        slope = FINE / np.linalg.norm(inverse[:, axis], axis=1)
        pattern = pattern * np.clip(wave * slope[:, None, None].astype(np.float32), -0.5, 0.5)
    inside = np.ones((), dtype=bool)
    for axis in (0, 1):
        cell = _cell(inverse[:, axis], part, pixel.astype(np.float32))
        inside = inside & (np.abs(cell) < COMPARED_SHARE)
    smooth, slope_of = _kernels(fine, pixel, blur_px)
    by_row, by_row_slope = pattern @ smooth.T, pattern @ slope_of.T
    model, along_u, along_v = smooth @ by_row, smooth @ by_row_slope, slope_of @ by_row
    height, width = gray.shape
    row = np.clip(whole[:, 1, None].astype(int) + pixel, 0, height - 1)
    column = np.clip(whole[:, 0, None].astype(int) + pixel, 0, width - 1)
    seen = gray[row[:, :, None], column[:, None, :]].astype(np.float64).reshape(len(at), -1)
    terms = np.stack([np.ones_like(model), model, along_u, along_v], axis=-1).astype(np.float64)
    terms = terms.reshape(len(at), -1, 4)
    weight = inside.reshape(len(at), -1).astype(np.float64)
    weighted = (terms * weight[..., None]).transpose(0, 2, 1)
    normal = weighted @ terms + 1e-9 * np.eye(4)
    found = np.linalg.solve(normal, weighted @ seen[..., None])
    rest = seen - (terms @ found)[..., 0]
    contrast = found[:, 1, 0]
    contrast = np.where(np.abs(contrast) < 1e-3, np.inf, contrast)
    return -found[:, 2:, 0] / contrast[:, None], (weight * rest * rest).sum(axis=1)


def _cell(inverse: Single, part: Single, offsets: Single) -> Single:
    """Columns, or rows, counted from each corner (N, S, S) at pixel offsets from the whole pixel nearest to it; `inverse` (N, 2): columns for each pixel."""
    u = offsets[None, None, :] - part[:, 0, None, None]
    v = offsets[None, :, None] - part[:, 1, None, None]
    result: Single = inverse[:, 0, None, None] * u + inverse[:, 1, None, None] * v
    return result


def _kernels(fine: Single, pixel: npt.NDArray[np.intp], blur_px: float) -> tuple[Single, Single]:
    """Weights (pixels, samples) of a blurred pixel, and how they change where the pattern lies a pixel farther back."""
    away = pixel[:, None] - fine[None]
    variance = blur_px**2 + PIXEL_VARIANCE_PX2
    weight = np.exp(-0.5 * away * away / variance)
    weight /= weight.sum(axis=1, keepdims=True)
    return weight.astype(np.float32), (-away / variance * weight).astype(np.float32)


def _quadratic_saddles(gray: Pixels, corners_px: FloatArray) -> FloatArray:
    """Saddle points `(N, 2)` px near corners, of the quadratic that fits the brightness around each."""
    smooth = cv2.GaussianBlur(gray.astype(np.float32), (0, 0), 1.0)
    offsets = np.arange(-START_REACH_PX, START_REACH_PX + 1, dtype=np.float64)
    du, dv = (axis.ravel() for axis in np.meshgrid(offsets, offsets))
    solve = np.linalg.pinv(np.column_stack([du**0, du, dv, 0.5 * du * du, du * dv, 0.5 * dv * dv]))
    at: FloatArray = corners_px.copy()
    for _ in range(START_ROUNDS):
        u, v = ((at[:, axis, None] + off).astype(np.float32) for axis, off in ((0, du), (1, dv)))
        samples = cv2.remap(smooth, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        _, gu, gv, huu, huv, hvv = solve @ samples.T.astype(np.float64)
        bend = huu * hvv - huv * huv
        step = np.column_stack([huv * gv - hvv * gu, huv * gu - huu * gv])
        step /= np.where(bend < 0.0, bend, np.inf)[:, None]
        at = at + _cut(step)
        if _is_settled(step):
            break
    return at
