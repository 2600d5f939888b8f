"""Coloured balls: which region is which marker, its outline, its centre, and when not to trust it.

Candidates are the regions of the marker's colour. A predicted place chooses among them; without one, the reflection's distance bounds
the ball's size where camera, diameter and a board are known (the robot's own hand, seen without the mirror, is nearer and larger), and the
largest region wins, as in the paper. What remains doubtful is masked with its reason.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ..arguments import checked_arguments
from ..camera import Camera
from ..marker import Marker
from .ball import OutlineFit, Start, fit_circle, measure_balls
from .blobs import Region, color_regions, contour_px, hue_distance_deg, to_hsv
from .candidates import NEARER_RADII, SIZE_FACTOR, Candidate, choose, find_candidates
from .types import MarkerView, PredictedMarker, color_of

# A ball that is seen less than half is masked. The estimate of the seen share is itself good to a few hundredths (the hidden part is
# inferred from the outline), so the limit stands a little above one half.
MIN_VISIBLE_FRACTION = 0.54
# Least share of the outline that must agree with a ball: below, any bent edge can pose as an arc.
MIN_ARC_FRACTION = 0.3
# Edges of a ball agree to 0.1 px in clean pictures, 0.3 px in compressed and 0.5 px in very noisy ones.
MAX_OUTLINE_RESIDUAL_PX = 0.6
# Without a prediction, a second region of comparable size makes the choice doubtful.
RIVAL_AREA_RATIO = 0.6
# Smallest outline that sub-pixel edges can be read from; below, the region's centroid is all there is.
MIN_OUTLINE_RADIUS_PX = 3.0
# A region's centroid: what its edge shares and counting pixels does not show, px.
CENTRE_FLOOR_PX = 0.03
# A ball counts as whole and sharp from these shares on (of its area, its outline; blur against radius); others must have the expected size to this factor.
WHOLE_FRACTION = 0.93
WHOLE_ARC = 0.6
SHARP_SHARE = 0.2
PARTIAL_SIZE_FACTOR = 1.13
# A codec's blocks shift all edges of a side alike, by errors whose variance grows with the square of its quantisation step (levels): from this step on they are
# most of what the centre's variance has. Measured on balls of 15 to 40 px at JPEG qualities 98 to 20; where colour is coarser, most of it shows in the edges.
TELLING_STEP = 10.0
TELLING_STEP_OF_COARSE_COLOUR = 30.0
# Width of the outline's rim that is left out of the seen share.
RIM_PX = 0.8
# A white, blown-out pixel has all channels at or above this.
BLOWN_OUT_LEVEL = 250


@dataclass(frozen=True)
class SizeBounds:
    """Smallest and largest radius in px at which a marker's reflection can appear."""

    min_radius_px: float
    max_radius_px: float


@dataclass(frozen=True)
class MarkerOptions:
    """Limits for accepting a ball."""

    min_visible_fraction: float = MIN_VISIBLE_FRACTION
    min_arc_fraction: float = MIN_ARC_FRACTION
    max_outline_residual_px: float = MAX_OUTLINE_RESIDUAL_PX
    use_outline: bool = True


@dataclass(frozen=True)
class _Choice:
    region: Region | None
    reason: str


@checked_arguments
def detect_markers(
    bgr: npt.NDArray[np.uint8],
    markers: tuple[Marker, ...],
    camera: Camera | None = None,
    predictions: tuple[PredictedMarker, ...] = (),
    bounds: dict[str, SizeBounds] | None = None,
    options: MarkerOptions | None = None,
    chroma_step_px: tuple[int, int] = (1, 1),
    expected: tuple[PredictedMarker, ...] = (),
    quantisation_step: float = 0.0,
) -> tuple[MarkerView, ...]:
    """Detects each marker in a colour picture `(H, W, 3)` uint8 BGR, in the order given; masked ones carry their reason.

    `predictions` are fences: nothing outside of them is looked at. `expected` are hints, of a robot's model: place and size of each ball, either of which may be
    off. `chroma_step_px`: pixels across and down that share a colour, as the picture's codec has it;
    `quantisation_step`: its step of brightness, levels.
    """
    options = options or MarkerOptions()
    bounds = bounds or {}
    if not markers:
        return ()
    predicted = {one.name: one for one in predictions}
    regions = color_regions(bgr, [color_of(marker) for marker in markers])
    candidates = {marker.name: found for marker, found in zip(markers, regions, strict=True)}
    choices = _assign(markers, candidates, predicted, bounds)
    hints = {one.name: one for one in expected if one.ball_radius_px and one.name not in predicted}
    assumed = camera or nominal_camera(bgr.shape[1], bgr.shape[0])
    jobs = [
        _job(
            marker,
            choices[marker.name],
            candidates[marker.name],
            hints.get(marker.name) if camera is not None else None,
            bounds.get(marker.name),
            options,
        )
        for marker in markers
    ]
    # All outlines of the picture at once: the core shares them out.
    starts = [start for job in jobs for start in job.starts]
    telling = TELLING_STEP if chroma_step_px == (1, 1) else TELLING_STEP_OF_COARSE_COLOUR
    widened = 1.0 + (quantisation_step / telling) ** 2
    fits = iter(
        None if fit is None else replace(fit, centroid_covariance_px2=widened * fit.centroid_covariance_px2)
        for fit in measure_balls(bgr, starts, assumed, chroma_step_px)
    )
    views = []
    for job in jobs:
        view = _seen(bgr, job, [next(fits) for _ in job.starts], options)
        views.append(view if camera is not None else replace(view, sphere_center_px=None))
    return tuple(views)


@dataclass(frozen=True)
class _Job:
    """What is to be measured of one marker: by its hint the candidates, else the chosen region."""

    marker: Marker
    choice: _Choice
    regions: tuple[Region, ...]
    hint: PredictedMarker | None = None
    candidates: tuple[Candidate, ...] = ()
    starts: tuple[Start, ...] = ()


def _job(
    marker: Marker,
    choice: _Choice,
    regions: tuple[Region, ...],
    hint: PredictedMarker | None,
    bounds: SizeBounds | None,
    options: MarkerOptions,
) -> _Job:
    if marker.diameter_m <= 0.0 or not options.use_outline:
        return _Job(marker, choice, regions)
    if hint is not None:
        radius = float(hint.ball_radius_px or 0.0)
        found = (
            tuple(find_candidates(regions, hint, MIN_OUTLINE_RADIUS_PX))
            if radius >= MIN_OUTLINE_RADIUS_PX
            else ()
        )
        low, high = radius / (1.1 * SIZE_FACTOR), 1.1 * SIZE_FACTOR * radius
        return _Job(
            marker, choice, regions, hint, found, tuple(Start(one.circle, low, high) for one in found)
        )
    if choice.region is None or choice.reason:
        return _Job(marker, choice, regions)
    start = _start(choice.region, bounds)
    return _Job(marker, choice, regions, starts=() if start is None else (start,))


def _seen(
    bgr: npt.NDArray[np.uint8], job: _Job, fits: list[OutlineFit | None], options: MarkerOptions
) -> MarkerView:
    marker, region = job.marker, job.choice.region
    if job.hint is not None:
        return _by_hint(bgr, job, job.hint, fits, options)
    if region is None or job.choice.reason:
        return _masked(marker, job.choice.reason or _nothing_reason(bgr, marker), region)
    if marker.diameter_m == 0.0 or not options.use_outline:
        return _from_region(marker, region)
    fit = fits[0] if fits else None
    if fit is None:
        return _masked(marker, "its region has no outline that fits a ball", region)
    return _judged(bgr, marker, region, fit, options)


def nominal_camera(width_px: int, height_px: int) -> Camera:
    """A camera of ordinary field of view (focal length = the picture's width), for fitting outlines where none is known.

    It only shapes the outline, how long an off-axis ball's ellipse is; a sphere's centre is not read from it.
    """
    focal = float(max(width_px, height_px))
    return Camera((width_px, height_px), (focal, focal), ((width_px - 1) / 2.0, (height_px - 1) / 2.0))


def _assign(
    markers: tuple[Marker, ...],
    candidates: dict[str, tuple[Region, ...]],
    predicted: dict[str, PredictedMarker],
    bounds: dict[str, SizeBounds],
) -> dict[str, _Choice]:
    """One region for each marker, no region for two: predicted ones first, the nearest pair first."""
    taken: dict[tuple[int, int, int, int], str] = {}
    choices: dict[str, _Choice] = {}
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
            choices[name] = _Choice(region, "")
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
            choices[marker.name] = _Choice(None, reason)
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
) -> _Choice:
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
            return _Choice(
                None,
                f"{len(regions)} regions of its colour, none of a ball's size there (radius {bounds.min_radius_px:.1f} to "
                f"{bounds.max_radius_px:.1f} px; the largest has {regions[0].equivalent_radius_px:.1f} px)",
            )
        return _Choice(None, "")
    if twins:
        return _Choice(
            fitting[0],
            f"shares its colour with {', '.join(sorted(twins))}: predict its place, or give it another hue",
        )
    rivals = [region for region in fitting[1:] if region.area_px >= RIVAL_AREA_RATIO * fitting[0].area_px]
    if rivals:
        u, v = rivals[0].centroid_px
        return _Choice(
            fitting[0],
            f"{len(rivals) + 1} regions of its colour and of like size (another at ({u:.0f}, {v:.0f})): predict its place",
        )
    return _Choice(fitting[0], "")


def _size_fits(region: Region, bounds: SizeBounds | None) -> bool:
    """A region may be smaller than its ball (hidden in part, dark in part), down to a fifth of the area, but hardly larger."""
    if bounds is None:
        return True
    radius = region.equivalent_radius_px
    return 0.45 * bounds.min_radius_px <= radius <= 1.05 * bounds.max_radius_px


def _nothing_reason(bgr: npt.NDArray[np.uint8], marker: Marker) -> str:
    blown = float(np.mean(np.all(bgr >= BLOWN_OUT_LEVEL, axis=2)))
    color = color_of(marker)
    text = (
        f"no region of its colour (hue {color.hue_deg:.0f} ± {color.hue_tolerance_deg:.0f}°, saturation ≥ {color.min_saturation:.2f}, "
        f"value ≥ {color.min_value:.2f})"
    )
    if blown > 0.02:
        return f"{text}; {100.0 * blown:.0f} % of the picture is blown out: lower the exposure"
    return f"{text}: hidden, out of the picture, or the colour's box does not fit the light"


def _masked(marker: Marker, reason: str, region: Region | None, **fields: Any) -> MarkerView:
    if region is not None:
        fields.setdefault("pixel_px", region.centroid_px)
        fields.setdefault("center_kind", "region_centroid")
        fields["region_area_px"] = region.area_px
        fields["region_centroid_px"] = region.centroid_px
    return MarkerView(marker.name, False, reason, **fields)


def _from_region(marker: Marker, region: Region) -> MarkerView:
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


def _by_hint(
    bgr: npt.NDArray[np.uint8],
    job: _Job,
    hint: PredictedMarker,
    fits: list[OutlineFit | None],
    options: MarkerOptions,
) -> MarkerView:
    """The one ball of the size that the model expects, nearest to where it expects it."""
    marker, regions = job.marker, job.regions
    if not regions:
        return _masked(marker, _nothing_reason(bgr, marker), None)
    radius = float(hint.ball_radius_px or 0.0)
    if radius < MIN_OUTLINE_RADIUS_PX:
        return _masked(
            marker,
            f"it would be {2.0 * radius:.1f} px wide there, needed {2.0 * MIN_OUTLINE_RADIUS_PX:.0f}: go nearer",
            None,
        )
    good: list[MarkerView] = []
    bad: list[MarkerView] = []
    for one, fit in zip(job.candidates, fits, strict=True):
        if fit is None:
            continue
        view = _doubted_size(_judged(bgr, marker, one.region, fit, options), fit, radius)
        if any(view.pixel_px is not None and _same_place(view, other, radius) for other in good):
            continue
        (good if view.ok else bad).append(view)
    if not good:
        if bad:
            return bad[0]
        return _masked(
            marker,
            f"{len(regions)} regions of its colour, none with the outline of a ball of the size that it has there (radius {radius:.1f} px, the largest region's "
            f"{regions[0].equivalent_radius_px:.1f} px)",
            regions[0],
        )
    index, reason = choose([np.array(view.pixel_px) for view in good], hint)
    if index >= 0:
        nearer = _nearer(good[index], bad, hint)
        return good[index] if nearer is None else replace(good[index], ok=False, reason=nearer)
    return replace(good[0], ok=False, reason=reason)


def _nearer(view: MarkerView, bad: list[MarkerView], hint: PredictedMarker) -> str | None:
    """Why a ball is doubted: one that cannot be measured is clearly nearer to where the model expects it."""

    def away(one: MarkerView) -> float:
        assert one.pixel_px is not None
        return float(np.hypot(one.pixel_px[0] - hint.pixel_px[0], one.pixel_px[1] - hint.pixel_px[1]))

    radius = float(hint.ball_radius_px or 0.0)
    for other in bad:
        if other.pixel_px is not None and away(other) + NEARER_RADII * radius < away(view):
            u, v = other.pixel_px
            return f"another of its colour is nearer to where the model expects it, at ({u:.0f}, {v:.0f}), and cannot be measured: {other.reason}"
    return None


def _same_place(one: MarkerView, other: MarkerView, radius_px: float) -> bool:
    """Whether two outlines are of one ball, found from two starts."""
    return (
        one.pixel_px is not None
        and other.pixel_px is not None
        and (
            float(np.hypot(one.pixel_px[0] - other.pixel_px[0], one.pixel_px[1] - other.pixel_px[1]))
            < 0.5 * radius_px
        )
    )


def _doubted_size(view: MarkerView, fit: OutlineFit, expected_px: float) -> MarkerView:
    """A ball that is seen in part, or blurred, is believed only if it has the size that the model expects: half an outline fits many circles."""
    ratio = fit.mean_radius_px / expected_px
    whole = (view.visible_fraction or 0.0) >= WHOLE_FRACTION and fit.arc_fraction >= WHOLE_ARC
    sharp = fit.blur_px <= SHARP_SHARE * fit.mean_radius_px
    if not view.ok or (whole and sharp) or 1.0 / PARTIAL_SIZE_FACTOR <= ratio <= PARTIAL_SIZE_FACTOR:
        return view
    how = "seen in part" if sharp else "blurred"
    return replace(
        view,
        ok=False,
        reason=f"{how} and {ratio:.2f} times as large as the model expects it ({expected_px:.1f} px radius): another thing, or a wrong part of its outline",
    )


def _judged(
    bgr: npt.NDArray[np.uint8], marker: Marker, region: Region, fit: OutlineFit, options: MarkerOptions
) -> MarkerView:
    """A measured outline as a view, masked where it cannot be trusted."""
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
    reason = ""
    if seen < options.min_visible_fraction:
        reason = f"only {100.0 * seen:.0f} % of the ball is seen, needed {100.0 * options.min_visible_fraction:.0f} %"
    elif fit.arc_fraction < options.min_arc_fraction:
        reason = f"only {100.0 * fit.arc_fraction:.0f} % of its outline fits a ball, needed {100.0 * options.min_arc_fraction:.0f} %"
    elif fit.residual_rms_px > options.max_outline_residual_px:
        reason = f"outline residual {fit.residual_rms_px:.2f} px is above the limit of {options.max_outline_residual_px:.2f} px"
    return MarkerView(marker.name, not reason, reason, **fields)


def _start(region: Region, bounds: SizeBounds | None = None) -> Start | None:
    """Where to look for a region's outline: a robust circle through its contour."""
    coarse = region.equivalent_radius_px
    low = 0.8 * coarse if bounds is None else max(0.8 * bounds.min_radius_px, 0.8 * coarse)
    high = 2.5 * coarse if bounds is None else 1.2 * bounds.max_radius_px
    if high <= low:
        return None
    circle = fit_circle(contour_px(region), low, high, 1.0)
    if circle is None or circle.radius_px < MIN_OUTLINE_RADIUS_PX:
        return None
    return Start(circle, low, high)


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
    # A highlight is white but lies within the ball: what the coloured part encloses counts as seen.
    seen = cv2.morphologyEx((coloured & part).astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    return float((seen.astype(bool) & part).sum()) / total
