"""True physical labels of a chessboard's corners from a picture that may be mirrored.

A detector gives a grid in an order of its own. The grid's symmetries (four, eight for a square grid) are the possible labellings;
two facts choose among them:

- *handedness*: the board's frame has z out of the printed face, so `det ∂(u, v)/∂(x, y)` is negative in a direct view (v points down)
  and positive in a mirrored one;
- *colour*: the square diagonally beyond corner 0 is dark.

A board with an odd and an even count of inner corners has exactly one labelling left. With two even or two odd counts the board
looks the same when turned by 180°, and a prediction has to choose. With two odd counts the colours also tell a mirrored view from a
direct one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..board import Board
from ..short_repr import ShortRepr
from .types import FloatArray, Via

# A predicted place chooses a labelling only if the second best is at least this much farther off.
MIN_PREDICTION_RATIO = 2.0


@dataclass(frozen=True, eq=False, repr=False)
class LabelledGrid(ShortRepr):
    """The labelled corners `(N, 2)` px, or the reason why they cannot be labelled (else empty)."""

    reason: str
    corners_px: FloatArray


def handedness(grid: FloatArray) -> float:
    """Sign of `det ∂(u, v)/∂(ix, iy)` of a grid (ny, nx, 2): −1 for a direct view's labels, +1 for a mirrored one's."""
    along_x = np.mean(np.diff(grid, axis=1), axis=(0, 1))
    along_y = np.mean(np.diff(grid, axis=0), axis=(0, 1))
    return float(np.sign(along_x[0] * along_y[1] - along_x[1] * along_y[0]))


def settle_labels(
    grid: FloatArray, dark_first: bool, board: Board, via: Via, predicted_px: FloatArray | None = None
) -> LabelledGrid:
    """Labels a detected grid `(ny, nx, 2)` whose square beyond (0, 0) is dark or not.

    `predicted_px` `(N, 2)`: expected corners, used only where handedness and colours leave a choice.
    """
    wanted_hand = 1.0 if via == "mirror" else -1.0
    right_hand = [
        (turned, dark)
        for turned, dark in _symmetries(grid, dark_first)
        if turned.shape[:2] == (board.rows, board.columns) and handedness(turned) == wanted_hand
    ]
    candidates = tuple(turned.reshape(-1, 2) for turned, dark in right_hand if dark)
    if len(candidates) == 1:
        return LabelledGrid("", candidates[0])
    if not candidates:
        return LabelledGrid(_colour_reason(board, via), grid.reshape(-1, 2))
    if predicted_px is not None and predicted_px.shape == candidates[0].shape:
        distance = np.array([np.sqrt(np.mean(np.sum((c - predicted_px) ** 2, axis=1))) for c in candidates])
        order = np.argsort(distance)
        if distance[order[1]] >= MIN_PREDICTION_RATIO * max(distance[order[0]], 1e-9):
            return LabelledGrid("", candidates[int(order[0])])
        return LabelledGrid(
            f"labels ambiguous: the predicted corners are {distance[order[0]]:.1f} px from the nearest labelling and "
            f"{distance[order[1]]:.1f} px from the next: predict closer",
            candidates[int(order[0])],
        )
    return LabelledGrid(_ambiguous_reason(board), candidates[0])


def _symmetries(grid: FloatArray, dark_first: bool) -> list[tuple[FloatArray, bool]]:
    """All flips and transpositions of a grid, each with whether the square beyond its first corner is dark."""
    ny, nx = grid.shape[:2]
    result = []
    for flip_x in (False, True):
        for flip_y in (False, True):
            turned = grid[:, ::-1] if flip_x else grid
            turned = turned[::-1] if flip_y else turned
            dark = dark_first == _same_colour_at_far_corner(flip_x, flip_y, nx, ny)
            result.append((np.ascontiguousarray(turned), dark))
            result.append((np.ascontiguousarray(turned.transpose(1, 0, 2)), dark))
    return result


def _same_colour_at_far_corner(flip_x: bool, flip_y: bool, nx: int, ny: int) -> bool:
    """Whether the corner square of the flipped grid has the colour of the unflipped one's: it lies n squares further each flipped way."""
    steps = (nx if flip_x else 0) + (ny if flip_y else 0)
    return steps % 2 == 0


def _colour_reason(board: Board, via: Via) -> str:
    if board.columns % 2 == 1 and board.rows % 2 == 1:
        other = "direct" if via == "mirror" else "mirror"
        return f"the squares' colours say that this view is '{other}', not '{via}'"
    return (
        "the square diagonally beyond corner 0 (towards −x, −y) is light at every possible corner 0; the session format wants it dark: "
        f"check [board] corners = [{board.columns}, {board.rows}]"
    )


def _ambiguous_reason(board: Board) -> str:
    return (
        f"labels ambiguous: a board of {board.columns} × {board.rows} inner corners looks the same turned by 180°; predict its place "
        "(from the camera–board transform), or print a board with an odd and an even count"
    )
