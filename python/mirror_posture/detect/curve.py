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

# Fewer balls than this cannot separate the camera's curve from their own shading.
LEAST_BALLS = 3
# The median of balls is known to no better than this many deviations.
LEAST_STD = 0.7
# Standard deviation of the median of normal numbers by the median of their sizes: 1.4826 for one, 1.25 for the median of several.
MEDIAN_STD = 1.25 * 1.4826


def curve_doubt(fits: Sequence[OutlineFit | None]) -> float:
    """How many times larger the curve's error may be than the covariances allow: what the balls' channels
    show beyond their scatter, at least 1."""
    told = [fit.curve_deviations for fit in fits if fit is not None and fit.curve_deviations is not None]
    if len(told) < LEAST_BALLS:
        return 1.0
    middle = float(np.median(told))
    std = MEDIAN_STD * float(np.median(np.abs(np.array(told) - middle))) / math.sqrt(len(told))
    return max(1.0, abs(middle) - max(LEAST_STD, std))


def with_curve_doubt(fit: OutlineFit | None, doubt: float) -> OutlineFit | None:
    """An outline whose covariance contains the curve's part this many times, instead of once: `C + (k² − 1)
    m mᵀ`, m the shift of the centre by one deviation."""
    if fit is None or doubt <= 1.0:
        return fit
    more = (doubt**2 - 1.0) * np.outer(fit.curve_moved_px, fit.curve_moved_px)
    return replace(fit, centroid_covariance_px2=fit.centroid_covariance_px2 + more)
