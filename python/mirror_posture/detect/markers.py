"""Coloured balls: which region is which marker, its outline, its centre, and when not to trust it.

Candidates are the regions of the marker's colour. A predicted place chooses among them; without one, the reflection's distance bounds
the ball's size where camera, diameter and a board are known (the robot's own hand, seen without the mirror, is nearer and larger), and the
largest region wins, as in the paper. What remains doubtful is masked with its reason.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ..arguments import checked_arguments
from ..camera import Camera
from ..marker import Marker
from .ball import OutlineFit, Start, fit_circle, measure_balls
from .blobs import Region, color_regions, contour_px
from .candidates import NEARER_RADII, SIZE_FACTOR, Candidate, choose, find_candidates
from .marker_choice import Choice, SizeBounds, assign
from .marker_judge import MarkerOptions, doubted_size, from_region, judged, masked, nothing_reason
from .types import MarkerView, PredictedMarker, color_of

# Smallest outline that sub-pixel edges can be read from; below, the region's centroid is all there is.
MIN_OUTLINE_RADIUS_PX = 3.0
# A codec's blocks shift all edges of a side alike, by errors whose variance grows with its quantisation step (levels), at coarse steps with its square: from these steps on they are
# most of what the centre's variance has. Measured on balls of 7 to 40 px at JPEG qualities 98 to 20; where colour is coarser, most of it shows in the edges.
TELLING_STEP = 10.0
TELLING_COARSE_STEP = 11.0
TELLING_STEP_OF_COARSE_COLOUR = 30.0


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
    choices = assign(markers, candidates, predicted, bounds)
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
    if chroma_step_px == (1, 1):
        widened = 1.0 + max(quantisation_step / TELLING_STEP, (quantisation_step / TELLING_COARSE_STEP) ** 2)
    else:
        widened = 1.0 + (quantisation_step / TELLING_STEP_OF_COARSE_COLOUR) ** 2
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
    choice: Choice
    regions: tuple[Region, ...]
    hint: PredictedMarker | None = None
    candidates: tuple[Candidate, ...] = ()
    starts: tuple[Start, ...] = ()


def _job(
    marker: Marker,
    choice: Choice,
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
        return masked(marker, job.choice.reason or nothing_reason(bgr, marker), region)
    if marker.diameter_m == 0.0 or not options.use_outline:
        return from_region(marker, region)
    fit = fits[0] if fits else None
    if fit is None:
        return masked(marker, "its region has no outline that fits a ball", region)
    return judged(bgr, marker, region, fit, options)


def nominal_camera(width_px: int, height_px: int) -> Camera:
    """A camera of ordinary field of view (focal length = the picture's width), for fitting outlines where none is known.

    It only shapes the outline, how long an off-axis ball's ellipse is; a sphere's centre is not read from it.
    """
    focal = float(max(width_px, height_px))
    return Camera((width_px, height_px), (focal, focal), ((width_px - 1) / 2.0, (height_px - 1) / 2.0))


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
        return masked(marker, nothing_reason(bgr, marker), None)
    radius = float(hint.ball_radius_px or 0.0)
    if radius < MIN_OUTLINE_RADIUS_PX:
        return masked(
            marker,
            f"it would be {2.0 * radius:.1f} px wide there, needed {2.0 * MIN_OUTLINE_RADIUS_PX:.0f}: go nearer",
            None,
        )
    good: list[MarkerView] = []
    bad: list[MarkerView] = []
    for one, fit in zip(job.candidates, fits, strict=True):
        if fit is None:
            continue
        view = doubted_size(judged(bgr, marker, one.region, fit, options), fit, radius)
        if any(view.pixel_px is not None and _same_place(view, other, radius) for other in good):
            continue
        (good if view.ok else bad).append(view)
    if not good:
        if bad:
            return bad[0]
        return masked(
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
