"""The camera's tone curve, as the board or the balls of a picture show it, and its effect on the balls.

Edges are read in linear light by sRGB's curve, and a ball's covariance allows for another one: an exponent
that differs by 8.5 % is one deviation. The board's pattern tells the curve (the core's `pattern_curve`): edges
are then read by it, and what it leaves unknown remains in the covariances.

Without a board the balls' channels tell something of it: a camera with another curve, or with sharpening,
separates the channels of each edge. Shading does that too, but differently on each ball.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .. import _core
from ..board import Board
from ..medians import median
from .ball import OutlineFit
from .drawn import DrawnBoard
from .ghost import with_ghost
from .ghost_light import Ghost
from .sharpening import MOST_STRENGTH_PX2, falling, undone

# Fewer balls than this cannot separate the camera's curve from their own shading.
LEAST_BALLS = 3
# The median of balls is known to no better than this many deviations: where it shows another curve; and, as they share their light, where it shows none.
LEAST_STD, LEAST_SHARED_STD = 0.7, 1.0
# Standard deviation of the median of normal numbers by the median of their sizes: 1.4826 for one, 1.25 for the median of several.
MEDIAN_STD = 1.25 * 1.4826
# Printed lines are wider than drawn by up to a dot of 600 dpi (0.042 mm), squares by up to half of that at each edge: the root of its mean square, m.
INK_M = 1.2e-5
# One deviation of the curve looks like so much sharpening in sharp pictures, px² (0.05 to 0.09), by whose strength for sRGB's curve the board is read.
SHARPENING_STD_PX2 = 0.07


@dataclass(frozen=True)
class Curve:
    """A camera's tone curve: by how many deviations it differs from sRGB's, and how many of these remain unknown."""

    deviations: float
    std: float


def board_curve(drawn: DrawnBoard, board: Board, ghost: Ghost | None, sharpening_px2: float) -> Curve | None:
    """The curve of the camera that took a drawn board, whose ghost and sharpening are known; None where the board does not tell it.

    Before, it is N(0, 1), or as wide as what the board shows demands: τ² = max(1, x² − s²). Then it is N(x τ², s² τ²) / (τ² + s²), x and s by the board.
    """
    if sharpening_px2 >= MOST_STRENGTH_PX2:
        # More than cameras sharpen: the picture was enlarged, or blurred otherwise than it is drawn.
        return None
    levels = np.ascontiguousarray(undone(drawn.gray, sharpening_px2))
    found = _core.pattern_curve(
        levels,
        with_ghost(drawn, ghost).pattern,
        # (An edge is half of that long, and has pixels on both of its sides.)
        drawn.side_px,
        INK_M / board.square_m * 0.5 * drawn.side_px,
        (falling(levels, sharpening_px2), SHARPENING_STD_PX2) if sharpening_px2 > 0.0 else None,
    )
    if found is None:
        return None
    shown, std = found
    before = max(1.0, shown**2 - std**2)
    share = before / (before + std**2)
    return Curve(shown * share, std * math.sqrt(share))


def curve_doubt(fits: Sequence[OutlineFit | None]) -> float:
    """How many times the curve's error may be what the covariances allow for; 1 where the balls' channels show nothing.

    Before, it is N(0, 1); the balls' median x is N(error, s²), s by their scatter: root of the mean square of N(x / (1 + s²), s² / (1 + s²)). A curve that is far
    from the usual ones is doubted by all that x shows beyond its deviation.
    """
    told = [fit.curve_deviations for fit in fits if fit is not None and fit.curve_deviations is not None]
    if len(told) < LEAST_BALLS:
        return 1.0
    middle = median(told)
    spread = MEDIAN_STD * median(np.abs(np.array(told) - middle)) / math.sqrt(len(told))
    variance = max(LEAST_SHARED_STD, spread) ** 2
    known = math.hypot(middle / (1.0 + variance), math.sqrt(variance / (1.0 + variance)))
    return max(known, abs(middle) - max(LEAST_STD, spread))


def with_curve_doubt(fit: OutlineFit | None, doubt: float) -> OutlineFit | None:
    """An outline whose covariance contains the curve's part this many times, instead of once: `C + (k² − 1)
    m mᵀ`, m the shift of the centre by one deviation."""
    if fit is None or doubt == 1.0:
        return fit
    more = (doubt**2 - 1.0) * np.outer(fit.curve_moved_px, fit.curve_moved_px)
    return replace(fit, centroid_covariance_px2=fit.centroid_covariance_px2 + more)
