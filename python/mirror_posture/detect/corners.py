"""Sub-pixel chessboard corners and what their noise is.

Position: the point q at which every gradient in a window around it is perpendicular to the direction from q (`cv2.cornerSubPix`,
Förstner's condition). A large window averages more of the picture's noise, a small one suffers less from bent edges (lens, paper) and
from light that changes across the squares: several are tried, and the one whose corners fit a flat board best is kept.

Covariance: `σ² (Σ g gᵀ)⁻¹` over the window, the bound for a shift of a known pattern with gradients g under white noise σ; σ is
read from the flat middles of the squares. A view's residual against the flat board then scales all of them where it is larger than
that bound explains (aliasing, compression, ghosts).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from .gate import GateOptions, GateResult, board_residual
from .types import BoardSpec, CameraSpec, FloatArray

# The windows' half sides as fractions of the distance to the nearest neighbour: the next corners' edges stay outside of them.
WINDOW_FRACTIONS = (0.5, 0.35, 0.25, 0.16)
MIN_WINDOW_PX = 2
MAX_WINDOW_PX = 15
# Standard deviation of rounding to whole grey levels.
QUANTISATION_LEVELS = 1.0 / np.sqrt(12.0)
# The residual of a view must show at least this many degrees of freedom to scale the covariances.
MIN_FREEDOM = 8


@dataclass(frozen=True)
class RefinedGrid:
    """Sub-pixel corners (ny, nx, 2) px, the half side of the window that found them, and their residual against a flat board."""

    grid: FloatArray
    window_half_px: int
    residual: GateResult


def window_halves_px(grid: FloatArray) -> list[int]:
    """Half sides of the refinement windows to try for a grid (ny, nx, 2), px, the largest first."""
    along_x = np.linalg.norm(np.diff(grid, axis=1), axis=2)
    along_y = np.linalg.norm(np.diff(grid, axis=0), axis=2)
    nearest = min(float(along_x.min()), float(along_y.min()))
    halves = {int(np.clip(round(part * nearest), MIN_WINDOW_PX, MAX_WINDOW_PX)) for part in WINDOW_FRACTIONS}
    return sorted(halves, reverse=True)


def refine(
    gray: FloatArray,
    grid: FloatArray,
    board: BoardSpec,
    camera: CameraSpec | None,
    options: GateOptions | None = None,
) -> RefinedGrid:
    """Sub-pixel positions of the grid's corners by the window that leaves the smallest residual. `gray` is uint8 (H, W)."""
    points = np.ascontiguousarray(grid.reshape(-1, 1, 2), dtype=np.float32)
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-4)
    tried = []
    for half in window_halves_px(grid):
        refined = (
            cv2.cornerSubPix(gray, points.copy(), (half, half), (-1, -1), criteria)
            .astype(np.float64)
            .reshape(grid.shape)
        )
        tried.append(
            RefinedGrid(refined, half, board_residual(refined.reshape(-1, 2), board, camera, options))
        )
    return min(tried, key=lambda one: one.residual.rms_px)


def noise_covariances(gray: FloatArray, grid: FloatArray, half: int) -> FloatArray:
    """Covariance `(N, 2, 2)` px² of each corner from the picture's own noise and the gradients in its window."""
    picture = gray.astype(np.float32)
    gradient_u = cv2.Sobel(picture, cv2.CV_32F, 1, 0, scale=0.125)
    gradient_v = cv2.Sobel(picture, cv2.CV_32F, 0, 1, scale=0.125)
    side = (2 * half + 1, 2 * half + 1)
    pixels = np.rint(grid.reshape(-1, 2)).astype(int)
    pixels[:, 0] = np.clip(pixels[:, 0], 0, gray.shape[1] - 1)
    pixels[:, 1] = np.clip(pixels[:, 1], 0, gray.shape[0] - 1)
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
    return picture_noise_levels(gray, grid) ** 2 * np.linalg.inv(tensor)


def picture_noise_levels(gray: FloatArray, grid: FloatArray) -> float:
    """Standard deviation of the picture's noise inside of the squares, grey levels, rounding included."""
    middles = 0.25 * (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:])
    step = min(float(np.linalg.norm(np.diff(grid, axis=axis), axis=2).min()) for axis in (0, 1))
    reach = int(np.clip(0.2 * step, 1, MAX_WINDOW_PX))
    deviations = []
    for u, v in np.rint(middles.reshape(-1, 2)).astype(int):
        patch = gray[max(v - reach, 0) : v + reach + 1, max(u - reach, 0) : u + reach + 1].astype(np.float64)
        if patch.shape[0] < 3 or patch.shape[1] < 3:
            continue
        # Second differences remove shading; white noise has variance 4 in (1, −1; −1, 1).
        mixed = patch[1:, 1:] - patch[1:, :-1] - patch[:-1, 1:] + patch[:-1, :-1]
        deviations.append(np.sqrt(np.mean(mixed**2) / 4.0))
    noise = float(np.median(deviations)) if deviations else 1.0
    return float(np.hypot(noise, QUANTISATION_LEVELS))


def scale_by_residual(covariances_px2: FloatArray, gate: GateResult) -> FloatArray:
    """Covariances scaled by the view's `χ²/dof` where that is above 1: what the residual shows beyond the picture's noise."""
    if gate.degrees_of_freedom < MIN_FREEDOM or not np.isfinite(gate.rms_px):
        return covariances_px2
    chi2 = np.einsum("ni,nij,nj->", gate.residuals_px, np.linalg.inv(covariances_px2), gate.residuals_px)
    return covariances_px2 * max(1.0, float(chi2) / gate.degrees_of_freedom)
