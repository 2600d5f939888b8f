"""Where in a picture a chessboard can be: crossings of its squares, joined to their neighbours.

Half of the time of a search without success is spent on thresholds that a full detector tries where there
is no board. A crossing of squares is a saddle of the brightness, and its neighbours along the grid are
saddles rotated by a right angle (dark and light exchanged). Noise and texture have saddles too, but without
such neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from ..medians import median
from ..short_repr import ShortRepr
from .types import FloatArray, Pixels

# Smaller pictures show no board.
LEAST_SIDE_PX = 16.0
# Blur before the second derivatives, px. A crossing of contrast C blurred by σ has a mixed derivative of C / (π σ²); a pixel's own blur adds to σ².
BLUR_PX = 1.2
PIXEL_VARIANCE_PX2 = 0.5
# Least share of that which a crossing shows, and its least contrast, levels.
LEAST_SADDLE = 0.35
LEAST_CONTRAST = 12.0
# The same in standard deviations of the noise of one pixel.
LEAST_CONTRAST_NOISES = 2.0
# Half width of the window in which the contrast is read, px.
CONTRAST_REACH_PX = 4
# Contrasts of up to so many places are read one by one; of more, those of all pixels take less time.
MOST_READ_ALONE = 600
# The most saddles that are joined, the strongest first, and how many neighbours of each are looked at.
MOST_SADDLES = 500
NEIGHBOURS = 12
# Neighbours along the grid: cosine of their axes' doubled angle, and ratio of their strengths.
OPPOSITE_COSINE = -0.7
STRENGTH_RATIO = 3.0
# A step to a partner is repeated beyond it or on the other side, to this share of the step: perspective changes the steps of a grid slowly.
STEP_SHARE = 0.3
# Partners are at most this many times as far away as the nearest one: first as on a board seen from the
# front, which separates it from neighbouring objects, then as on one that is seen at a flat angle.
STEP_RATIOS = (1.7, 4.0)
# Least partners of a crossing: a corner of the grid has two. Counted again without those that had too few, so many times.
LEAST_PARTNERS = 2
ROUNDS = 4
# A board of which this share of the crossings shows may be found; glare and blur hide some from the derivatives.
LEAST_SHOWN = 0.8
# The place reaches so many distances of neighbours beyond the crossings: the outer squares and a margin of paper.
MARGIN_STEPS = 2.5
MOST_PLACES = 4
# Places that share this part of the smaller one's area are one.
SAME_SHARE = 0.6


@dataclass(frozen=True, eq=False, repr=False)
class Place(ShortRepr):
    """A part of the picture that may contain a board: `(left, top, right, bottom)` px, and its crossings,
    `(N, 2)` px.

    `axis` (N, 2): cosine and sine of twice the angle of each crossing; `links` (2, M): pairs of adjacent
    crossings; `scale`: the size in which they were found.
    """

    box_px: tuple[int, int, int, int]
    crossings_px: FloatArray
    axis: FloatArray
    links: npt.NDArray[np.intp]
    scale: float

    def unlike(self, corner_count: int) -> int:
        """How far the number of crossings is from a board's: a wall of tiles shows many more."""
        return abs(len(self.crossings_px) - corner_count)

    def step_px(self) -> float:
        """Typical distance of a crossing from the one nearest to it, about the side of a square, px; 0 where fewer than two show."""
        if len(self.crossings_px) < 2:
            return 0.0
        u, v = self.crossings_px.T
        squares = (u[:, None] - u[None]) ** 2 + (v[:, None] - v[None]) ** 2
        np.fill_diagonal(squares, np.inf)
        return float(np.sqrt(median(squares.min(axis=1))))

    def same_as(self, other: Place) -> bool:
        """Whether two places share most of the smaller one."""
        one, two = self.box_px, other.box_px
        across = min(one[2], two[2]) - max(one[0], two[0])
        down = min(one[3], two[3]) - max(one[1], two[1])
        least = min((box[2] - box[0]) * (box[3] - box[1]) for box in (one, two))
        return max(across, 0) * max(down, 0) > SAME_SHARE * least


@dataclass(frozen=True)
class _Saddles:
    place_px: FloatArray
    axis: FloatArray
    strength: FloatArray


def board_places(
    gray: Pixels,
    corner_count: int,
    scale: float = 0.5,
    least_contrast: float = LEAST_CONTRAST,
    small: Pixels | None = None,
) -> tuple[Place, ...]:
    """Parts of a grey picture (H, W) that show most of a board's `corner_count` crossings in a size
    `scale`, the most probable first.

    `least_contrast`: of a crossing, grey levels. `small`: the picture in that size, where it is there already.
    """
    height, width = gray.shape
    if min(height, width) * scale < LEAST_SIDE_PX:
        return ()
    saddles = _saddles(resized(gray, scale) if small is None else small, least_contrast)
    found: list[Place] = []
    least = LEAST_SHOWN * corner_count
    if len(saddles.place_px) < max(least, NEIGHBOURS + 1):
        return ()
    pairs = _pairs(saddles)
    groups = [group for ratio in STEP_RATIOS for group in _groups(saddles, pairs, least, ratio)]
    for members, links, step in groups:
        points = saddles.place_px[members]
        low = (points.min(axis=0) - MARGIN_STEPS * step) / scale
        high = (points.max(axis=0) + MARGIN_STEPS * step + 1.0) / scale
        left, top = max(int(low[0]), 0), max(int(low[1]), 0)
        right, bottom = min(int(high[0]) + 1, width), min(int(high[1]) + 1, height)
        place = Place(
            (left, top, right, bottom), (points + 0.5) / scale - 0.5, saddles.axis[members], links, scale
        )
        if not any(place.same_as(other) for other in found):
            found.append(place)
    found.sort(key=lambda one: one.unlike(corner_count))
    return tuple(found[:MOST_PLACES])


def resized(gray: Pixels, scale: float) -> Pixels:
    """A picture at another size: pixels are averaged, none is left out."""
    if scale == 1.0:
        return gray
    small: Pixels = cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return small


def _saddles(gray: Pixels, least_contrast: float) -> _Saddles:
    smooth = cv2.GaussianBlur(gray.astype(np.float32), (0, 0), BLUR_PX)
    # Sobel's second derivatives are four times the derivative.
    xx, yy, xy = (cv2.Sobel(smooth, cv2.CV_32F, *order, scale=0.25) for order in ((2, 0), (0, 2), (1, 1)))
    curvature = xy * xy - xx * yy
    least_contrast = max(least_contrast, LEAST_CONTRAST_NOISES * noise_levels(gray))
    # What the least contrast needs leaves some hundred pixels to ask for more.
    by_contrast = LEAST_SADDLE / (np.pi * (BLUR_PX**2 + PIXEL_VARIANCE_PX2))
    highest = cv2.dilate(curvature, np.ones((5, 5), np.uint8))
    bar = np.float32((by_contrast * least_contrast) ** 2)
    peak = np.flatnonzero((curvature >= highest) & (curvature > bar))
    strength = curvature.ravel()[peak]
    contrast = _contrast_around(smooth, peak)
    kept = (strength > (by_contrast * contrast) ** 2) & (contrast > least_contrast)
    peak, strength = peak[kept], np.sqrt(strength[kept])
    if len(peak) > MOST_SADDLES:
        best = np.argpartition(-strength, MOST_SADDLES)[:MOST_SADDLES]
        peak, strength = peak[best], strength[best]
    half = 0.5 * (xx.ravel()[peak] - yy.ravel()[peak])
    mixed = xy.ravel()[peak]
    length = np.maximum(np.hypot(half, mixed), 1e-9)
    return _Saddles(
        _between_pixels(curvature, peak),
        np.column_stack([half / length, mixed / length]).astype(np.float64),
        strength.astype(np.float64),
    )


def _contrast_around(smooth: Pixels, peak: npt.NDArray[np.intp]) -> Pixels:
    """How far apart the darkest and the brightest pixel around each of some pixels, given by their index, are."""
    reach = CONTRAST_REACH_PX
    side = 2 * reach + 1
    if len(peak) > MOST_READ_ALONE:
        window = np.ones((side, side), np.uint8)
        result: Pixels = cv2.dilate(smooth, window).ravel()[peak] - cv2.erode(smooth, window).ravel()[peak]
        return result
    # What lies beyond the border is on it too.
    around = cv2.copyMakeBorder(smooth, reach, reach, reach, reach, cv2.BORDER_REPLICATE)
    rows, columns = np.divmod(peak, smooth.shape[1])
    first = rows * around.shape[1] + columns
    offsets = (np.arange(side)[:, None] * around.shape[1] + np.arange(side)).ravel()
    windows = around.ravel()[offsets[:, None] + first]
    apart: Pixels = windows.max(axis=0, initial=-np.inf) - windows.min(axis=0, initial=np.inf)
    return apart


def _between_pixels(values: Pixels, peak: npt.NDArray[np.intp]) -> FloatArray:
    """Places (N, 2) of peaks, given by their index, from parabolas through the adjacent pixels."""
    height, width = values.shape
    rows, columns = np.divmod(peak, width)
    place = np.column_stack([columns, rows]).astype(np.float64)
    flat = values.ravel()
    for axis, (step, inside) in enumerate(
        ((1, (columns > 0) & (columns < width - 1)), (width, (rows > 0) & (rows < height - 1)))
    ):
        top = peak[inside]
        before, at, after = flat[top - step], flat[top], flat[top + step]
        bend = np.minimum(before - 2.0 * at + after, -1e-9)
        place[inside, axis] += np.clip(0.5 * (before - after) / bend, -0.5, 0.5)
    return place


def noise_levels(gray: Pixels) -> float:
    """Standard deviation of a pixel's noise: the median of mixed differences, which edges hardly touch."""
    part = gray[::2].astype(np.int16)
    mixed = np.abs(np.diff(np.diff(part, axis=0), axis=1)[:, ::3]).ravel()
    if not mixed.size:
        return 0.0
    # The median of whole numbers by counting them.
    below = np.bincount(mixed).cumsum()
    low, high = np.searchsorted(below, [(mixed.size + 1) // 2, mixed.size // 2 + 1])
    return 0.5 * float(low + high) / 0.6745 / 2.0


@dataclass(frozen=True)
class _Pairs:
    """Saddles and those of their neighbours that are turned against them and of like strength, by index, and how far these are away, px."""

    mine: npt.NDArray[np.intp]
    other: npt.NDArray[np.intp]
    away: FloatArray
    nearest: FloatArray


def _pairs(saddles: _Saddles) -> _Pairs:
    count = len(saddles.place_px)
    u, v = saddles.place_px.T
    squares = (u[:, None] - u[None]) ** 2 + (v[:, None] - v[None]) ** 2
    np.fill_diagonal(squares, np.inf)
    near = np.argpartition(squares, NEIGHBOURS - 1, axis=1)[:, :NEIGHBOURS]
    mine = np.repeat(np.arange(count), NEIGHBOURS)
    other = near.ravel()
    turned = np.einsum("ij,ij->i", saddles.axis[mine], saddles.axis[other]) < OPPOSITE_COSINE
    ratio = saddles.strength[mine] / saddles.strength[other]
    joined = turned & (ratio < STRENGTH_RATIO) & (ratio > 1.0 / STRENGTH_RATIO)
    mine, other = mine[joined], other[joined]
    away = np.sqrt(squares[mine, other])
    nearest = np.full(count, np.inf)
    np.minimum.at(nearest, mine, away)
    return _Pairs(mine, other, away, nearest)


def _groups(
    saddles: _Saddles, pairs: _Pairs, least: float, step_ratio: float
) -> list[tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], float]]:
    """Saddles joined to neighbours of the opposite orientation: their indices (N,), the links (2, M) among
    these, and the links' typical length, of groups with at least this many."""
    count = len(saddles.place_px)
    mine, other, away = pairs.mine, pairs.other, pairs.away
    steady = away <= step_ratio * np.minimum(pairs.nearest[mine], pairs.nearest[other])
    mine, other, away = mine[steady], other[steady], away[steady]
    repeated = _repeated(saddles.place_px, mine, other)
    mine, other, away = mine[repeated], other[repeated], away[repeated]
    for _ in range(ROUNDS):
        partners = np.bincount(mine, minlength=count) >= LEAST_PARTNERS
        kept = partners[mine] & partners[other]
        mine, other, away = mine[kept], other[kept], away[kept]
    label = _labels(count, mine, other)
    groups = []
    for one, size in zip(*np.unique(label[np.unique(mine)], return_counts=True), strict=True):
        if size >= least:
            inside = label[mine] == one
            step = median(away[inside])
            members = np.unique(mine[inside])
            # The last round may have struck the far end of a link.
            ends = np.array([mine[inside], other[inside]])[:, np.isin(other[inside], members)]
            links = np.searchsorted(members, ends)
            groups.append((members, links, step))
    return groups


def _repeated(
    place_px: FloatArray, mine: npt.NDArray[np.intp], other: npt.NDArray[np.intp]
) -> npt.NDArray[np.bool_]:
    """Which links go on by about the same step, at either end."""
    count = len(place_px)
    # Links of each saddle, side by side; missing ones point at a distant place.
    links = np.full((count, NEIGHBOURS), count)
    column = np.arange(len(mine)) - np.searchsorted(mine, mine)
    links[mine, column] = other
    # In single precision, two columns: this is most of a place's time where much looks like crossings.
    u, v = np.vstack([place_px, np.full((1, 2), 1e9)]).T.astype(np.float32)
    near_u, near_v = u[links], v[links]
    step_u, step_v = u[other] - u[mine], v[other] - v[mine]
    allowed = np.float32(STEP_SHARE**2) * (step_u**2 + step_v**2)
    found = np.zeros(len(mine), dtype=bool)
    for end, beyond_u, beyond_v in (
        (other, u[other] + step_u, v[other] + step_v),
        (mine, u[mine] - step_u, v[mine] - step_v),
    ):
        away = (near_u[end] - beyond_u[:, None]) ** 2 + (near_v[end] - beyond_v[:, None]) ** 2
        found |= away.min(axis=1) < allowed
    return found


def _labels(count: int, mine: npt.NDArray[np.intp], other: npt.NDArray[np.intp]) -> npt.NDArray[np.intp]:
    """Connected components by the least index that reaches each."""
    label = np.arange(count)
    while True:
        before = label.copy()
        np.minimum.at(label, mine, label[other])
        np.minimum.at(label, other, label[mine])
        label = label[label]
        if np.array_equal(label, before):
            return label
