"""Sub-pixel chessboard corners and what their noise is.

Position: the point q at which every gradient in a window around it is perpendicular to the direction from q (`cv2.cornerSubPix`,
Förstner's condition). A large window averages more of the picture's noise, a small one suffers less from bent edges (lens, paper) and
from light that changes across the squares: several are tried, and the one whose corners fit a flat board best is kept. Where edges cross at a
slant, or squares are small, the drawn pattern is fitted instead (`slanted`).

Covariance: `σ² (Σ g gᵀ)⁻¹` over the window, the bound for a shift of a known pattern with gradients g under white noise σ; σ is
read from the flat middles of the squares. A view's residual against the flat board then scales all of them where it is larger than
that bound explains (aliasing, compression, ghosts).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from ..board import Board
from ..camera import Camera
from ..medians import median
from ..short_repr import ShortRepr
from .gate import GateOptions, GateResult, board_residual
from .slanted import fitted_corners, is_slanted
from .types import FloatArray, Pixels

# The windows' half sides as fractions of the distance to the nearest neighbour: the next corners' edges stay outside of them.
WINDOW_FRACTIONS = (0.5, 0.35, 0.25, 0.16)
MIN_WINDOW_PX = 2
# Standard deviation of the blur before refinement.
PRE_BLUR_PX = 1.0
MAX_WINDOW_PX = 15
# Standard deviation of rounding to whole grey levels.
QUANTISATION_LEVELS = 1.0 / np.sqrt(12.0)
# What moves all corners of a view together and so leaves no residual (ghosts of the glass, pixel structure), px, one axis: measured on
# rendered pictures of a real pane.
COMMON_FLOOR_PX = 0.012
# The residual of a view must show at least this many degrees of freedom to scale the covariances.
MIN_FREEDOM = 8


@dataclass(frozen=True, eq=False, repr=False)
class Refined(ShortRepr):
    """Sub-pixel corners `(N, 2)` px, the half side of the window that found them, and their residual against a flat board."""

    corners_px: FloatArray
    window_half_px: int
    residual: GateResult


def refine(
    gray: Pixels,
    corners_px: FloatArray,
    board: Board,
    camera: Camera | None,
    options: GateOptions | None = None,
    visible: npt.NDArray[np.bool_] | None = None,
) -> Refined:
    """Sub-pixel positions of corners `(N, 2)` in the board's order, by the window that leaves the smallest residual.

    `gray` is uint8 (H, W). Corners that are not `visible` `(N,)` stay as they are.
    """
    seen = np.ones(len(corners_px), dtype=bool) if visible is None else visible
    part, origin = _around(gray, corners_px[seen], 2 * MAX_WINDOW_PX)
    grid, mask = corners_px.reshape(board.rows, board.columns, 2), seen.reshape(board.rows, board.columns)
    if is_slanted(grid, mask):
        cells = np.stack(np.meshgrid(np.arange(board.columns), np.arange(board.rows)), axis=-1).reshape(-1, 2)
        fitted = corners_px.copy()
        fitted[seen], half = fitted_corners(part, corners_px[seen] - origin, cells[seen].astype(np.float64))
        fitted[seen] += origin
        return Refined(fitted, half, board_residual(fitted, board, camera, options, seen))
    points = np.ascontiguousarray((corners_px[seen] - origin).reshape(-1, 1, 2), dtype=np.float32)
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-4)
    # Blurred by about a pixel, edges are sampled finely enough for their gradients: errors fall by a quarter on clean pictures.
    smooth = cv2.GaussianBlur(part.astype(np.float32), (0, 0), PRE_BLUR_PX)
    tried = []
    for half in _window_halves_px(corners_px, board, seen):
        moved = cv2.cornerSubPix(smooth, points.copy(), (half, half), (-1, -1), criteria)
        refined = corners_px.copy()
        refined[seen] = moved.reshape(-1, 2) + origin
        tried.append(Refined(refined, half, board_residual(refined, board, camera, options, seen)))
    return min(tried, key=lambda one: one.residual.rms_px)


def _around(gray: Pixels, points_px: FloatArray, margin_px: int) -> tuple[Pixels, FloatArray]:
    """The part of a picture around points `(N, 2)`, at least 1 px wide, and the place (2,) of its first pixel."""
    height, width = gray.shape
    low = np.floor(points_px.min(axis=0)) - margin_px
    high = np.ceil(points_px.max(axis=0)) + margin_px + 1
    left, top = (int(np.clip(value, 0, size - 1)) for value, size in zip(low, (width, height), strict=True))
    right, bottom = (
        int(np.clip(value, begin + 1, size))
        for value, begin, size in zip(high, (left, top), (width, height), strict=True)
    )
    return gray[top:bottom, left:right], np.array([left, top], dtype=np.float64)


def _window_halves_px(corners_px: FloatArray, board: Board, seen: npt.NDArray[np.bool_]) -> list[int]:
    """Half sides of the refinement windows to try, px, the largest first."""
    nearest = _nearest_step_px(corners_px, board, seen)
    halves = {int(np.clip(round(part * nearest), MIN_WINDOW_PX, MAX_WINDOW_PX)) for part in WINDOW_FRACTIONS}
    return sorted(halves, reverse=True)


def _nearest_step_px(corners_px: FloatArray, board: Board, seen: npt.NDArray[np.bool_]) -> float:
    """Smallest distance between two neighbouring corners that are both seen, px."""
    grid = corners_px.reshape(board.rows, board.columns, 2)
    mask = seen.reshape(board.rows, board.columns)
    steps = []
    for axis in (0, 1):
        both = mask.take(range(1, mask.shape[axis]), axis) & mask.take(range(mask.shape[axis] - 1), axis)
        steps.append(np.linalg.norm(np.diff(grid, axis=axis), axis=2)[both])
    joined = np.concatenate(steps)
    return float(joined.min()) if joined.size else float(MIN_WINDOW_PX)


def noise_covariances(
    gray: Pixels,
    corners_px: FloatArray,
    half: int,
    board: Board,
    visible: npt.NDArray[np.bool_] | None = None,
) -> FloatArray:
    """Covariance `(N, 2, 2)` px² of each corner from the picture's own noise and the gradients in its window; zero where not visible."""
    seen = np.ones(len(corners_px), dtype=bool) if visible is None else visible
    part, origin = _around(gray, corners_px[seen], 2 * MAX_WINDOW_PX)
    picture = part.astype(np.float32)
    gradient_u = cv2.Sobel(picture, cv2.CV_32F, 1, 0, scale=0.125)
    gradient_v = cv2.Sobel(picture, cv2.CV_32F, 0, 1, scale=0.125)
    side = (2 * half + 1, 2 * half + 1)
    pixels = np.rint(corners_px[seen] - origin).astype(int)
    pixels[:, 0] = np.clip(pixels[:, 0], 0, part.shape[1] - 1)
    pixels[:, 1] = np.clip(pixels[:, 1], 0, part.shape[0] - 1)
    tensor = np.empty((len(pixels), 2, 2))
    for (i, j), product in (
        ((0, 0), gradient_u * gradient_u),
        ((0, 1), gradient_u * gradient_v),
        ((1, 1), gradient_v * gradient_v),
    ):
        summed = cv2.boxFilter(product, -1, side, normalize=False)
        tensor[:, i, j] = tensor[:, j, i] = summed[pixels[:, 1], pixels[:, 0]]
    # A flat window has no information: a small ridge keeps its covariance large but finite.
    tensor += np.eye(2) * 1e-3
    reach = int(np.clip(0.2 * _nearest_step_px(corners_px, board, seen), 1, MAX_WINDOW_PX))
    covariances = np.zeros((len(corners_px), 2, 2))
    covariances[seen] = picture_noise_levels(gray, corners_px, board, seen, reach) ** 2 * np.linalg.inv(
        tensor
    )
    return covariances


def picture_noise_levels(
    gray: Pixels, corners_px: FloatArray, board: Board, seen: npt.NDArray[np.bool_], reach: int
) -> float:
    """Standard deviation of the picture's noise inside of the squares, grey levels, rounding included."""
    grid = corners_px.reshape(board.rows, board.columns, 2)
    mask = seen.reshape(board.rows, board.columns)
    whole = mask[:-1, :-1] & mask[1:, :-1] & mask[:-1, 1:] & mask[1:, 1:]
    middles = (0.25 * (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:]))[whole]
    deviations = []
    for u, v in np.rint(middles).astype(int):
        patch = gray[max(v - reach, 0) : v + reach + 1, max(u - reach, 0) : u + reach + 1].astype(np.float64)
        if patch.shape[0] < 3 or patch.shape[1] < 3:
            continue
        # Second differences remove shading; of white noise they have four times the variance.
        mixed = patch[1:, 1:] - patch[1:, :-1] - patch[:-1, 1:] + patch[:-1, :-1]
        deviations.append(np.sqrt(np.mean(mixed**2) / 4.0))
    noise = median(deviations) if deviations else 1.0
    return float(np.hypot(noise, QUANTISATION_LEVELS))


def scale_by_residual(
    covariances_px2: FloatArray, gate: GateResult, visible: npt.NDArray[np.bool_] | None = None
) -> FloatArray:
    """Covariances scaled by the view's `χ²/dof` where that is above 1 (residuals beyond the picture's
    noise), plus the floor."""
    floor = np.eye(2) * COMMON_FLOOR_PX**2
    if visible is not None:
        floor = floor * visible[:, None, None]
    if gate.degrees_of_freedom < MIN_FREEDOM or not np.isfinite(gate.rms_px):
        return covariances_px2 + floor
    seen = covariances_px2 if visible is None else covariances_px2[visible]
    chi2 = np.einsum("ni,nij,nj->", gate.residuals_px, np.linalg.inv(seen), gate.residuals_px)
    return covariances_px2 * max(1.0, float(chi2) / gate.degrees_of_freedom) + floor
