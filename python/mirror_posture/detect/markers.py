"""Coloured balls: the region of each marker, its outline, its centre, and when it is masked.

Candidates are the regions of the marker's colour. A predicted place selects among them. Without one, the
reflection's distance bounds the ball's size if camera, diameter and a board are known (the robot's own
hand, seen without the mirror, is nearer and larger), and the largest region is taken, as in the paper.
Uncertain ones are masked with their reason.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import numpy.typing as npt

from ..arguments import checked_arguments
from ..camera import Camera
from ..marker import Marker
from .ball import OutlineFit, Start, fit_circle, measure_balls
from .blobs import Region, color_regions, contour_px
from .blurred import MOST_QUANTISATION_STEP, Expected, with_blurred
from .by_hint import MIN_OUTLINE_RADIUS_PX, Found, Measured, found_by_hint
from .candidates import SIZE_FACTOR, Candidate, find_candidates
from .curve import Curve, curve_doubt, with_curve_doubt
from .ghost_light import Ghost, with_ghost_left, without_ghost
from .marker_choice import Choice, SizeBounds, assign
from .marker_judge import (
    MarkerOptions,
    from_region,
    judged,
    masked,
    nothing_reason,
)
from .recoded import LEAST_STEP, Codec, with_codec_errors
from .rivals import ModelErrors, errors_elsewhere
from .sharpening import without_sharpening
from .types import MarkerView, PredictedMarker, color_of
from .wider_search import regions_in_the_dark, regions_in_wide_range

# A codec's blocks shift all edges of a side alike, by errors whose variance grows with its quantisation step
# (levels): from these steps on they are most of the centre's variance; less than where colour is fine,
# because coarse colour has additional errors. Measured on balls of 7 to 40 px at JPEG qualities 98 to 20.
TELLING_STEP = 13.0
TELLING_STEP_OF_COARSE_COLOUR = 16.0
# The step of a codec of coarse colour that does not tell it (a decoded frame, WebP), levels: that of JPEG quality 92.
USUAL_STEP = 2.2
# From this step on a codec has kept so little of the colour's detail that it is read as at half of the resolution, whatever the file says: at 4:4:4 and quality 92, 0.055 px against 0.073.
COARSE_COLOUR_STEP = 1.5

# A search for markers, told all markers' hues: each with the range of colour that was searched and the regions that have it; None where there is nothing to search.
Search = Callable[[Sequence[Marker], Sequence[float]], list[tuple[Marker, tuple[Region, ...]]] | None]


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
    ghost: Ghost | None = None,
    codec: Codec | None = None,
    sharpening_px2: float = 0.0,
    curve: Curve | None = None,
) -> tuple[MarkerView, ...]:
    """Detects each marker in a colour picture `(H, W, 3)` uint8 BGR, in the given order; masked ones have
    their reason.

    `predictions` are fences: nothing outside of them is looked at. `expected` are hints, of a robot's model: place and size of each ball, either of which may be
    off. `chroma_step_px`: pixels across and down that share a colour, as the picture's codec has it;
    `quantisation_step`: its step of brightness, levels; `codec`: how it was coded, where the file tells it. `ghost`: the second picture that a pane shows, which is
    taken off; `sharpening_px2`: the strength of the camera's sharpening, which is undone; `curve`: its tone curve, where the board shows it.
    """
    options = (options or MarkerOptions()).with_codec(quantisation_step, chroma_step_px != (1, 1))
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
    sampled = codec if quantisation_step >= LEAST_STEP else None
    if chroma_step_px == (1, 1) and quantisation_step >= COARSE_COLOUR_STEP:
        chroma_step_px = (2, 2)
    if chroma_step_px == (1, 1):
        widened = 1.0 + quantisation_step / TELLING_STEP
    else:
        widened = 1.0 + (quantisation_step or USUAL_STEP) / TELLING_STEP_OF_COARSE_COLOUR
    if sampled is not None:
        widened = 1.0

    bent = 0.0 if curve is None else curve.deviations
    blurs_px: dict[tuple[float, float], float] = {}

    def measured(starts: list[Start]) -> list[OutlineFit | None]:
        circles = [start.circle for start in starts]
        found = measure_balls(
            without_ghost(without_sharpening(bgr, sharpening_px2, circles), ghost, circles),
            starts,
            assumed,
            chroma_step_px,
            bent,
        )
        for fit in found:
            if fit is not None and fit.narrow_blur_px == fit.blur_px:
                blurs_px[float(fit.centroid_px[0]), float(fit.centroid_px[1])] = fit.blur_px
        return [
            None
            if fit is None
            else with_ghost_left(
                replace(fit, centroid_covariance_px2=widened * fit.centroid_covariance_px2),
                ghost,
                chroma_step_px != (1, 1),
            )
            for fit in found
        ]

    found = measured(starts)
    doubt = curve_doubt(found) if curve is None else curve.std
    fits = iter([with_curve_doubt(fit, doubt) for fit in found])
    fits_of = [[next(fits) for _ in job.starts] for job in jobs]

    def again(starts: list[Start]) -> list[OutlineFit | None]:
        return [with_curve_doubt(fit, doubt) for fit in measured(starts)]

    coded = chroma_step_px != (1, 1)
    focal_px = assumed.mean_focal_px
    seen = [_seen(bgr, job, own, options, again, coded) for job, own in zip(jobs, fits_of, strict=True)]
    # All balls together tell how far the model is off.
    offs_m = [one.off_m(focal_px) for one in seen]
    elsewhere = [errors_elsewhere(offs_m, index) for index in range(len(seen))]
    views = [one.chosen(focal_px, others) for one, others in zip(seen, elsewhere, strict=True)]
    for search in (regions_in_wide_range, regions_in_the_dark):
        for index, job in _searched_again(jobs, views, options, partial(search, bgr)):
            own = again(list(job.starts))
            view = _seen(bgr, job, own, options, again, coded).chosen(focal_px, elsewhere[index])
            if view.ok or not jobs[index].starts:
                jobs[index], fits_of[index], views[index] = job, own, view
    by_rays = views
    if quantisation_step <= MOST_QUANTISATION_STEP:
        wanted = [_expected(job, others) for job, others in zip(jobs, elsewhere, strict=True)]
        views = with_blurred(bgr, wanted, fits_of, views, assumed, options, coded, ghost, bent)
    if sampled is not None:
        recoded = with_codec_errors(bgr, by_rays, sampled, assumed, chroma_step_px, blurs_px)
        views = [new if old is view else view for old, new, view in zip(by_rays, recoded, views, strict=True)]
    if camera is None:
        views = [replace(view, sphere_center_px=None) for view in views]
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


def _expected(job: _Job, elsewhere: ModelErrors) -> Expected | None:
    if job.hint is None or (job.hint.ball_radius_px or 0.0) < MIN_OUTLINE_RADIUS_PX:
        return None
    return Expected(job.marker, job.regions, job.hint, elsewhere)


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


def _searched_again(
    jobs: list[_Job], views: list[MarkerView], options: MarkerOptions, search: Search
) -> list[tuple[int, _Job]]:
    """Markers with a place and size from the model that are not found, by index, with what a wider search shows.

    If a part of the ball had its colour, that part determines the visible share as before.
    """
    hues = [color_of(job.marker).hue_deg for job in jobs]
    poor = [
        index
        for index, (job, view) in enumerate(zip(jobs, views, strict=True))
        if not view.ok
        and job.hint is not None
        and job.marker.diameter_m > 0.0
        and options.use_outline
        and (job.hint.ball_radius_px or 0.0) >= MIN_OUTLINE_RADIUS_PX
    ]
    found = search([jobs[index].marker for index in poor], hues) if poor else None
    result = []
    for index, (marker, regions) in zip(poor, found or [], strict=found is not None):
        own = jobs[index].marker if jobs[index].starts else marker
        job = _job(own, jobs[index].choice, regions, jobs[index].hint, None, options)
        if job.starts:
            result.append((index, job))
    return result


def _seen(
    bgr: npt.NDArray[np.uint8],
    job: _Job,
    fits: list[OutlineFit | None],
    options: MarkerOptions,
    measured: Measured,
    coded: bool,
) -> Found:
    marker = job.marker
    if job.hint is not None:
        return found_by_hint(
            bgr, marker, job.regions, job.hint, job.candidates, fits, options, measured, coded
        )
    return Found(_without_hint(bgr, job, fits, options))


def _without_hint(
    bgr: npt.NDArray[np.uint8], job: _Job, fits: list[OutlineFit | None], options: MarkerOptions
) -> MarkerView:
    marker, region = job.marker, job.choice.region
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
