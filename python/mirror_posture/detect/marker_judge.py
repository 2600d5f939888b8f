"""Decides whether a ball's measurement is accepted: visible share, fit of its outline, and the reasons of
masked ones."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ..marker import Marker
from .ball import OutlineFit
from .blobs import Region, hue_distance_deg, to_hsv
from .types import MarkerView, color_of

# A ball with less than half visible is masked. The estimate of the visible share is accurate to a few
# hundredths (the hidden part is inferred from the outline), so the limit is slightly above one half.
MIN_VISIBLE_FRACTION = 0.54
# Least share of the outline that must agree with a ball: below, any bent edge can pose as an arc.
MIN_ARC_FRACTION = 0.3
# Edges of a ball agree to 0.1 px in clean pictures, 0.3 px in compressed and 0.5 px in very noisy ones.
MAX_OUTLINE_RESIDUAL_PX = 0.6
# A region's centroid: what its edge shares and counting pixels does not show, px.
CENTRE_FLOOR_PX = 0.03
# A ball counts as whole and sharp from these shares on (of its area, its outline; blur against radius).
# Others must have the expected size to this share, or to this many pixels: a model that is right to 3 cm at a
# metre predicts it to 3 %.
WHOLE_FRACTION = 0.93
WHOLE_ARC = 0.88
SHARP_SHARE = 0.2
PARTIAL_SIZE_SHARE = 0.05
PARTIAL_SIZE_PX = 0.3
# What colour at half of the resolution adds to the outline's residual, px, and each level of a codec's quantisation step to it and to the radius' share.
RESIDUAL_OF_COARSE_COLOUR_PX = 0.25
RESIDUAL_OF_STEP_PX = 0.02
SIZE_SHARE_OF_STEP = 0.003
# Blurred over more than this share of its radius, a ball must show more of its outline: bent edges of other things, blurred, fit many circles.
BLURRED_SHARE = 0.16
BLURRED_ARC = 0.48
MOSTLY_SEEN = 0.8
# How well the model knows a ball's size; the variance of a whole outline's radius against the centre's along an axis.
MODEL_SIZE_SHARE = 0.015
RADIUS_VARIANCE_SHARE = 0.5
# Width of the outline's rim that is left out of the seen share.
RIM_PX = 0.8
# A white, blown-out pixel has all channels at or above this.
BLOWN_OUT_LEVEL = 250


@dataclass(frozen=True)
class MarkerOptions:
    """Limits for accepting a ball."""

    min_visible_fraction: float = MIN_VISIBLE_FRACTION
    min_arc_fraction: float = MIN_ARC_FRACTION
    max_outline_residual_px: float = MAX_OUTLINE_RESIDUAL_PX
    use_outline: bool = True
    more_size_share: float = 0.0
    """How much more than usual the radius of a partly hidden or blurred ball may differ from the expected
    one, as a share."""

    def with_codec(self, quantisation_step: float, coarse_colour: bool) -> MarkerOptions:
        """These limits for coded pictures: a codec's errors move edges by more than a blur or a bent edge
        of another object does, and the claimed deviation contains that."""
        of_colour = RESIDUAL_OF_COARSE_COLOUR_PX if coarse_colour else 0.0
        return replace(
            self,
            max_outline_residual_px=self.max_outline_residual_px
            + of_colour
            + RESIDUAL_OF_STEP_PX * quantisation_step,
            more_size_share=self.more_size_share + SIZE_SHARE_OF_STEP * quantisation_step,
        )


def judged(
    bgr: npt.NDArray[np.uint8], marker: Marker, region: Region, fit: OutlineFit, options: MarkerOptions
) -> MarkerView:
    """A measured outline as a view, masked where it is not reliable."""
    seen = _visible_fraction(bgr, marker, fit)
    fields: dict[str, Any] = {
        "pixel_px": (float(fit.centroid_px[0]), float(fit.centroid_px[1])),
        "covariance_px2": fit.centroid_covariance_px2,
        "center_kind": "outline_centroid",
        "sphere_center_px": (float(fit.sphere_center_px[0]), float(fit.sphere_center_px[1])),
        "outline": fit.ellipse,
        "visible_fraction": seen,
        "residual_rms_px": fit.residual_rms_px,
        "region_area_px": region.area_px,
        "region_centroid_px": region.centroid_px,
    }
    # A ball that is seen in part must hold it against the codec's blur too.
    blur_px = fit.lens_blur_px if seen >= MOSTLY_SEEN else fit.blur_px
    reason = ""
    if seen < options.min_visible_fraction:
        reason = f"only {100.0 * seen:.0f} % of the ball is seen, needed {100.0 * options.min_visible_fraction:.0f} %"
    elif fit.arc_fraction < options.min_arc_fraction:
        reason = f"only {100.0 * fit.arc_fraction:.0f} % of its outline fits a ball, needed {100.0 * options.min_arc_fraction:.0f} %"
    elif blur_px > BLURRED_SHARE * fit.mean_radius_px and fit.arc_fraction < BLURRED_ARC:
        reason = (
            f"blurred over {blur_px:.1f} px of its radius of {fit.mean_radius_px:.1f} px, and only {100.0 * fit.arc_fraction:.0f} % of its outline fits a ball: "
            "light it better, or hold still"
        )
    elif fit.residual_rms_px > options.max_outline_residual_px:
        reason = f"outline residual {fit.residual_rms_px:.2f} px is above the limit of {options.max_outline_residual_px:.2f} px"
    return MarkerView(marker.name, not reason, reason, **fields)


def is_sharp(fit: OutlineFit) -> bool:
    return fit.blur_px <= SHARP_SHARE * fit.mean_radius_px


def size_share(expected_px: float, options: MarkerOptions) -> float:
    """The share by which the radius of a partly hidden ball may differ from the expected one."""
    return max(PARTIAL_SIZE_SHARE, PARTIAL_SIZE_PX / expected_px) + options.more_size_share


def doubted_size(view: MarkerView, fit: OutlineFit, expected_px: float, options: MarkerOptions) -> MarkerView:
    """A partly hidden or blurred ball is accepted only if it has the expected size, because half an outline
    fits many circles."""
    ratio = fit.mean_radius_px / expected_px
    whole = (view.visible_fraction or 0.0) >= WHOLE_FRACTION and fit.arc_fraction >= WHOLE_ARC
    sharp = is_sharp(fit)
    most = 1.0 + size_share(expected_px, options)
    if not view.ok or (whole and sharp) or 1.0 / most <= ratio <= most:
        return view
    how = "seen in part" if sharp else "blurred"
    return replace(
        view,
        ok=False,
        reason=f"{how} and {ratio:.2f} times as large as the model expects it ({expected_px:.1f} px radius): another thing, or a wrong part of its outline",
    )


def widened_by_size(view: MarkerView, fit: OutlineFit, expected_px: float) -> MarkerView:
    """A radius that differs from the expected one by more than both deviations shows that the edges' error
    is larger than claimed: the centre's covariance is scaled by `(r − r₀)² / (s_r² + s_model²)` where that
    is above 1."""
    if view.covariance_px2 is None:
        return view
    claimed = RADIUS_VARIANCE_SHARE * 0.5 * float(np.trace(view.covariance_px2))
    known = (MODEL_SIZE_SHARE * expected_px) ** 2
    ratio = (fit.mean_radius_px - expected_px) ** 2 / (claimed + known)
    return replace(view, covariance_px2=max(1.0, ratio) * view.covariance_px2)


def _visible_fraction(bgr: npt.NDArray[np.uint8], marker: Marker, fit: OutlineFit) -> float:
    """Share of the outline's area that shows the ball's colour, dark parts included (only hue and saturation count)."""
    height, width = bgr.shape[:2]
    low = np.floor(fit.boundary_px.min(axis=0)).astype(int) - 1
    high = np.ceil(fit.boundary_px.max(axis=0)).astype(int) + 2
    size = high - low
    if np.any(size <= 0) or np.any(size > 4 * max(height, width)):
        return 0.0
    inside = np.zeros((int(size[1]), int(size[0])), dtype=np.uint8)
    # fillPoly takes fixed-point coordinates: 4 fractional bits place the boundary to 1/16 px.
    # The rim is left out: its pixels are mixed, and would count as unseen.
    middle = fit.boundary_px.mean(axis=0)
    rim = middle + (fit.boundary_px - middle) * max(0.5, 1.0 - RIM_PX / max(fit.mean_radius_px, 1.0))
    cv2.fillPoly(inside, [np.rint((rim - low) * 16.0).astype(np.int32)], 1, shift=4)
    total = int(inside.sum())
    left, top = max(low[0], 0), max(low[1], 0)
    right, bottom = min(high[0], width), min(high[1], height)
    if total == 0 or right <= left or bottom <= top:
        return 0.0
    patch = to_hsv(bgr[top:bottom, left:right])
    part = inside[top - low[1] : bottom - low[1], left - low[0] : right - low[0]].astype(bool)
    color = color_of(marker)
    coloured = (patch[..., 1] >= 0.5 * color.min_saturation) & (
        hue_distance_deg(patch[..., 0], color.hue_deg) <= 1.5 * color.hue_tolerance_deg
    )
    # A highlight is white but inside the ball: what the coloured part encloses counts as visible.
    seen = cv2.morphologyEx((coloured & part).astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    return float((seen.astype(bool) & part).sum()) / total


def from_region(marker: Marker, region: Region) -> MarkerView:
    # The boundary's pixels are each in or out by chance: uniform over ±1/2 px along the outline, 2 π r of them.
    radius = max(region.equivalent_radius_px, 1.0)
    variance = (1.0 / 12.0) * (2.0 * np.pi * radius) / (
        np.pi * radius**2
    ) ** 2 * radius**2 + CENTRE_FLOOR_PX**2
    return MarkerView(
        marker.name,
        True,
        "",
        pixel_px=region.centroid_px,
        covariance_px2=np.eye(2) * variance,
        center_kind="region_centroid",
        region_area_px=region.area_px,
        region_centroid_px=region.centroid_px,
    )


def masked(marker: Marker, reason: str, region: Region | None, **fields: Any) -> MarkerView:
    if region is not None:
        fields.setdefault("pixel_px", region.centroid_px)
        fields.setdefault("center_kind", "region_centroid")
        fields["region_area_px"] = region.area_px
        fields["region_centroid_px"] = region.centroid_px
    return MarkerView(marker.name, False, reason, **fields)


def nothing_reason(bgr: npt.NDArray[np.uint8], marker: Marker) -> str:
    blown = float(np.mean(np.all(bgr >= BLOWN_OUT_LEVEL, axis=2)))
    color = color_of(marker)
    text = (
        f"no region of its colour (hue {color.hue_deg:.0f} ± {color.hue_tolerance_deg:.0f}°, saturation ≥ {color.min_saturation:.2f}, "
        f"value ≥ {color.min_value:.2f})"
    )
    if blown > 0.02:
        return f"{text}; {100.0 * blown:.0f} % of the picture is blown out: lower the exposure"
    return f"{text}: hidden, out of the picture, or the colour's box does not fit the light"
