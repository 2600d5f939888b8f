"""The ghost of a pane: its front face also reflects a few hundredths of the light, and shows everything
once more, displaced by some pixels.

The edges of a ball and those of its ghost overlap, which pulls the ball's outline towards the ghost, in all of a picture's balls alike: no residual shows it. The
board does, whose pattern is known: P(x) = c M(x) + s (M(x − d) + M(x + d)) + a (M(x − d) − M(x + d)) with the pattern M, drawn through the corners' homography and
blurred, in linear light. A lens, a shake and a codec spread light to both sides alike (s); a ghost lies on one side (a). What the pull can be is
added to the claims; it is not taken off, since the board's corners are pulled too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from ..board import Board
from .ball import OutlineFit
from .types import BoardView, FloatArray, Pixels

# The part of the board that is looked at, squares each way from its middle: enough for a ghost of a fiftieth.
HALF_ACROSS, HALF_DOWN = 2.2, 1.5
# Samples a pixel each way of the drawn pattern.
FINE = 2
# Blurs of the drawn pattern that are tried, px.
BLURS_PX = (0.5, 0.8, 1.2, 1.8)
# The farthest ghost that is looked for, px, and as a share of a square.
REACH_PX, REACH_SQUARES = 7, 0.6
# Nearer than this a ghost looks like blur, px.
NEAREST_PX = 1.9
# The most pixels that are read: more take time and tell no more.
MOST_PIXELS = 3000
# Least strength of a ghost, as a share of all light, and least share of the residual's squares that its lying on one side explains.
LEAST_STRENGTH = 0.015
LEAST_EXPLAINED = 0.018
# Shifts that explain this share of what the best one does are as good.
AS_GOOD_SHARE = 0.85
# A ghost d px away pulls an outline whose edges show a blur b by this share of its strength times d exp(−(d / w)²), w so many times b: near ones shift an edge, far ones
# stand beside it. Measured on drawn balls of blurs from 0.5 to 2.6 px, codecs' among them.
PULL_SHARE, PULL_WIDTH_OF_BLUR = 0.8, 3.7


@dataclass(frozen=True)
class Ghost:
    """A second, weaker picture: its share of the light and where it lies, px."""

    strength: float
    shift_px: tuple[float, float]

    def pull_px(self, blur_px: float) -> FloatArray:
        """How far it draws the outline of a ball whose edges show that blur, `(2,)` px."""
        shift = np.array(self.shift_px)
        near = np.exp(-float(shift @ shift) / (PULL_WIDTH_OF_BLUR * blur_px) ** 2)
        result: FloatArray = PULL_SHARE * self.strength * near * shift
        return result


def board_ghost(gray: Pixels, view: BoardView, board: Board) -> Ghost | None:
    """The ghost in a view of the board `gray` (H, W) uint8; None where it shows none, or the board is too
    small to determine it."""
    drawn = _drawn(gray, view, board)
    if drawn is None:
        return None
    light, pattern, side = drawn
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
    return _one_sided(part, min(tried, key=lambda one: one.left), reach, kept)


def _stride(count: int, width: int) -> int:
    """Every so many pixels are read, in the order of rows; not in columns."""
    stride = max(1, count // MOST_PIXELS)
    return stride + 1 if stride > 1 and width % stride == 0 else stride


@dataclass(frozen=True)
class _Alone:
    """The blurred pattern without a ghost: itself, its slopes and bends, as rows by pixel, and the squares that they leave.

    The slopes: corners are pulled by the ghost too, and the pattern is drawn by them. The bends: its blur is known only roughly, and may differ by direction.
    """

    model: Pixels
    basis: FloatArray
    left: float


def _alone(part: Pixels, model: Pixels, inside: tuple[slice, slice], kept: slice) -> _Alone:
    orders = ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
    bent = [cv2.Sobel(model, cv2.CV_32F, *order) for order in orders]
    basis = np.stack([one[inside].ravel()[kept] for one in (model, *bent)])
    gram = (basis @ basis.T).astype(np.float64)
    told = (basis @ part).astype(np.float64)
    return _Alone(model, basis, float(part @ part) - float(told @ np.linalg.solve(gram, told)))


def _one_sided(part: Pixels, alone: _Alone, reach: int, kept: slice) -> Ghost | None:
    """Least squares by the pattern and, for each shift, the sum and the difference of the pattern there and opposite; the best difference."""
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
    flat = np.linalg.qr(basis.T.astype(np.float64))[0].T.astype(np.float32)
    rest = part - (flat @ part) @ flat
    of_both, of_apart = both @ flat.T, apart @ flat.T

    def product(one: Pixels, other: Pixels, of_one: Pixels, of_other: Pixels) -> FloatArray:
        result: FloatArray = np.einsum("ij,ij->i", one, other) - np.einsum("ij,ij->i", of_one, of_other)
        return result.astype(np.float64)

    squares = np.maximum(product(both, both, of_both, of_both), 1e-9)
    mixed = product(both, apart, of_both, of_apart)
    own = product(apart, apart, of_apart, of_apart)
    with_both, with_apart = (both @ rest).astype(np.float64), (apart @ rest).astype(np.float64)
    telling = np.maximum(own - mixed**2 / squares, 1e-6 * own)
    difference = (with_apart - mixed * with_both / squares) / telling
    gained = difference**2 * telling
    # Near shifts are much like slopes and bends, and need a strong second picture to explain what a farther, weaker one does.
    as_good = gained >= AS_GOOD_SHARE * gained.max()
    best = int(np.where(as_good, np.abs(difference), np.inf).argmin())
    even = (with_both[best] - difference[best] * mixed[best]) / squares[best]
    explained = gained[best] / max(float(rest @ rest) - with_both[best] ** 2 / squares[best], 1e-12)
    # The light of all: the pattern's own, and twice the even part.
    other = part - even * both[best] - difference[best] * apart[best]
    gram = (basis @ basis.T).astype(np.float64)
    total = float(np.linalg.solve(gram, (basis @ other).astype(np.float64))[0]) + 2.0 * even
    strength = float(2.0 * difference[best] / total)
    if explained < LEAST_EXPLAINED or not LEAST_STRENGTH <= abs(strength) < 0.5:
        return None
    across, down = shifts[best]
    side = float(np.sign(strength))
    return Ghost(abs(strength), (side * across, side * down))


def with_ghost(fit: OutlineFit | None, ghost: Ghost | None) -> OutlineFit | None:
    """An outline whose covariance holds the pull of a ghost."""
    if fit is None or ghost is None:
        return fit
    pull = ghost.pull_px(fit.blur_px)
    return replace(fit, centroid_covariance_px2=fit.centroid_covariance_px2 + np.outer(pull, pull))


def _drawn(gray: Pixels, view: BoardView, board: Board) -> tuple[Pixels, Pixels, float] | None:
    """The middle of a seen board, linear light, its pattern drawn there (1 and −1), and the side of two squares, px."""
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
    return light.astype(np.float32), pattern, 2.0 * square


def _without_shade(values: Pixels, side: float) -> Pixels:
    """Values less their mean over two squares each way: light changes slowly across the board."""
    odd = 2 * round(0.5 * side) + 1
    result: Pixels = values - cv2.boxFilter(values, -1, (odd, odd), borderType=cv2.BORDER_REFLECT)
    return result
