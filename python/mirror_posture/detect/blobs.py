"""Coloured regions: colour extraction in HSV and labelling, as the paper finds its markers.

Hue is circular, in degrees; saturation and value are in 0..1. The paper takes the centroid of the largest
labelled region. Here that is the start: `outline` measures the ball's outline from it, which is insensitive
to shading. The core labels all colours of a picture in one pass.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from .. import _core
from ..marker import ColorRange
from ..short_repr import ShortRepr
from .types import FloatArray

# Regions smaller than this are noise or too small to measure.
MIN_REGION_AREA_PX = 12
# The largest number of regions of one colour that are returned, the largest regions first. A ball may be smaller than many other things of its colour; more than
# these are texture.
MAX_REGIONS = 500


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


def color_regions(
    bgr: npt.NDArray[np.uint8], colors: Sequence[ColorRange], min_area_px: int = MIN_REGION_AREA_PX
) -> list[tuple[Region, ...]]:
    """Connected regions (8 neighbours) of each colour in a picture `(H, W, 3)` BGR of at least `min_area_px`, the largest first."""
    boxes = [[c.hue_deg, c.hue_tolerance_deg, c.min_saturation, c.min_value] for c in colors]
    found = _core.color_regions(np.ascontiguousarray(bgr), boxes, min_area_px, MAX_REGIONS)
    return [
        tuple(
            Region(area, centroid, (box[0], box[1], box[2], box[3]), mask)
            for area, centroid, box, mask in regions
        )
        for regions in found
    ]


def contour_px(region: Region) -> FloatArray:
    """Outer boundary pixels of a region, `(N, 2)` px."""
    left, top, _, _ = region.box_px
    contours, _ = cv2.findContours(region.mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    longest = max(contours, key=len)
    result: FloatArray = longest.reshape(-1, 2).astype(np.float64) + np.array([left, top])
    return result
