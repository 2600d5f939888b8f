"""Crossings of squares arranged as a grid: the board's own, with some hidden, or a grid of other objects.

A full detector takes ten to seventy milliseconds on a keyboard or a tiled wall, and refuses a board with
one hidden corner. Crossings joined step by step show both at once: which of them are the board's, and
whether there can be a board at all.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from ..board import Board
from ..medians import median
from . import pattern
from .places import OPPOSITE_COSINE, Place
from .types import FloatArray, Pixels

# A crossing is the next of the grid if it lies within this share of a step of where it is expected.
NEXT_SHARE = 0.3
# How much of a step is taken from the last one found; crossings are known to a pixel.
NEW_STEP_SHARE = 0.5
# The first two steps of a grid make at least this sine.
LEAST_SINE = 0.4
# Fewer joined crossings are no grid.
LEAST_JOINED = 6
# Number of grids of one place that are examined.
MOST_LATTICES = 6
# Number of nearest crossings of the opposite orientation that are examined as neighbours.
NEXT_LOOKED_AT = 8
# Crossings that are tried as a grid's first, the best joined.
SEEDS_TRIED = 4
# Lines beyond the joined ones that are examined: for a board seen at a slant the far columns are too close
# together to be joined.
LINES_AROUND = 3
# Contrast of four squares at a crossing, relative to the light there: 1 where four squares meet, 0.5 at the edge of a pattern (`pattern`).
CORNER_CONTRAST = 0.65
SOME_CONTRAST = 0.55
# A board may be there if at this share of its corners four squares may meet, this share was joined, and this of each of its outer lines shows.
LEAST_SHOWN = 0.7
LEAST_SHOWN_AND_JOINED = 0.6
LEAST_SURE = 0.5
LEAST_OF_OUTER_LINE = 0.34
# A lattice with less than this share within this many squares of a flat grid was joined across two objects.
FLAT_SHARE = 0.93
FLAT_SQUARES = 0.3
# Fours of crossings that are drawn to find it: of a board and as much again of other things one in sixteen is the board's own.
MOST_DRAWS = 100
# Columns by which rows may have been joined to the wrong neighbours, an even number since colours alternate
# along a row; cells straightened in that way fill more of their rows and columns, by this factor.
SHIFTS = (-4, -2, 2, 4)
STRAIGHTER = 1.2
# A grid goes on where four squares meet at this share of a line beyond it.
GOES_ON = 0.7
GOES_ON_AROUND = 0.4


@dataclass(frozen=True)
class Reading:
    """The grids of a place's crossings: whole grids `(ny, nx, 2)` px, grids with hidden corners, with a
    mask `(ny, nx)`, and whether there are any."""

    whole: tuple[FloatArray, ...]
    partly: tuple[tuple[FloatArray, npt.NDArray[np.bool_]], ...]
    may_hold: bool

    def most_shown(self) -> float:
        """The largest share of a grid's corners that surely show."""
        return 1.0 if self.whole else max((float(shown.mean()) for _, shown in self.partly), default=0.0)


@dataclass(frozen=True)
class _Lattice:
    """Crossings with their columns and rows."""

    members: npt.NDArray[np.intp]
    cells: npt.NDArray[np.intp]


@dataclass(frozen=True)
class _Lines:
    """A lattice with the lines around it: places (rows, columns, 2) px, for each whether a crossing was found there, and the contrast of four squares there."""

    at: FloatArray
    joined: npt.NDArray[np.bool_]
    contrast: FloatArray


def read_crossings(gray: Pixels, place: Place, board: Board) -> Reading:
    """Grids of the board's counts among a place's crossings. `gray` is the picture in the size in which they were seen."""
    whole: list[FloatArray] = []
    partly: list[tuple[FloatArray, npt.NDArray[np.bool_]]] = []
    for lattice in _lattices(place, board.corner_count):
        if len(lattice.members) < LEAST_SHOWN_AND_JOINED * board.corner_count:
            continue
        windows: list[tuple[FloatArray, npt.NDArray[np.bool_]]] = []
        for cells in _straightened(lattice.cells):
            lines = _lines(gray, place.crossings_px[lattice.members], cells, place.scale)
            if lines is not None:
                windows.extend(_windows(lines, board))
        whole.extend(grid for grid, shown in windows if shown.all())
        partly.extend((grid, shown) for grid, shown in windows if not shown.all())
    partly.sort(key=lambda one: -int(one[1].sum()))
    return Reading(tuple(whole), tuple(partly), bool(whole or partly))


def _straightened(cells: npt.NDArray[np.intp]) -> list[npt.NDArray[np.intp]]:
    """A lattice's cells as they were joined, and as rows and columns where they fill a slanted band: at a
    slant, the nearest crossing of the opposite orientation across a row may be two columns further, so each
    row begins two columns beside the previous one."""
    best, fullest = cells, _filled(cells)
    for axis in (0, 1):
        for shift in SHIFTS:
            moved = cells.copy()
            moved[:, axis] += shift * cells[:, 1 - axis]
            filled = _filled(moved)
            if filled > STRAIGHTER * fullest:
                best, fullest = moved, filled
    return [cells] if best is cells else [cells, best]


def _filled(cells: npt.NDArray[np.intp]) -> float:
    """The share of the rows and columns around cells that they fill."""
    columns, rows = np.ptp(cells, axis=0) + 1
    return float(len(cells) / (columns * rows))


def _lattices(place: Place, corner_count: int) -> Iterator[_Lattice]:
    """Grids of a place's crossings, from the best joined crossing on."""
    beside = _beside(place)
    fresh = np.ones(len(place.crossings_px), dtype=bool)
    for _ in range(MOST_LATTICES):
        start = _start(place, fresh)
        if start is None:
            return
        seed, steps = start
        lattice = _grown(place, beside, fresh, seed, steps)
        fresh[lattice.members] = False
        if len(lattice.members) < LEAST_JOINED:
            continue
        yield lattice
        if len(lattice.members) < corner_count:
            continue
        flat = _flat_part(place, lattice)
        if LEAST_JOINED <= flat.sum() < FLAT_SHARE * len(flat):
            # Joined across two objects: the rest is examined separately.
            fresh[lattice.members[~flat]] = True
            yield _Lattice(lattice.members[flat], lattice.cells[flat])


def _flat_part(place: Place, lattice: _Lattice) -> npt.NDArray[np.bool_]:
    """Which of a lattice's crossings lie where the largest flat grid among them has its cells."""
    at = place.crossings_px[lattice.members]
    _, inside = cv2.findHomography(
        lattice.cells.astype(np.float64),
        at,
        cv2.RANSAC,
        FLAT_SQUARES * place.step_px(),
        maxIters=MOST_DRAWS,
    )
    if inside is None:
        return np.ones(len(at), dtype=bool)
    flat: npt.NDArray[np.bool_] = inside.ravel() > 0
    return flat


def _beside(place: Place) -> npt.NDArray[np.intp]:
    """The nearest crossings (N, K) that are turned against each, which may be its neighbours along the grid."""
    u, v = place.crossings_px.T.astype(np.float32)
    squares = (u[:, None] - u[None]) ** 2 + (v[:, None] - v[None]) ** 2
    axis = place.axis.astype(np.float32)
    squares[axis @ axis.T > OPPOSITE_COSINE] = np.inf
    most = min(NEXT_LOOKED_AT, len(u))
    nearest: npt.NDArray[np.intp] = np.argpartition(squares, most - 1, axis=1)[:, :most]
    # Turned the same way: no neighbour, and out of reach for what follows.
    return np.where(np.isfinite(np.take_along_axis(squares, nearest, axis=1)), nearest, -1)


def _start(place: Place, fresh: npt.NDArray[np.bool_]) -> tuple[int, FloatArray] | None:
    """A crossing with links both ways, and its steps (2, 2) along columns and rows."""
    mine, other = place.links
    open_links = fresh[mine] & fresh[other]
    counts = np.bincount(mine[open_links], minlength=len(fresh))
    for seed in np.argsort(-counts, kind="stable")[:SEEDS_TRIED]:
        if counts[seed] < 2:
            return None
        steps = place.crossings_px[other[open_links & (mine == seed)]] - place.crossings_px[seed]
        away = np.hypot(steps[:, 0], steps[:, 1])
        first = int(np.argmin(away))
        sine = np.abs(steps[:, 0] * steps[first, 1] - steps[:, 1] * steps[first, 0]) / (away * away[first])
        across = np.flatnonzero(sine > LEAST_SINE)
        if len(across):
            second = int(across[np.argmin(away[across])])
            return int(seed), np.array([steps[first], steps[second]])
    return None


def _grown(
    place: Place,
    beside: npt.NDArray[np.intp],
    fresh: npt.NDArray[np.bool_],
    seed: int,
    steps: FloatArray,
) -> _Lattice:
    """Crossings joined to the seed, one step from those joined before, starting at the nearest."""
    # Plain numbers: a board has some thirty crossings with eight neighbours each, too few for arrays to be
    # faster.
    at: list[list[float]] = place.crossings_px.tolist()
    near: list[list[int]] = beside.tolist()
    free: list[bool] = fresh.tolist()
    free[seed] = False
    step = {seed: steps.tolist()}
    cell = {seed: (0, 0)}
    taken = {(0, 0)}
    members = [seed]
    for one in members:
        u, v = at[one]
        column, row = cell[one]
        for along, sign, target_cell in (
            (0, 1.0, (column + 1, row)),
            (1, 1.0, (column, row + 1)),
            (0, -1.0, (column - 1, row)),
            (1, -1.0, (column, row - 1)),
        ):
            if target_cell in taken:
                continue
            ahead_u, ahead_v = step[one][along]
            wanted_u, wanted_v = u + sign * ahead_u, v + sign * ahead_v
            least, target = NEXT_SHARE**2 * (ahead_u**2 + ahead_v**2), -1
            for other in near[one]:
                away = (at[other][0] - wanted_u) ** 2 + (at[other][1] - wanted_v) ** 2
                if away < least and other >= 0 and free[other]:
                    least, target = away, other
            if target < 0:
                continue
            taken.add(target_cell)
            free[target] = False
            cell[target] = target_cell
            new = list(step[one])
            new[along] = [
                ahead_u + NEW_STEP_SHARE * (sign * (at[target][0] - u) - ahead_u),
                ahead_v + NEW_STEP_SHARE * (sign * (at[target][1] - v) - ahead_v),
            ]
            step[target] = new
            members.append(target)
    return _Lattice(np.array(members), np.array([cell[one] for one in members]))


def _lines(gray: Pixels, at: FloatArray, cells: npt.NDArray[np.intp], scale: float) -> _Lines | None:
    """The lattice with a few more lines on each side, its holes filled by its homography, and the contrast
    of the picture there."""
    low = cells.min(axis=0) - LINES_AROUND
    columns, rows = cells.max(axis=0) + LINES_AROUND + 1 - low
    homography, _ = cv2.findHomography((cells - low).astype(np.float64), at)
    if homography is None:
        return None
    index = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).astype(np.float64)
    halves = np.array([[0.0, 0.0], [0.5, 0.0], [-0.5, 0.0], [0.0, 0.5], [0.0, -0.5]])
    seen = cv2.perspectiveTransform(halves[:, None] + index.reshape(-1, 2), homography)
    grid = seen.reshape(5, rows, columns, 2)
    places = grid[0].copy()
    joined = np.zeros((rows, columns), dtype=bool)
    column, row = (cells - low).T
    places[row, column] = at
    joined[row, column] = True
    # In the size in which the crossings were seen: noise is averaged, and squares are still some pixels large.
    score, spread = pattern.saddle_contrast(
        gray, (places + 0.5) * scale - 0.5, scale * (grid[1] - grid[2]), scale * (grid[3] - grid[4])
    )
    score = score * (1.0 - 2.0 * (index.sum(axis=-1) % 2.0))
    relative = score / np.maximum(spread, pattern.MIN_CONTRAST_LEVELS)
    relative *= (
        np.sign(median(relative[joined & np.isfinite(relative)]))
        if np.isfinite(relative[joined]).any()
        else 1.0
    )
    return _Lines(places, joined, np.where(np.isfinite(relative), relative, 0.0))


def _windows(lines: _Lines, board: Board) -> Iterator[tuple[FloatArray, npt.NDArray[np.bool_]]]:
    """Grids of the board's counts in a lattice, in both orientations, of which enough may be visible:
    places (ny, nx, 2), and which corners are certain."""
    for turned in (False, True):
        at = lines.at.transpose(1, 0, 2) if turned else lines.at
        joined = lines.joined.T if turned else lines.joined
        contrast = lines.contrast.T if turned else lines.contrast
        if joined.shape[0] < board.rows or joined.shape[1] < board.columns:
            continue
        corner, some = contrast > CORNER_CONTRAST, contrast > SOME_CONTRAST
        held = (
            (_shares(some, board.rows, board.columns) >= LEAST_SHOWN)
            & (_shares(corner, board.rows, board.columns) >= LEAST_SURE)
            & (_shares(some & joined, board.rows, board.columns) >= LEAST_SHOWN_AND_JOINED)
            & (np.min(_outer_lines(some, board), axis=0) >= LEAST_OF_OUTER_LINE)
            & ~_goes_on(corner, board)
        )
        for top, left in np.argwhere(held):
            part = np.s_[top : top + board.rows, left : left + board.columns]
            yield at[part].copy(), corner[part]


def _shares(mask: npt.NDArray[np.bool_], rows: int, columns: int) -> FloatArray:
    """The share of a mask that is set in each window of the given rows and columns, by the window's first
    cell."""
    shares: FloatArray = np.lib.stride_tricks.sliding_window_view(mask, (rows, columns)).mean(axis=(2, 3))
    return shares


def _outer_lines(mask: npt.NDArray[np.bool_], board: Board) -> FloatArray:
    """The same of the first and last row and column of each window of the board's counts, (4, …)."""
    across, down = _shares(mask, 1, board.columns), _shares(mask, board.rows, 1)
    return np.array(
        [
            across[: len(mask) - board.rows + 1],
            across[board.rows - 1 :],
            down[:, : mask.shape[1] - board.columns + 1],
            down[:, board.columns - 1 :],
        ]
    )


def _goes_on(corner: npt.NDArray[np.bool_], board: Board) -> npt.NDArray[np.bool_]:
    """Whether the grid is larger than each window: four squares meet along a line beyond it, or at many places around it."""
    beyond = _outer_lines(np.pad(corner, 1), Board(board.columns, board.rows + 2, board.square_m))[
        :2, :, 1:-1
    ]
    beside = _outer_lines(np.pad(corner, 1), Board(board.columns + 2, board.rows, board.square_m))[2:, 1:-1]
    around = board.columns * beyond.sum(axis=0) + board.rows * beside.sum(axis=0)
    lines = np.concatenate([beyond, beside])
    result: npt.NDArray[np.bool_] = (lines > GOES_ON).any(axis=0) | (
        around > GOES_ON_AROUND * 2.0 * (board.columns + board.rows)
    )
    return result
