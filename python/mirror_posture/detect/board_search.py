"""Candidates for chessboards in a picture: where OpenCV's detectors search, in which order, after which
preparation.

The fast search for crossings (`places`) says where a board can be. Detectors, which take a hundred times as
long where there is no board, search only those parts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from ..board import Board
from .lattice import Reading, read_crossings
from .places import LEAST_CONTRAST, LEAST_SHOWN, MARGIN_STEPS, Place, board_places, noise_levels, resized
from .types import FloatArray, Pixels

# Larger pictures are searched at about this width: the detectors look for squares of tens of pixels.
SEARCH_WIDTH_PX = 1632
# Sizes in which places of boards are looked for, the most usual first: a small picture is free of noise and blur, a large one shows small squares.
PLACE_SCALES = (0.5, 0.25, 1.0)
# ... and the least contrast, levels. Texture has many faint crossings: such are searched last, and where
# squares are not small.
FAINT_CONTRAST = 4.0
LOOKS = (*((scale, LEAST_CONTRAST) for scale in PLACE_SCALES), (0.5, FAINT_CONTRAST), (0.25, FAINT_CONTRAST))
# A board of more corners is looked for in the whole picture where no place shows: more crossings than are joined (`places`) may be its own.
MANY_CORNERS = 300
# Parts with larger squares than this are searched at half the size: in a quarter of the time, and corners are refined in the picture itself.
LARGE_SQUARE_PX = 18.0
# A detector averages over more of the picture than crossings do. It is used where a pixel's noise is above
# this share of the squares' contrast, in at most this many places, those with nearest to the board's number
# of crossings first, and where this share of its corners is certain. Where noise is less, there is no board
# without crossings, and a detector takes tenths of a second to find none in cloth or keys.
LEAST_NOISE_SHARE = 0.08
MOST_SEARCHED = 2
LEAST_SHOWN_FOR_DETECTOR = 0.75
# Grids with hidden corners that are examined of a place, those with the most that show first.
MOST_PARTLY = 2


def scale_of(gray: Pixels) -> float:
    """How much a picture is reduced for the search."""
    return min(1.0, SEARCH_WIDTH_PX / float(gray.shape[1]))


class Places:
    """Where a picture may contain boards, by the size in which it is examined; places on boards that were
    found no longer count."""

    def __init__(self, gray: Pixels, corner_count: int) -> None:
        self._gray, self._corner_count = gray, corner_count
        self._by_scale: dict[tuple[float, float], tuple[Place, ...]] = {}
        self._seen_at: dict[float, Pixels] = {}
        self._covered: list[FloatArray] = []
        self._readings: dict[Place, Reading] = {}

    def at(self, scale: float, least_contrast: float = LEAST_CONTRAST) -> tuple[Place, ...]:
        if (scale, least_contrast) not in self._by_scale:
            if scale not in self._seen_at:
                self._seen_at[scale] = resized(self._gray, scale)
            self._by_scale[scale, least_contrast] = board_places(
                self._gray, self._corner_count, scale, least_contrast, self._seen_at[scale]
            )
        least = LEAST_SHOWN * self._corner_count
        return tuple(place for place in self._by_scale[scale, least_contrast] if self._open(place) >= least)

    def reading(self, place: Place, board: Board) -> Reading:
        """The grids of a place's crossings; they are the same when a surplus board is searched."""
        if place not in self._readings:
            self._readings[place] = read_crossings(self._seen_at[place.scale], place, board)
        return self._readings[place]

    def looked_at(self) -> tuple[tuple[float, float], ...]:
        return tuple(self._by_scale)

    def cover(self, outline_px: FloatArray) -> None:
        self._covered.append(outline_px.astype(np.float32))

    def _open(self, place: Place) -> int:
        if not self._covered:
            return len(place.crossings_px)
        return sum(
            all(cv2.pointPolygonTest(outline, (float(u), float(v)), False) < 0.0 for outline in self._covered)
            for u, v in place.crossings_px
        )


@dataclass(frozen=True)
class Candidate:
    """A grid (ny, nx, 2) px and what found it; `shown` (ny, nx): which of its corners show, where some may be hidden."""

    method: str
    grid: FloatArray
    shown: npt.NDArray[np.bool_] | None = None


def candidates(
    picture: Callable[[], Pixels], scale: float, board: Board, shown: Places, quick: bool
) -> Iterator[Candidate]:
    """Grids by place, detector and preparation, the most probable and fastest first. The `picture` is asked for where a detector looks at it: most searches end before."""
    seen_in: list[Pixels] = []

    def small() -> Pixels:
        if not seen_in:
            seen_in.append(resized(picture(), scale))
        return seen_in[0]

    tried: list[Place] = []
    noisy: list[Place] = []
    nothing_seen = True
    for look in shown.looked_at() if quick else LOOKS:
        # A faint board is looked for where no other squares show.
        if look[1] < LEAST_CONTRAST and not (quick or nothing_seen):
            break
        for place in shown.at(*look):
            nothing_seen = False
            if any(place.same_as(other) for other in tried):
                continue
            reading = shown.reading(place, board)
            if not quick:
                for grid in reading.whole:
                    yield Candidate("crossings", (grid + 0.5) / scale - 0.5)
                # Before detectors, which take the edge of what hides a corner for the corner.
                for grid, seen in reading.partly[:MOST_PARTLY]:
                    yield Candidate("crossings, some hidden", (grid + 0.5) / scale - 0.5, seen)
            if not reading.may_hold:
                continue
            place = _narrowed(place, reading)
            tried.append(place)
            if quick:
                yield from _in_place(small(), scale, place, board, "quick")
            elif reading.most_shown() >= LEAST_SHOWN_FOR_DETECTOR and _is_noisy(small(), place):
                noisy.append(place)
    if quick:
        return
    if nothing_seen and board.corner_count > MANY_CORNERS:
        height, width = small().shape
        none = np.empty((0, 2))
        whole = Place((0, 0, width, height), none, none, np.empty((2, 0), dtype=np.intp), 1.0)
        yield from _in_place(small(), scale, whole, board, "quick")
    noisy.sort(key=lambda place: place.unlike(board.corner_count))
    for place in noisy[:MOST_SEARCHED]:
        yield from _in_place(small(), scale, place, board, "sector")


def _is_noisy(gray: Pixels, place: Place) -> bool:
    """Whether a place's noise may hide crossings of its squares."""
    left, top, right, bottom = place.box_px
    part = gray[top:bottom, left:right]
    dark, light = np.percentile(part[::2, ::2], (10.0, 90.0))
    return noise_levels(part) > LEAST_NOISE_SHARE * float(light - dark)


def _narrowed(place: Place, reading: Reading) -> Place:
    """The part of a place in which a board may be: cloth and walls reach far beyond the few windows in which their squares look like one."""
    grids = [*reading.whole, *(grid for grid, _ in reading.partly)]
    if not grids:
        return place
    points = np.concatenate([grid.reshape(-1, 2) for grid in grids])
    margin = MARGIN_STEPS * max(float(np.linalg.norm(np.diff(grid, axis=1), axis=2).max()) for grid in grids)
    left, top = (
        int(max(low, old)) for low, old in zip(points.min(axis=0) - margin, place.box_px[:2], strict=True)
    )
    right, bottom = (
        int(min(high, old))
        for high, old in zip(points.max(axis=0) + margin + 1.0, place.box_px[2:], strict=True)
    )
    return replace(place, box_px=(left, top, right, bottom))


def _in_place(small: Pixels, scale: float, place: Place, board: Board, name: str) -> Iterator[Candidate]:
    """The grid that a detector finds in a place."""
    left, top, right, bottom = place.box_px
    size = 0.5 if place.step_px() > LARGE_SQUARE_PX else 1.0
    part = resized(np.ascontiguousarray(small[top:bottom, left:right]), size)
    try:
        points = DETECTORS[name](part, (board.columns, board.rows))
    except cv2.error:
        # OpenCV's detectors assert on some degenerate pictures (for example a few pixels high): there is
        # nothing to find in those.
        return
    if points is None or points.size != 2 * board.corner_count or not np.isfinite(points).all():
        return
    grid = points.reshape(board.rows, board.columns, 2).astype(np.float64)
    # Pixel centres, not corners, are whole numbers: a resized picture is shifted by half a pixel.
    grid = (grid + 0.5) / size - 0.5 + np.array([left, top], dtype=np.float64)
    yield Candidate(name, (grid + 0.5) / scale - 0.5)


def _classic_quick(gray: Pixels, size: tuple[int, int]) -> Pixels | None:
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
    found, points = cv2.findChessboardCorners(gray, size, flags=flags)
    return points if found else None


def _sector(gray: Pixels, size: tuple[int, int]) -> Pixels | None:
    found, points = cv2.findChessboardCornersSB(
        gray, size, flags=cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_NORMALIZE_IMAGE
    )
    return points if found else None


DETECTORS: dict[str, Callable[[Pixels, tuple[int, int]], Pixels | None]] = {
    "quick": _classic_quick,
    "sector": _sector,
}
