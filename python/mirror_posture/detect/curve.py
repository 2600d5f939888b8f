"""The camera's tone curve as the balls of a picture show it, and its effect on their deviations.

Edges are read in linear light by sRGB's curve, and a ball's covariance allows for another one: an exponent
that differs by 8.5 % is one deviation. A camera with another curve, or with sharpening, separates the
channels of each edge. Shading does that too, but differently on each ball.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .ball import OutlineFit
from .medians import median

# Fewer balls than this cannot separate the camera's curve from their own shading.
LEAST_BALLS = 3
# The median of balls is known to no better than this many deviations: where it shows another curve; and, as they share their light, where it shows none.
LEAST_STD, LEAST_SHARED_STD = 0.7, 1.0
# Standard deviation of the median of normal numbers by the median of their sizes: 1.4826 for one, 1.25 for the median of several.
MEDIAN_STD = 1.25 * 1.4826


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
