"""Coloured regions: colour extraction in HSV and labelling, as the paper finds its markers.

Hue is circular, in degrees; saturation and value are in 0..1. The paper takes the largest labelled region's centroid. Here that is
the start: `outline` measures the ball's outline from it, which shading does not move.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from ..marker import ColorRange
from ..short_repr import ShortRepr
from .types import FloatArray

# Regions smaller than this are noise or too small to measure.
MIN_REGION_AREA_PX = 12
# The most regions of one colour that are looked at, the largest first: more are texture, not balls.
MAX_REGIONS = 32
# Above any saturation or value.
_NO_LIMIT = 2.0


@dataclass(frozen=True, eq=False, repr=False)
class Region(ShortRepr):
    """A connected region of one colour: area and centroid, bounding box `(left, top, width, height)`, and its pixels in that box."""

    area_px: int
    centroid_px: tuple[float, float]
    box_px: tuple[int, int, int, int]
    mask: npt.NDArray[np.bool_]

    @property
    def equivalent_radius_px(self) -> float:
        """Radius of the disc of the same area."""
        return float(np.sqrt(self.area_px / np.pi))


def to_hsv(bgr: npt.NDArray[np.uint8]) -> npt.NDArray[np.float32]:
    """HSV of a colour picture, `(H, W, 3)` float32: hue in degrees [0, 360), saturation and value in 0..1."""
    result: npt.NDArray[np.float32] = cv2.cvtColor(
        bgr.astype(np.float32) * np.float32(1.0 / 255.0), cv2.COLOR_BGR2HSV
    )
    return result


def hue_distance_deg(hue_deg: npt.NDArray[np.float32], center_deg: float) -> npt.NDArray[np.float32]:
    """Circular distance of hues, degrees in [0, 180]."""
    result: npt.NDArray[np.float32] = np.abs(
        (hue_deg - np.float32(center_deg) + np.float32(180.0)) % np.float32(360.0) - np.float32(180.0)
    )
    return result


def color_mask(hsv: npt.NDArray[np.float32], color: ColorRange) -> npt.NDArray[np.bool_]:
    """Pixels of the colour, `(H, W)`."""
    low, high = color.hue_deg - color.hue_tolerance_deg, color.hue_deg + color.hue_tolerance_deg
    # Hue is a circle: its range may be two.
    parts = [(low, high), (low + 360.0, 360.0), (0.0, high - 360.0)]
    mask = np.zeros(hsv.shape[:2], dtype=np.uint8)
    for start, end in parts:
        if start <= end and start <= 360.0 and end >= 0.0:
            part = cv2.inRange(
                hsv, (start, color.min_saturation, color.min_value), (end, _NO_LIMIT, _NO_LIMIT)
            )
            mask |= part.astype(np.uint8)
    return mask.astype(np.bool_)


def label_regions(mask: npt.NDArray[np.bool_], min_area_px: int = MIN_REGION_AREA_PX) -> tuple[Region, ...]:
    """Connected regions (8 neighbours) of at least `min_area_px`, the largest first."""
    count, marked, stats, centroids = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    order = (
        [int(i) for i in np.argsort(-stats[1:, cv2.CC_STAT_AREA], kind="stable")[:MAX_REGIONS] + 1]
        if count > 1
        else []
    )
    regions = []
    for index in order:
        area = int(stats[index, cv2.CC_STAT_AREA])
        if area < min_area_px:
            break
        left, top, width, height = (int(value) for value in stats[index, :4])
        inside = marked[top : top + height, left : left + width] == index
        regions.append(
            Region(
                area,
                (float(centroids[index, 0]), float(centroids[index, 1])),
                (left, top, width, height),
                inside,
            )
        )
    return tuple(regions)


def largest_region(
    hsv: npt.NDArray[np.float32], color: ColorRange, min_area_px: int = MIN_REGION_AREA_PX
) -> Region | None:
    """The paper's detection: the largest region of the colour, or None."""
    regions = label_regions(color_mask(hsv, color), min_area_px)
    return regions[0] if regions else None


def contour_px(region: Region) -> FloatArray:
    """Outer boundary pixels of a region, `(N, 2)` px."""
    left, top, _, _ = region.box_px
    contours, _ = cv2.findContours(region.mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    longest = max(contours, key=len)
    result: FloatArray = longest.reshape(-1, 2).astype(np.float64) + np.array([left, top])
    return result
