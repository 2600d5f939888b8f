"""The ghost of a pane: its front face also reflects a few hundredths of the light, and shows everything
once more, displaced by some pixels.

The edges of a ball and those of its ghost overlap, which pulls the ball's outline towards the ghost, in the
same way for all balls of a picture, so no residual shows it. The board shows it, because its pattern is
known: P(x) = c₁ M(x) + c₂ M(x − d) with the pattern M, rendered through the corners' homography, in linear
light. The possible pull is added to the claimed deviations. It is not subtracted, because the board's
corners are pulled too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from ..board import Board
from .types import BoardView, FloatArray, MarkerView, Pixels

# The part of the board that is used, squares each way from its middle: sufficient for a ghost of a thirtieth.
HALF_ACROSS, HALF_DOWN = 2.2, 1.5
# Samples a pixel each way of the drawn pattern.
FINE = 2
# Blurs of the drawn pattern that are tried, px.
BLURS_PX = (0.5, 0.8, 1.2)
# The farthest ghost that is looked for, px, and as a share of a square.
REACH_PX, REACH_SQUARES = 7, 0.6
# Nearer than this a ghost looks like blur, px.
NEAREST_PX = 1.9
# A ghost of strength a, d px away, pulls an outline by a d exp(−(d / w)²): near ones shift an edge, far ones
# are beside it. w in px, from rendered and sharp pictures.
PULL_WIDTH_PX = 2.5
# The claims of outlines were set on pictures of usual panes, of 2 to 5 hundredths: they hold that much.
USUAL_STRENGTH = 0.035
# Least strength of a ghost, as a share of all light, and least share of the residual's squares that it explains.
LEAST_STRENGTH = USUAL_STRENGTH
LEAST_EXPLAINED = 0.07


@dataclass(frozen=True)
class Ghost:
    """A second, weaker picture: its share of the light and where it lies, px."""

    strength: float
    shift_px: tuple[float, float]

    @property
    def pull_px(self) -> FloatArray:
        """How far it displaces the outline of a ball beyond the displacement by a usual pane, `(2,)` px."""
        shift = np.array(self.shift_px)
        strength = float(np.sqrt(max(self.strength**2 - USUAL_STRENGTH**2, 0.0)))
        result: FloatArray = strength * shift * np.exp(-float(shift @ shift) / PULL_WIDTH_PX**2)
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
    part = np.ascontiguousarray(light[reach:-reach, reach:-reach])
    # With each blur for itself: the best one without a ghost has a part of it in its blur.
    tried = [
        _second(part, _without_shade(cv2.GaussianBlur(pattern, (0, 0), blur), side), reach)
        for blur in BLURS_PX
    ]
    best = max(tried, key=lambda one: one.explained)
    alone = max(one.explained_alone for one in tried)
    left = float(np.sum(part**2)) - alone
    if best.explained - alone <= LEAST_EXPLAINED * left or not LEAST_STRENGTH <= best.strength < 0.5:
        return None
    return Ghost(best.strength, best.shift_px)


@dataclass(frozen=True)
class _Fit:
    """The best second image in addition to one pattern, and which squares both and the pattern alone
    explain."""

    strength: float
    shift_px: tuple[float, float]
    explained: float
    explained_alone: float


def _second(part: Pixels, model: Pixels, reach: int) -> _Fit:
    """Least squares of `part` by the pattern, its slopes and bend, and the pattern shifted each way up to `reach`, px.

    The slopes: corners are pulled by the ghost too, and the pattern is drawn by them. The bend: its blur is known only roughly.
    """
    inside = np.s_[reach:-reach, reach:-reach]
    slopes = (cv2.Sobel(model, cv2.CV_32F, *order, scale=0.125) for order in ((1, 0), (0, 1)))
    bend = cv2.Laplacian(model, cv2.CV_32F)
    basis = [np.ascontiguousarray(one[inside]) for one in (model, *slopes, bend)]
    flat = np.stack([one.ravel() for one in basis]).astype(np.float64)
    gram, on_light = flat @ flat.T, flat @ part.ravel().astype(np.float64)
    solved = np.linalg.solve(gram, on_light)
    # Entry (i, j) is of the pattern shifted by (reach − j, reach − i).
    with_light = cv2.matchTemplate(model, part, cv2.TM_CCORR).astype(np.float64)
    with_basis = np.stack([cv2.matchTemplate(model, one, cv2.TM_CCORR) for one in basis]).astype(np.float64)
    squares = cv2.matchTemplate(model**2, np.ones_like(part), cv2.TM_CCORR).astype(np.float64)
    along = np.einsum("ab,bij->aij", np.linalg.inv(gram), with_basis)
    own = np.maximum(squares - np.einsum("aij,aij->ij", along, with_basis), 1e-6 * squares)
    second = (with_light - np.einsum("aij,a->ij", along, on_light)) / own
    gained = second**2 * own
    first = solved[0] - second * along[0]
    index = np.arange(2 * reach + 1)
    down, across = reach - index[:, None], reach - index[None, :]
    # Of the same sign, and not adjacent to the pattern itself: otherwise it is the pattern's own blur.
    held = (first * second > 0.0) & (np.hypot(across, down) >= NEAREST_PX)
    row, column = divmod(int(np.where(held, gained, -1.0).argmax()), gained.shape[1])
    alone = float(on_light @ solved)
    if not held[row, column]:
        return _Fit(0.0, (0.0, 0.0), alone, alone)
    return _Fit(
        float(second[row, column] / (first[row, column] + second[row, column])),
        (float(reach - column), float(reach - row)),
        alone + float(gained[row, column]),
        alone,
    )


def with_ghost(view: MarkerView, ghost: Ghost) -> MarkerView:
    """A ball's view whose claim holds the pull of a ghost."""
    if view.covariance_px2 is None:
        return view
    return replace(view, covariance_px2=view.covariance_px2 + np.outer(ghost.pull_px, ghost.pull_px))


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
