"""The ghost of a pane in a picture, told by the board: its strength and where it lies.

The board's pattern is blurred in several ways; the core fits the light by it.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from .. import _core
from .drawn import DrawnBoard
from .ghost_light import Ghost, Pane, linear_light, moved_by
from .types import Pixels

# Blurs of the drawn pattern that are tried, px.
BLURS_PX = (0.45, 0.7, 1.0, 1.4, 2.0)
# The farthest ghost that is looked for, px, and as a share of a square; the nearest, below which it looks like blur.
REACH_PX, REACH_SQUARES = 7, 0.6
NEAREST_PX = 1.9


def board_ghost(drawn: DrawnBoard, pane: Pane | None = None) -> Ghost | None:
    """The ghost that a drawn board shows, of strength 0 where it shows none; None where the board is too small to determine it. Where it lies as one of a `pane` does, the odds of the two are told too: a pane's differs across the board."""
    reach = min(REACH_PX, int(REACH_SQUARES * 0.5 * drawn.side_px))
    if reach < NEAREST_PX or min(drawn.size) < 4 * reach:
        return None

    def without_shade(values: Pixels) -> Pixels:
        result: Pixels = values - drawn.mean(values)
        return result

    models = [without_shade(cv2.GaussianBlur(drawn.pattern, (0, 0), blur)) for blur in BLURS_PX]
    found = _core.pattern_ghost(without_shade(linear_light(drawn.gray)), models, reach)
    if found is None:
        return None
    ghost = Ghost(found.strength, found.shift_px, found.weakest)
    if pane is None or ghost.strength == 0.0:
        return ghost
    return _or_of_pane(ghost, pane, found, drawn.corner, drawn.size)


def with_ghost(drawn: DrawnBoard, ghost: Ghost | None) -> DrawnBoard:
    """A drawn board whose pattern shows a ghost too: a lens mixes its light like all other."""
    if ghost is None or ghost.strength == 0.0:
        return drawn
    moved = moved_by(drawn.pattern, np.array(ghost.shift_px))
    both: Pixels = (1.0 - ghost.strength) * drawn.pattern + ghost.strength * moved
    return replace(drawn, pattern=both.astype(np.float32))


def _or_of_pane(
    ghost: Ghost, pane: Pane, found: _core.PatternGhost, corner: tuple[int, int], size: tuple[int, int]
) -> Ghost:
    """How probable it is that a ghost is the pane's, by what each explains."""
    right, bottom = size[0] - 1.0, size[1] - 1.0
    shift = np.array(ghost.shift_px)
    moved_m = pane.moved_m(np.array(corner) + 0.5 * np.array([right, bottom]), shift)
    # Between the region's corners the way changes evenly.
    ways = pane.way_px(
        np.array(corner) + np.array([[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]])
    )
    if moved_m is None or ways is None:
        return ghost
    by_pane, alike = found.explained_by(ways * moved_m), found.explained_by(np.tile(shift, (4, 1)))
    odds = float(np.clip(0.5 * (by_pane - alike), -30.0, 30.0))
    return replace(ghost, pane=pane, moved_m=moved_m, probability=float(1.0 / (1.0 + np.exp(-odds))))
