"""Is this grid a chessboard? A check by the squares' brightness alone, which needs no calibration.

At a right inner corner two opposite squares are dark and two are light. With the four samples s at a fraction of a square from the
corner, `score = ((s++ + s--) - (s+- + s-+)) / 2` is ± the board's contrast, with a sign that alternates from corner to corner. At the
edge of the printed pattern (a T of one dark and three light squares) it is half of that; within a square it is zero. So a grid that
is shifted by a row, skips a line, or belongs to a larger board shows itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ..medians import median
from .types import FloatArray, Pixels

# Samples lie at this fraction of a square from the corner, on the diagonals: far enough from the blurred edges, near enough to
# stay inside squares that are cut off or hidden further out.
SAMPLE_FRACTION = 0.3
# A right corner has relative contrast near 1 (0.6 in a steep gradient of light), a T at the pattern's edge 0.5: a line of corners is judged by
# its median, sharply, a single corner only on being none.
MIN_LINE_CONTRAST = 0.65
MIN_CORNER_CONTRAST = 0.35
# Grey levels of 255: less contrast than this is noise.
MIN_CONTRAST_LEVELS = 6.0
# A corner of an outer line shows the board's end where the two squares beyond it do: at these shares of a square outward, so far to each side of the edge between
# them, they differ by this part of what the two squares before it do there; at half of the line. A bit farther out the squares go on like that, or are cut off (many boards
# have half a square there), and then nothing differs by more than a share of it. What lies behind another pattern's end has edges of its own.
END_AT_SQUARES = (0.3, 0.4)
FARTHER_SQUARES = (0.6,)
END_BESIDE_SQUARES = 0.15
LEAST_END_CONTRAST = 0.5
CUT_OFF_CONTRAST = 0.2
LEAST_OF_END = 0.5


@dataclass(frozen=True)
class PatternCheck:
    """Verdict on a grid. `dark_first`: the square beyond grid corner (0, 0) is dark. `reason` is empty if it is a chessboard."""

    reason: str
    dark_first: bool


def check_pattern(gray: Pixels, grid: FloatArray) -> PatternCheck:
    """Checks that every corner of `grid` (ny, nx, 2) is a chessboard corner and that no further row follows.

    `gray` is float32 or uint8, (H, W).
    """
    relative, dark_first, contrast = corner_contrast(gray, grid)
    ny, nx = relative.shape
    if not np.isfinite(relative).all():
        return PatternCheck("the board is cut off by the picture's edge", False)
    if contrast < MIN_CONTRAST_LEVELS:
        return PatternCheck(
            f"the squares have too little contrast: {contrast:.1f} of 255 levels, needed {MIN_CONTRAST_LEVELS:.0f}",
            False,
        )
    reason = bad_line(relative) or _bad_corner(relative)
    if reason:
        return PatternCheck(reason, dark_first)
    side = goes_on_beyond(gray, grid, dark_first)
    if side:
        return PatternCheck(
            f"the chessboard goes on beyond the grid's {side}: a board with more than {nx} × {ny} inner corners, or a grid shifted by a row",
            dark_first,
        )
    return PatternCheck(ends_elsewhere(gray, grid, np.ones((ny, nx), dtype=bool)), dark_first)


def corner_contrast(gray: Pixels, grid: FloatArray) -> tuple[FloatArray, bool, float]:
    """Contrast of four squares at each point of a grid (ny, nx, 2), relative to the light there, NaN outside of the picture; whether the square beyond (0, 0)
    is dark; the median of the contrast, grey levels."""
    score, spread = saddle_contrast(gray, grid, np.gradient(grid, axis=1), np.gradient(grid, axis=0))
    ny, nx = score.shape
    signed = score * (1.0 - 2.0 * ((np.arange(ny)[:, None] + np.arange(nx)[None, :]) % 2))
    inside = signed[np.isfinite(signed)]
    if not inside.size:
        return signed, False, 0.0
    sign = float(np.sign(median(inside)))
    relative: FloatArray = signed * sign / np.maximum(spread, MIN_CONTRAST_LEVELS)
    return relative, sign < 0.0, median(np.abs(inside))


def saddle_contrast(
    gray: Pixels, at: FloatArray, along_x: FloatArray, along_y: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Saddle contrast of points given with their local grid steps, and the spread of its four samples, grey levels.

    Their ratio is ±1 for a saddle and ±0.5 for a T, whatever the light there. NaN where a sample leaves the picture.
    """
    samples = square_samples(gray, at, along_x, along_y)
    score = 0.5 * (samples[0] + samples[1] - samples[2] - samples[3])
    return score, samples.max(axis=0) - samples.min(axis=0)


def square_samples(gray: Pixels, at: FloatArray, along_x: FloatArray, along_y: FloatArray) -> FloatArray:
    """The grey levels (4, …) of the squares around points given with their local grid steps, each opposite one after the other; NaN outside of the picture."""
    diagonals = (along_x + along_y, -along_x - along_y, along_x - along_y, along_y - along_x)
    return sample(gray, at + SAMPLE_FRACTION * np.stack(diagonals))


@dataclass(frozen=True, eq=False)
class _Side:
    """A grid's side: its name, the grid turned so that its outer line is the first row, and whether the square beyond that row's first corner is as the one beyond
    (0, 0), which is dark or light."""

    name: str
    turned: npt.NDArray[Any]
    like_first: bool


def _sides(grid: npt.NDArray[Any]) -> tuple[_Side, ...]:
    """The four sides of a grid (ny, nx, …)."""
    ny, nx = grid.shape[:2]
    across = grid.swapaxes(0, 1)
    return (
        _Side("first row", grid, True),
        _Side("last row", grid[::-1], ny % 2 == 0),
        _Side("first column", across, True),
        _Side("last column", across[::-1], nx % 2 == 0),
    )


def ends_elsewhere(gray: Pixels, grid: FloatArray, seen: npt.NDArray[np.bool_]) -> str:
    """Reason if the squares beyond an outer line of a grid (ny, nx, 2) do not show at half of its corners, of which `seen` (ny, nx) are no guess: another pattern,
    which lies over the board, may end there."""
    for side, shown in zip(_sides(grid), _sides(seen), strict=True):
        ends = _shows_end(gray, side.turned)
        known = np.isfinite(ends)
        told = int((shown.turned[0] & (ends == 1.0)).sum())
        if known.mean() >= LEAST_OF_END and told < LEAST_OF_END * known.sum():
            return (
                f"the squares beyond the grid's {side.name} show at {told} of its {known.size} corners: the board may end elsewhere; something hides it, or another pattern "
                "lies over it; take it away"
            )
    return ""


def _shows_end(gray: Pixels, grid: FloatArray) -> FloatArray:
    """Whether (1 or 0, (nx,)) the squares beyond each corner of a grid's first row show; NaN outside of the picture.

    The corner is looked for one step beyond the second row: what is no corner of this pattern may have drawn the first row's to itself.
    """
    if len(grid) > 3:
        # The steps of a tilted board change from square to square.
        out = 2.0 * grid[1] - 3.0 * grid[2] + grid[3]
    else:
        out = grid[1] - grid[2] if len(grid) > 2 else grid[0] - grid[1]
    corner, aside = grid[1] + out, END_BESIDE_SQUARES * np.gradient(grid[1], axis=0)

    shares = np.array([-SAMPLE_FRACTION, *END_AT_SQUARES, *FARTHER_SQUARES])
    at = corner + shares[:, None, None] * out
    one, other = sample(gray, np.stack([at + aside, at - aside]))
    differences = one - other
    # Positive where they go on as the squares before the corner do, in units of what these do along the line: a blur makes less of both.
    before = differences[:1]
    known = before[np.isfinite(before)]
    sign, size = -np.sign(before), max(median(np.abs(known)) if known.size else 0.0, MIN_CONTRAST_LEVELS)
    near, far = np.split(sign * differences[1:] / size, [len(END_AT_SQUARES)])
    goes_on = (far > LEAST_END_CONTRAST) | ~(np.abs(far) > CUT_OFF_CONTRAST)
    told = np.all(near > LEAST_END_CONTRAST, axis=0) & np.all(goes_on, axis=0)
    result: FloatArray = np.where(np.isfinite(near).all(axis=0), told, np.nan)
    return result


def sample(gray: Pixels, at: FloatArray) -> FloatArray:
    """Bilinear samples at `(…, 2)` pixels; NaN outside of the picture."""
    height, width = gray.shape[:2]
    u, v = at[..., 0], at[..., 1]
    inside = (u >= 0.0) & (v >= 0.0) & (u <= width - 1.0) & (v <= height - 1.0)
    shape = u.shape
    map_u = np.ascontiguousarray(np.where(inside, u, 0.0).reshape(-1, 1), dtype=np.float32)
    map_v = np.ascontiguousarray(np.where(inside, v, 0.0).reshape(-1, 1), dtype=np.float32)
    values = cv2.remap(gray, map_u, map_v, cv2.INTER_LINEAR).astype(np.float64).reshape(shape)
    return np.where(inside, values, np.nan)


def bad_line(relative: FloatArray) -> str:
    """Reason if a whole row or column is not one of chessboard corners (NaN: hidden): the sign of a shifted grid."""
    for name, axis in (("row", 1), ("column", 0)):
        # A line that is completely hidden gives no information.
        known = [line[np.isfinite(line)] for line in (relative if axis == 1 else relative.T)]
        medians = np.array([median(line) if line.size else 1.0 for line in known])
        worst = int(np.argmin(medians))
        if medians[worst] < MIN_LINE_CONTRAST:
            return (
                f"{name} {worst} of the grid does not lie where four squares meet (contrast {medians[worst]:.2f} of a corner's, needed "
                f"{MIN_LINE_CONTRAST}): a grid shifted by a {name}, or a board with fewer corners"
            )
    return ""


def _bad_corner(relative: FloatArray) -> str:
    """Reason if a single point is no corner: hidden, or in a broken grid."""
    bad = int((relative < MIN_CORNER_CONTRAST).sum())
    if bad == 0:
        return ""
    return (
        f"{bad} of {relative.size} grid points do not lie where four squares meet (worst: contrast {relative.min():.2f} of a corner's, needed "
        f"{MIN_CORNER_CONTRAST}): a broken grid, or a hidden board"
    )


def goes_on_beyond(gray: Pixels, grid: FloatArray, dark_first: bool) -> str:
    """Name of the side beyond which another full row of chessboard corners follows, or an empty string."""
    for side in _sides(grid):
        turned = side.turned
        out, along = np.gradient(turned, axis=0)[0], np.gradient(turned, axis=1)[0]
        score, spread = saddle_contrast(gray, turned[0] - out, along, out)
        sign = 1.0 if dark_first == side.like_first else -1.0
        relative = (
            score * sign * (1.0 - 2.0 * (np.arange(len(score)) % 2)) / np.maximum(spread, MIN_CONTRAST_LEVELS)
        )
        finite = relative[np.isfinite(relative)]
        if len(finite) >= 3 and median(finite) > MIN_LINE_CONTRAST:
            return side.name
    return ""
