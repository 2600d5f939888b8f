"""A chessboard with a few hidden corners (a thumb, a cable, a spot of glare): the others are read, and the
hidden ones are reported.

The board's ends must be certain, because a grid that is shifted by a row reprojects as well: half of each
outer row and column must be visible. The edge of an occluding object displaces a corner by pixels, so
corners that deviate from the flat board of the others count as hidden too.
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
from . import corners, pattern
from .gate import MIN_CORNERS_FOR_CUBIC, GateOptions, GateResult, board_residual, cubic_basis
from .types import BoardView, FloatArray, Pixels

# Least contrast of four squares at a corner that is taken as seen: 1 is whole, at the edge of a pattern it is 0.5, which a line's median tells (`pattern`).
SEEN_CONTRAST = 0.55
# Least share of the corners, and of each outer row and column, that must be seen.
LEAST_SEEN = 0.8
LEAST_SEEN_OF_OUTER_LINE = 0.5
# A corner is taken as hidden if what its removal takes from the sum of squares is this many times the variance of the others (chi-square of two freedoms: one of
# three million is beyond), and if it lies this far from where the others have it, as a share of a square: what hides a corner draws it by a tenth of a square and
# more, and a lens that the camera file describes badly, or none describes, bends the board's edges by less.
STANDS_OUT = 30.0
STANDS_OUT_SQUARES = 0.04
STANDS_OUT_SQUARES_WITHOUT_CAMERA = 0.1
# ... beside a hidden corner this, px.
LEAST_BESIDE_PX = 0.15
# Corners that are left out one by one, at most.
MOST_OUTLIERS = 12
# Median of chi-square of two freedoms.
MEDIAN_CHI2 = 2.0 * np.log(2.0)
# Fewer corners show no outlier given a homography's 8 degrees of freedom.
LEAST_CORNERS_TO_JUDGE = 12
# Least median of the contrast where four squares meet: a chessboard's is near 1, that of gingham's three shades about 0.7.
LEAST_TYPICAL_CONTRAST = 0.8
# What is hidden lies to a side if it is off the board's middle by this share of its size.
TO_A_SIDE = 0.15


@dataclass(frozen=True, eq=False, repr=False)
class PartlySeen(ShortRepr):
    """A grid `(ny, nx, 2)` px, of which the corners `seen` `(ny, nx)` are measured and the others are where the flat board has them; `reason` says why it cannot be used."""

    grid: FloatArray
    seen: npt.NDArray[np.bool_]
    dark_first: bool
    window_half_px: int
    reason: str


def read_partly_seen(
    gray: Pixels,
    grid: FloatArray,
    shown: npt.NDArray[np.bool_],
    board: Board,
    camera: Camera | None,
    options: GateOptions,
) -> PartlySeen:
    """Refines the corners of a grid `(ny, nx, 2)` px that show, at first those that are `shown` `(ny, nx)`, and checks them."""
    flat, refined = _refined(gray, grid.reshape(-1, 2), shown.ravel(), board, camera, options)
    relative, dark_first, contrast = pattern.corner_contrast(gray, flat.reshape(grid.shape))
    with np.errstate(invalid="ignore"):
        seen = (relative > SEEN_CONTRAST).ravel()
    reason = "" if contrast >= pattern.MIN_CONTRAST_LEVELS else "the squares have too little contrast"
    reason = reason or _too_few(flat, seen.reshape(shown.shape))
    if not reason:
        flat, refined = _refined(gray, flat, seen, board, camera, options)
        kept = without_outliers(flat, seen, board, camera, options)
        if not np.array_equal(kept, seen):
            seen = kept
            flat, refined = _refined(gray, flat, seen, board, camera, options)
        beyond = pattern.goes_on_beyond(gray, flat.reshape(grid.shape), dark_first)
        reason = (
            _too_few(flat, seen.reshape(shown.shape))
            or pattern.bad_line(np.where(seen.reshape(shown.shape), relative, np.nan))
            or (f"the chessboard goes on beyond the grid's {beyond}" if beyond else "")
            or _another_pattern(relative.ravel()[seen])
            or pattern.ends_elsewhere(gray, flat.reshape(grid.shape), seen.reshape(shown.shape))
            or refined.residual.reason
        )
    return PartlySeen(
        flat.reshape(grid.shape),
        seen.reshape(shown.shape),
        dark_first,
        refined.window_half_px,
        reason,
    )


def where_hidden(corners_px: FloatArray, seen: npt.NDArray[np.bool_]) -> str:
    """Where in the picture the hidden corners are, of corners `(N, 2)` px with mask `(N,)`: for example
    "upper left" of the board."""
    low, high = corners_px.min(axis=0), corners_px.max(axis=0)
    off = (corners_px[~seen].mean(axis=0) - 0.5 * (low + high)) / np.maximum(high - low, 1e-9)
    words = (
        "upper" if off[1] < -TO_A_SIDE else "lower" if off[1] > TO_A_SIDE else "",
        "left" if off[0] < -TO_A_SIDE else "right" if off[0] > TO_A_SIDE else "",
    )
    return " ".join(word for word in words if word) or "middle"


def _another_pattern(contrast: FloatArray) -> str:
    """Reason if squares of more than two shades meet at the corners that are seen."""
    typical = median(contrast)
    if typical >= LEAST_TYPICAL_CONTRAST:
        return ""
    return f"squares of more than two shades (contrast {typical:.2f} of a corner's, needed {LEAST_TYPICAL_CONTRAST}): a part of another pattern"


def told_hidden(view: BoardView, board: Board) -> str:
    """The description of a view's hidden corners: how many, and where in the picture; empty if all are
    seen."""
    if not view.ok or view.corners_px is None or view.visible is None or view.visible.all():
        return ""
    flat = _by_those_seen(view.corners_px, view.visible, board)
    if flat is None:
        return ""
    where = where_hidden(flat, view.visible)
    hidden = int((~view.visible).sum())
    return f"{hidden} of the board's {len(flat)} corners {'is' if hidden == 1 else 'are'} hidden, at its {where} in the picture ({view.via}); the others are measured"


def _refined(
    gray: Pixels,
    flat: FloatArray,
    seen: npt.NDArray[np.bool_],
    board: Board,
    camera: Camera | None,
    options: GateOptions,
) -> tuple[FloatArray, corners.Refined]:
    """Corners `(N, 2)`, refined where they are seen and elsewhere from the others' homography."""
    refined = corners.refine(gray, flat, board, camera, options, seen)
    by_others = _by_those_seen(refined.corners_px, seen, board)
    result = refined.corners_px.copy()
    if by_others is not None:
        result[~seen] = by_others[~seen]
    return result, refined


def _by_those_seen(corners_px: FloatArray, seen: npt.NDArray[np.bool_], board: Board) -> FloatArray | None:
    """All corners `(N, 2)` px where the homography of those that are seen `(N,)` has them; None where these give none."""
    plane = board.corner_in_board_m[:, :2] / board.square_m
    homography, _ = cv2.findHomography(plane[seen], corners_px[seen])
    if homography is None or not np.isfinite(homography).all():
        return None
    result: FloatArray = cv2.perspectiveTransform(plane[None], homography)[0]
    return result


def without_outliers(
    flat: FloatArray,
    seen: npt.NDArray[np.bool_],
    board: Board,
    camera: Camera | None,
    options: GateOptions,
    residual: GateResult | None = None,
) -> npt.NDArray[np.bool_]:
    """The corners `(N,)` that are seen, without outliers of the others' flat board; all of them where more
    are outliers than may be hidden. `residual`: of those that are seen, where it is known."""
    kept = seen.copy()
    grid = flat.reshape(board.rows, board.columns, 2)
    sides = [median(np.linalg.norm(np.diff(grid, axis=axis), axis=2)) for axis in (0, 1)]
    least_px = min(sides) * (STANDS_OUT_SQUARES_WITHOUT_CAMERA if camera is None else STANDS_OUT_SQUARES)
    for _ in range(MOST_OUTLIERS):
        if kept.sum() <= LEAST_CORNERS_TO_JUDGE:
            break
        taken, away_px = _without_each(flat, kept, board, camera, options, residual)
        residual = None
        limit = STANDS_OUT * median(taken) / MEDIAN_CHI2
        taken[away_px < np.where(_beside_hidden(kept, board), LEAST_BESIDE_PX, least_px)] = 0.0
        farthest = int(taken.argmax())
        if taken[farthest] <= limit:
            break
        others = kept.copy()
        others[np.flatnonzero(kept)[farthest]] = False
        kept = others
    return seen if _too_few(flat, kept.reshape(board.rows, board.columns)) else kept


def _beside_hidden(kept: npt.NDArray[np.bool_], board: Board) -> npt.NDArray[np.bool_]:
    """Which of the kept corners `(K,)` are adjacent to one that is not kept."""
    hidden = (~kept).reshape(board.rows, board.columns).astype(np.uint8)
    near: npt.NDArray[np.bool_] = cv2.dilate(hidden, np.ones((3, 3), np.uint8)).ravel()[kept] > 0
    return near


def _without_each(
    flat: FloatArray,
    kept: npt.NDArray[np.bool_],
    board: Board,
    camera: Camera | None,
    options: GateOptions,
    residual: GateResult | None = None,
) -> tuple[FloatArray, FloatArray]:
    """The reduction of the sum of squares without each of the kept corners `(K,)`, px², and the distance of
    each from its place by the others, px.

    Both are exact in linear models: r'(1 - H)⁻¹ r and |(1 - H)⁻¹ r|, with the residual r and the 2 × 2
    block H of the projection on the motions of a flat board. At the board's corners a homography follows a
    single wrong corner by more than half, and the residual alone would hide it.
    """
    residuals = (residual or board_residual(flat, board, camera, options, kept)).residuals_px
    count = len(residuals)
    if not np.isfinite(residuals).all():
        return np.zeros(count), np.zeros(count)
    scaled = flat[kept] - flat[kept].mean(axis=0)
    u, v = scaled.T / max(float(np.abs(scaled).max()), 1e-9)
    one, none = np.ones(count), np.zeros(count)
    design = np.zeros((2, count, 8))
    design[0] = np.column_stack([one, u, v, none, none, none, u * u, u * v])
    design[1] = np.column_stack([none, none, none, one, u, v, u * v, v * v])
    if camera is None and count >= MIN_CORNERS_FOR_CUBIC:
        basis = cubic_basis(board.corner_in_board_m[kept, :2])
        design = np.concatenate(
            [design, np.stack([basis, 0.0 * basis]), np.stack([0.0 * basis, basis])], axis=2
        )
    across, values, _ = np.linalg.svd(design.reshape(2 * count, -1), full_matrices=False)
    span = across[:, values > 1e-9 * values[0]].reshape(2, count, -1)
    left = np.eye(2) - np.einsum("anp,bnp->nab", span, span)
    alone = np.linalg.solve(left + 1e-6 * np.eye(2), residuals[..., None])[..., 0]
    return np.einsum("na,na->n", residuals, alone), np.linalg.norm(alone, axis=1)


def _too_few(flat: FloatArray, seen: npt.NDArray[np.bool_]) -> str:
    outer = (seen[0], seen[-1], seen[:, 0], seen[:, -1])
    if seen.mean() >= LEAST_SEEN and min(line.mean() for line in outer) >= LEAST_SEEN_OF_OUTER_LINE:
        return ""
    return (
        f"{int((~seen).sum())} of the board's {seen.size} corners are hidden, at its {where_hidden(flat, seen.ravel())} in the picture; needed "
        f"{100.0 * LEAST_SEEN:.0f} % of them, and half of each outer row and column: move away what hides them"
    )
