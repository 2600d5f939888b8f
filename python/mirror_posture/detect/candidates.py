"""Circles of about a marker's size in the regions of its colour, the nearest to the place that the robot's model predicts first.

The prediction is only a hint, because the product looks for the model's errors: a region that is no ball, or does not have the ball's size at its distance, is
rejected. Which of those that are left is the marker, `rivals` decides.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..short_repr import ShortRepr
from .ball import Circle, fit_circle
from .blobs import Region, contour_px
from .types import FloatArray, PredictedMarker

# A ball's radius may differ from the model's by this factor: postures move it nearer or farther.
SIZE_FACTOR = 1.3
# The largest number of candidates of one marker that are measured, the most probable first.
MOST_MEASURED = 4
# A circle must hold this share of the contour that a ball of the expected size would show.
LEAST_ARC = 0.25
CONTOUR_TOLERANCE_PX = 1.2
# Circles looked for in one region: balls that touch, or a ball before something of its colour, make one region.
CIRCLES_A_REGION = 3


@dataclass(frozen=True, eq=False, repr=False)
class Candidate(ShortRepr):
    """A circle that may be the ball's outline, the region that it came from, and its distance from the expected place, px."""

    circle: Circle
    region: Region
    away_px: float


def find_candidates(
    regions: tuple[Region, ...], expected: PredictedMarker, least_radius_px: float
) -> list[Candidate]:
    """Circles of about the expected size in the contours of regions of the marker's colour, the most
    probable first."""
    radius = float(expected.ball_radius_px or 0.0)
    low, high = max(radius / SIZE_FACTOR, least_radius_px), radius * SIZE_FACTOR
    if high <= low:
        return []
    place = np.array(expected.pixel_px)
    # A hidden ball's region is small, but not tiny.
    fitting = [region for region in regions if region.equivalent_radius_px > 0.35 * radius]
    # A circle's centre is at most its radius from its region, so regions that are too far away for it need not be looked at.
    nearest = sorted((_least_away(region, place) - high, at) for at, region in enumerate(fitting))
    found: list[Candidate] = []
    for least, at in nearest:
        kept = _distinct(found)
        if len(kept) >= MOST_MEASURED and least > kept[MOST_MEASURED - 1].away_px:
            break
        found += _circles(fitting[at], place, low, high)
        found.sort(key=lambda one: one.away_px)
    return _distinct(found)[:MOST_MEASURED]


def _least_away(region: Region, place: FloatArray) -> float:
    """Distance of a place from a region's box, px; 0 within."""
    left, top, width, height = region.box_px
    low, high = np.array([left, top]), np.array([left + width - 1, top + height - 1])
    return float(np.linalg.norm(np.maximum(0.0, np.maximum(low - place, place - high))))


def _circles(region: Region, place: FloatArray, low: float, high: float) -> list[Candidate]:
    """Circles of a radius in the range in a region's contour, the one with the most of it first."""
    points = contour_px(region)
    found = []
    for _ in range(CIRCLES_A_REGION):
        circle = fit_circle(points, low, high, CONTOUR_TOLERANCE_PX)
        if circle is None:
            break
        away = np.linalg.norm(points - circle.center_px, axis=1) - circle.radius_px
        on = np.abs(away) <= CONTOUR_TOLERANCE_PX
        if on.sum() < LEAST_ARC * 2.0 * np.pi * circle.radius_px:
            break
        # The contour runs along the outermost pixels' centres: half a pixel inside of the outline.
        grown = Circle(circle.center_px, circle.radius_px + 0.5)
        found.append(Candidate(grown, region, float(np.linalg.norm(circle.center_px - place))))
        points = points[~on]
        if len(points) < 8:
            break
    return found


def _distinct(candidates: list[Candidate]) -> list[Candidate]:
    kept: list[Candidate] = []
    for one in candidates:
        if all(
            float(np.linalg.norm(one.circle.center_px - other.circle.center_px))
            > 0.5 * other.circle.radius_px
            for other in kept
        ):
            kept.append(one)
    return kept
