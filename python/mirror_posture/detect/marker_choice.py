"""Assigns regions of a colour to markers: predicted ones first, the nearest pair first; otherwise the
largest of a fitting size, as in the paper.

An ambiguous assignment (two markers of one colour, two regions of similar size) has its reason.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..marker import Marker
from .blobs import Region, hue_distance_deg
from .types import PredictedMarker, color_of

# Without a prediction, a second region of comparable size makes the assignment ambiguous. If no board
# determines the ball's size there, a smaller one does too, because the larger may be another object.
RIVAL_AREA_RATIO = 0.6
RIVAL_AREA_RATIO_OF_UNKNOWN_SIZE = 0.1


@dataclass(frozen=True)
class SizeBounds:
    """Smallest and largest radius in px at which a marker's reflection can appear."""

    min_radius_px: float
    max_radius_px: float


@dataclass(frozen=True)
class Choice:
    """The region of a marker, if any, and why it is doubted."""

    region: Region | None
    reason: str


def assign(
    markers: tuple[Marker, ...],
    candidates: dict[str, tuple[Region, ...]],
    predicted: dict[str, PredictedMarker],
    bounds: dict[str, SizeBounds],
) -> dict[str, Choice]:
    """One region for each marker, no region for two: predicted ones first, the nearest pair first."""
    taken: dict[tuple[int, int, int, int], str] = {}
    choices: dict[str, Choice] = {}
    pairs = []
    for marker in markers:
        if marker.name not in predicted:
            continue
        place = predicted[marker.name]
        for region in candidates[marker.name]:
            away = float(
                np.hypot(region.centroid_px[0] - place.pixel_px[0], region.centroid_px[1] - place.pixel_px[1])
            )
            if away <= place.search_radius_px and _size_fits(region, bounds.get(marker.name)):
                pairs.append((away, marker.name, region))
    for _, name, region in sorted(pairs, key=lambda pair: pair[0]):
        if name not in choices and region.box_px not in taken:
            choices[name] = Choice(region, "")
            taken[region.box_px] = name
    for marker in markers:
        if marker.name in choices:
            continue
        if marker.name in predicted:
            place = predicted[marker.name]
            u, v = place.pixel_px
            reason = (
                f"no region of its colour within {place.search_radius_px:.0f} px of its predicted place ({u:.0f}, {v:.0f})"
                if candidates[marker.name]
                else ""
            )
            choices[marker.name] = Choice(None, reason)
            continue
        choices[marker.name] = _largest(
            marker, markers, candidates[marker.name], bounds.get(marker.name), taken
        )
    return choices


def _largest(
    marker: Marker,
    markers: tuple[Marker, ...],
    regions: tuple[Region, ...],
    bounds: SizeBounds | None,
    taken: dict[tuple[int, int, int, int], str],
) -> Choice:
    color = color_of(marker)
    twins = [
        other.name
        for other in markers
        if other.name != marker.name
        and float(hue_distance_deg(np.float32(color_of(other).hue_deg), color.hue_deg))
        <= max(color_of(other).hue_tolerance_deg, color.hue_tolerance_deg)
    ]
    fitting = [region for region in regions if region.box_px not in taken and _size_fits(region, bounds)]
    if not fitting:
        if regions and bounds is not None:
            return Choice(
                None,
                f"{len(regions)} regions of its colour, none of a ball's size there (radius {bounds.min_radius_px:.1f} to "
                f"{bounds.max_radius_px:.1f} px; the largest has {regions[0].equivalent_radius_px:.1f} px)",
            )
        return Choice(None, "")
    if twins:
        return Choice(
            fitting[0],
            f"shares its colour with {', '.join(sorted(twins))}: predict its place, or give it another hue",
        )
    ratio = RIVAL_AREA_RATIO_OF_UNKNOWN_SIZE if bounds is None else RIVAL_AREA_RATIO
    rivals = [region for region in fitting[1:] if region.area_px >= ratio * fitting[0].area_px]
    if rivals:
        u, v = rivals[0].centroid_px
        return Choice(
            fitting[0],
            f"{len(rivals) + 1} regions of its colour and of {'like' if bounds else 'unknown'} size (another at ({u:.0f}, {v:.0f})): predict its place",
        )
    return Choice(fitting[0], "")


def _size_fits(region: Region, bounds: SizeBounds | None) -> bool:
    """A region may be smaller than its ball (hidden in part, dark in part), down to a fifth of the area, but hardly larger."""
    if bounds is None:
        return True
    radius = region.equivalent_radius_px
    return 0.45 * bounds.min_radius_px <= radius <= 1.05 * bounds.max_radius_px
