"""Markers that the model expects and whose colour shows no fitting region: they are searched in a wider range of their colour, and
in the dark in the picture as it would be in usual light, smoothed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
import numpy.typing as npt

from ..marker import Marker
from .blobs import Region, color_regions
from .types import color_of

# A marker without a fitting region of its colour is searched in a range this many times as wide in hue, and
# from these shares of its least saturation and value on.
WIDER_HUE = 1.8
WIDER_SATURATION = 0.8
WIDER_VALUE = 0.5
# The brightest hundredth of a picture in usual light, levels; below this share of it, it is dark. A board's white squares are among it.
USUAL_WHITE = 200.0
DARK_SHARE = 0.5
# Each so many-th pixel, across and down, tells how bright a picture is.
TELLING_PIXELS = 8
# In the dark a pixel's hue is noise: that of a Gaussian of this deviation is not, px. A ball may have no more than some px of radius.
SMOOTHING_PX = 2.0


def regions_in_wide_range(
    bgr: npt.NDArray[np.uint8], markers: Sequence[Marker], all_hues_deg: Sequence[float]
) -> list[tuple[Marker, tuple[Region, ...]]]:
    """Each marker with a wider range of its colour, and the regions that have it: the light is warmer, colder or dimmer than assumed."""
    wide = [_wide(marker, all_hues_deg) for marker in markers]
    return list(zip(wide, color_regions(bgr, [color_of(marker) for marker in wide]), strict=True))


def regions_in_the_dark(
    bgr: npt.NDArray[np.uint8], markers: Sequence[Marker], all_hues_deg: Sequence[float]
) -> list[tuple[Marker, tuple[Region, ...]]] | None:
    """The same in a dark picture, brightened to usual light and smoothed; None where the picture is not dark."""
    white = float(np.percentile(bgr[::TELLING_PIXELS, ::TELLING_PIXELS].max(axis=2), 99.0))
    if white >= DARK_SHARE * USUAL_WHITE:
        return None
    smooth = cv2.GaussianBlur(bgr.astype(np.float32), (0, 0), SMOOTHING_PX)
    usual = np.clip(smooth * np.float32(USUAL_WHITE / max(white, 1.0)) + 0.5, 0.0, 255.0).astype(np.uint8)
    return regions_in_wide_range(usual, markers, all_hues_deg)


def _wide(marker: Marker, all_hues_deg: Sequence[float]) -> Marker:
    """The marker with a wider range of its colour, half-way to the next other hue at most."""
    color = color_of(marker)
    away = [abs((hue - color.hue_deg + 180.0) % 360.0 - 180.0) for hue in all_hues_deg]
    most = 0.5 * min((a for a in away if a > 0.0), default=360.0)
    return replace(
        marker,
        color=replace(
            color,
            hue_tolerance_deg=max(
                color.hue_tolerance_deg, min(WIDER_HUE * color.hue_tolerance_deg, most, 180.0)
            ),
            min_saturation=WIDER_SATURATION * color.min_saturation,
            min_value=WIDER_VALUE * color.min_value,
        ),
    )
