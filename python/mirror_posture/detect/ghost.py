"""The ghost of a pane in a picture, told by the board: its strength and where it lies.

The board's pattern is known: P(x) = c M(x) + s (M(x − d) + M(x + d)) + a (M(x − d) − M(x + d)) with the pattern M, drawn through the corners' homography and
blurred, in linear light. A lens, a shake and a codec spread light to both sides alike (s); a ghost lies on one side (a). Near the edges of the squares the drawn
pattern is never quite right, and a ghost stands beside them: a pixel's variance is s₀² + s₁² |∇M|², both numbers from what is left (weighted least squares).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from ..board import Board
from .ghost_light import Ghost, Pane
from .types import BoardView, FloatArray, Pixels

# The part of the board that is looked at, squares each way from its middle: enough for a ghost of a fiftieth.
HALF_ACROSS, HALF_DOWN = 2.2, 1.5
# Samples a pixel each way of the drawn pattern.
FINE = 2
# Blurs of the drawn pattern that are tried, px.
BLURS_PX = (0.45, 0.7, 1.0, 1.4, 2.0)
# The farthest ghost that is looked for, px, and as a share of a square.
REACH_PX, REACH_SQUARES = 7, 0.6
# Nearer than this a ghost looks like blur, px.
NEAREST_PX = 1.9
# The most pixels that are read: more take time and tell no more.
MOST_PIXELS = 3000
# Least strength of a ghost, as a share of all light, and least share of the residual's squares that its lying on one side explains.
LEAST_STRENGTH = 0.012
LEAST_EXPLAINED = 0.015
# Shifts at which the weakest ghost that is told is taken, px.
USUAL_SHIFT_PX = (2.4, 4.2)
# A pane's front returns some hundredths of the light: the strength's deviation before the picture is seen. So many pixels share their errors.
USUAL_STRENGTH = 0.05
SHARED_PIXELS = 10.0
# Shifts beside the best one count in its place by what they explain beyond this share of what it does.
BESIDE_SHARE = 0.6
# So many times the pixels are weighted again, by what is left when the ghost has been told.
REWEIGHTINGS = 1
# Least share of a variance that is the same everywhere, against the median of what is left.
LEAST_EVEN = 0.2


def board_ghost(gray: Pixels, view: BoardView, board: Board, pane: Pane | None = None) -> Ghost | None:
    """The ghost in a view of the board `gray` (H, W) uint8, of strength 0 where it shows none; None where the board is too small to determine it. Where it lies as one of a `pane` does, the odds of the two are told too: a pane's differs across the board."""
    drawn = _drawn(gray, view, board)
    if drawn is None:
        return None
    light, pattern, side, corner = drawn
    reach = min(REACH_PX, int(REACH_SQUARES * 0.5 * side))
    if reach < NEAREST_PX or min(light.shape) < 4 * reach:
        return None
    light = _without_shade(light, side)
    inside = np.s_[reach:-reach, reach:-reach]
    part = light[inside].ravel()
    kept = slice(None, None, _stride(part.size, light.shape[1] - 2 * reach))
    part = part[kept]
    tried = [
        _alone(part, _without_shade(cv2.GaussianBlur(pattern, (0, 0), blur), side), inside, kept)
        for blur in BLURS_PX
    ]
    alone = min(tried, key=lambda one: float(one.left @ one.left))
    found = _one_sided(part, alone, reach, kept)
    if found is None:
        return None
    ghost, root = found
    return (
        ghost
        if pane is None or ghost.strength == 0.0
        else _or_of_pane(ghost, pane, part, alone, root, inside, kept, corner)
    )


def _stride(count: int, width: int) -> int:
    """Every so many pixels are read, in the order of rows; not in columns."""
    stride = max(1, count // MOST_PIXELS)
    return stride + 1 if stride > 1 and width % stride == 0 else stride


@dataclass(frozen=True)
class _Alone:
    """The blurred pattern without a ghost: itself, its slopes, bends and its contrast's change across the board, as rows by pixel, the squares of its slope, and
    what they leave.

    The slopes: corners are pulled by the ghost too, and the pattern is drawn by them. The bends: its blur is known only roughly, and may differ by direction.
    """

    model: Pixels
    basis: Pixels
    steepness: Pixels
    left: Pixels


def _alone(part: Pixels, model: Pixels, inside: tuple[slice, slice], kept: slice) -> _Alone:
    orders = ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
    bent = [0.125 * cv2.Sobel(model, cv2.CV_32F, *order) for order in orders]
    height, width = model.shape
    across = model * np.linspace(-1.0, 1.0, width, dtype=np.float32)
    down = model * np.linspace(-1.0, 1.0, height, dtype=np.float32)[:, None]
    basis = np.stack([one[inside].ravel()[kept] for one in (model, *bent, across, down)])
    return _Alone(model, basis, basis[1] ** 2 + basis[2] ** 2, _rest(part, _flat(basis)))


def _flat(basis: Pixels) -> Pixels:
    """Orthonormal rows of the same span, by the Cholesky factor of their products (a tenth of the time of QR)."""
    gram = (basis @ basis.T).astype(np.float64)
    factor = np.linalg.cholesky(gram + 1e-9 * float(np.trace(gram)) * np.eye(len(gram)))
    result: Pixels = np.linalg.inv(factor).astype(np.float32) @ basis
    return result


def _rest(part: Pixels, flat: Pixels) -> Pixels:
    result: Pixels = part - (flat @ part) @ flat
    return result


def _weights(left: Pixels, steepness: Pixels) -> Pixels:
    """Roots of the pixels' weights, by the variance s₀² + s₁² |∇M|² that what is left of them shows; 1 on average."""
    square, steep = left.astype(np.float64) ** 2, steepness.astype(np.float64)
    least = LEAST_EVEN * float(np.median(square)) + 1e-12
    weight = np.ones_like(square)
    even = by_slope = 0.0
    for _ in range(3):
        mixed, cross = float(weight @ steep), float(weight @ (steep * steep))
        told = np.array([weight @ square, weight @ (square * steep)])
        even, by_slope = np.linalg.lstsq(np.array([[weight.sum(), mixed], [mixed, cross]]), told, rcond=None)[
            0
        ]
        even, by_slope = max(float(even), least), max(float(by_slope), 0.0)
        weight = (even + by_slope * steep) ** -2.0
    root = (even + by_slope * steep) ** -0.5
    result: Pixels = (root / np.sqrt(np.mean(root**2))).astype(np.float32)
    return result


def _one_sided(part: Pixels, alone: _Alone, reach: int, kept: slice) -> tuple[Ghost, Pixels] | None:
    """Least squares by the pattern and, for each shift, the sum and the difference of the pattern there and opposite; the most probable difference, and the
    weights' roots."""
    model, basis = alone.model, alone.basis
    height, width = model.shape
    shifts = [
        (across, down)
        for down in range(reach + 1)
        for across in range(-reach, reach + 1)
        if (down > 0 or across > 0) and NEAREST_PX <= np.hypot(across, down) <= reach
    ]

    def moved(across: int, down: int) -> Pixels:
        rows, columns = (
            slice(reach - down, height - reach - down),
            slice(reach - across, width - reach - across),
        )
        result: Pixels = model[rows, columns].ravel()[kept]
        return result

    there = np.stack([moved(*shift) for shift in shifts])
    opposite = np.stack([moved(-across, -down) for across, down in shifts])
    both, apart = there + opposite, there - opposite
    root = _weights(alone.left, alone.steepness)
    found = _best(part * root, basis * root, both * root, apart * root)
    for _ in range(REWEIGHTINGS):
        if found is None:
            return None
        # (A strong ghost is no error of the pattern.)
        without = part - found.even * both[found.index] - found.difference * apart[found.index]
        root = _weights(_rest(without * root, _flat(basis * root)) / root, alone.steepness)
        found = _best(part * root, basis * root, both * root, apart * root)
    if found is None:
        return None
    far = np.hypot(*np.array(shifts, dtype=np.float64).T)
    usual = (far >= USUAL_SHIFT_PX[0]) & (far <= USUAL_SHIFT_PX[1])
    weakest = float(np.median(found.weakest[usual if usual.any() else slice(None)]))
    if found.explained < LEAST_EXPLAINED or not LEAST_STRENGTH <= abs(found.strength) < 0.5:
        return Ghost(0.0, (0.0, 0.0), weakest), root
    # Between the pixels: by what the shifts beside it explain.
    best = np.array(shifts[found.index])
    beside = [
        index
        for index, shift in enumerate(shifts)
        if np.hypot(*(np.array(shift) - best)) < 1.5
        and found.gained[index] > BESIDE_SHARE * found.gained[found.index]
        and found.differences[index] * found.difference > 0.0
    ]
    more = found.gained[beside] - BESIDE_SHARE * found.gained[found.index]
    across, down = np.sign(found.strength) * (more @ np.array([shifts[i] for i in beside])) / more.sum()
    return Ghost(abs(found.strength), (float(across), float(down)), weakest), root


def _or_of_pane(
    ghost: Ghost,
    pane: Pane,
    part: Pixels,
    alone: _Alone,
    root: Pixels,
    inside: tuple[slice, slice],
    kept: slice,
    corner: tuple[int, int],
) -> Ghost:
    """How probable it is that a ghost is the pane's, by what each explains."""
    height, width = alone.model.shape
    u, v = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    middle = np.array(corner) + 0.5 * np.array([width - 1.0, height - 1.0])
    moved_m = pane.moved_m(middle, np.array(ghost.shift_px))
    ends = np.array(corner) + np.array([[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]])
    ways = pane.way_px(ends.astype(np.float64))
    if moved_m is None or ways is None:
        return ghost
    # Between the region's corners the way changes evenly.
    x, y = u / (width - 1), v / (height - 1)
    even = [(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y]
    by_pane = [
        sum(weight * np.float32(way[axis] * moved_m) for weight, way in zip(even, ways, strict=True))
        for axis in (0, 1)
    ]
    explained = []
    for across, down in ((np.float32(ghost.shift_px[0]), np.float32(ghost.shift_px[1])), by_pane):
        there, opposite = (
            cv2.remap(alone.model, u - side * across, v - side * down, cv2.INTER_LINEAR)[inside].ravel()[kept]
            for side in (1.0, -1.0)
        )
        best = _best(
            part * root, alone.basis * root, (there + opposite)[None] * root, (there - opposite)[None] * root
        )
        explained.append(0.0 if best is None else best.told)
    odds = float(np.clip(0.5 * (explained[1] - explained[0]), -30.0, 30.0))
    return replace(ghost, pane=pane, moved_m=moved_m, probability=float(1.0 / (1.0 + np.exp(-odds))))


@dataclass(frozen=True)
class _Found:
    """The best of all shifts: its index, the parts that lie on both and on one side, its strength as a share of all light, the share of the squares that the
    latter explains, and that in squares of independent pixels; and for every shift its part on one side and what that explains, and
    the strength that it must have to be told."""

    index: int
    even: float
    difference: float
    strength: float
    explained: float
    told: float
    differences: FloatArray
    gained: FloatArray
    weakest: FloatArray


def _best(part: Pixels, basis: Pixels, both: Pixels, apart: Pixels) -> _Found | None:
    flat = _flat(basis)
    rest = _rest(part, flat)
    of_both, of_apart = both @ flat.T, apart @ flat.T

    def product(one: Pixels, other: Pixels, of_one: Pixels, of_other: Pixels) -> FloatArray:
        result: FloatArray = np.einsum("ij,ij->i", one, other) - np.einsum("ij,ij->i", of_one, of_other)
        return result.astype(np.float64)

    squares = np.maximum(product(both, both, of_both, of_both), 1e-9)
    mixed = product(both, apart, of_both, of_apart)
    own = product(apart, apart, of_apart, of_apart)
    with_both, with_apart = (both @ rest).astype(np.float64), (apart @ rest).astype(np.float64)
    telling = np.maximum(own - mixed**2 / squares, 1e-6 * own)
    differences = (with_apart - mixed * with_both / squares) / telling
    gained = differences**2 * telling
    all_squares = float(rest @ rest)
    gram = (basis @ basis.T).astype(np.float64)
    main = float(np.linalg.solve(gram, (basis @ part).astype(np.float64))[0])
    if not (all_squares > 0.0 and abs(main) > 0.0):
        return None
    # Near shifts are much like slopes and bends, and need a strong second picture to explain what a farther, weaker one does.
    usual = 2.0 * differences / main / USUAL_STRENGTH
    best = int((gained * len(part) / all_squares / SHARED_PIXELS - usual**2).argmax())
    even = (with_both[best] - differences[best] * mixed[best]) / squares[best]
    # The light of all: the pattern's own, and twice the even part.
    other = part - even * both[best] - differences[best] * apart[best]
    total = float(np.linalg.solve(gram, (basis @ other).astype(np.float64))[0]) + 2.0 * even
    explained = gained[best] / max(all_squares - with_both[best] ** 2 / squares[best], 1e-12)
    return _Found(
        best,
        float(even),
        float(differences[best]),
        float(2.0 * differences[best] / total),
        float(explained),
        float(gained[best] * len(part) / all_squares / SHARED_PIXELS),
        differences,
        gained,
        np.maximum(2.0 * np.sqrt(LEAST_EXPLAINED * all_squares / telling) / abs(total), LEAST_STRENGTH),
    )


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
    level = gray[top:bottom, left:right].astype(np.float32) / 255.0
    light = ((level + 0.055) / 1.055) ** 2.4
    square = float(np.sqrt(abs(np.linalg.det(np.linalg.inv(homography)[:2, :2]))))
    return light.astype(np.float32), pattern, 2.0 * square, (int(left), int(top))


def _without_shade(values: Pixels, side: float) -> Pixels:
    """Values less their mean over two squares each way: light changes slowly across the board."""
    odd = 2 * round(0.5 * side) + 1
    result: Pixels = values - cv2.boxFilter(values, -1, (odd, odd), borderType=cv2.BORDER_REFLECT)
    return result
