"""Balls that are blurred over much of their radius (motion, defocus): measured as a whole, from all of
their pixels.

Rays read a ball's colour inside of its blurred rim. Where the blur leaves nothing inside, the image of a
shaded ball, moved and blurred, is fitted instead; the model must give its size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..camera import Camera
from ..marker import Marker
from ..medians import median
from ..short_repr import ShortRepr
from .ball import Circle, OutlineFit, measure_blurred_balls
from .blobs import Region
from .ghost_light import Ghost, with_ghost_left, without_ghost
from .marker_judge import BLURRED_SHARE, MarkerOptions, judged
from .rivals import NO_OTHERS, ModelErrors, Rival, choose
from .types import MarkerView, PredictedMarker

# From this blur of the picture's balls on, px and as a share of the radius, a ball is also measured as a whole.
LEAST_TRIED_BLUR_PX = 0.9
TRIED_BLUR_SHARE = 0.11
# How well the model knows the ball's size for this, and how far from it the fit may end.
KNOWN_SIZE_SHARE = 0.03
SIZE_SHARE = 0.08
# Regions that may be the ball, by the radius of a disc of their area against the expected one (a smear is larger); how many are tried, the nearest first.
REGION_SIZES = (0.45, 1.7)
MOST_REGIONS = 2
# Least share of the rim whose pixels must fit, and the largest deviation, as a share of the radius.
LEAST_RIM = 0.6
MOST_STD_SHARE = 0.12
# A ball that is hidden in part looks like one that has moved: so much of it must be seen.
LEAST_SEEN = 0.88
# A ball is blurred from this share of its radius on where the codec blurs its colour.
CODED_BLURRED_SHARE = 0.23
# A blur is a motion's where it is so much narrower in one direction, and too much for rays from this share of the radius on.
MOVED_SHARE = 0.6
MUCH_MOVED_SHARE = 0.26
# Coarser than this (levels), a codec's blocks are no blur.
MOST_QUANTISATION_STEP = 6.0


@dataclass(frozen=True, eq=False, repr=False)
class Blurred(ShortRepr):
    """A ball measured as a whole, and whether it, or the camera, moved by much of its radius."""

    view: MarkerView
    moved: bool


@dataclass(frozen=True, eq=False, repr=False)
class Expected(ShortRepr):
    """A marker, the regions of its colour, where and how large the model expects its ball, and how far the model is off elsewhere in the picture."""

    marker: Marker
    regions: tuple[Region, ...]
    hint: PredictedMarker
    elsewhere: ModelErrors = NO_OTHERS

    @property
    def radius_px(self) -> float:
        return float(self.hint.ball_radius_px or 0.0)


def with_blurred(
    bgr: npt.NDArray[np.uint8],
    wanted: Sequence[Expected | None],
    fits: Sequence[Sequence[OutlineFit | None]],
    views: list[MarkerView],
    camera: Camera,
    options: MarkerOptions,
    coded: bool,
    ghost: Ghost | None = None,
    curve: float = 0.0,
) -> list[MarkerView]:
    """Views by the rays; balls measured as a whole replace them where something moved by much of its
    radius, where they claim a smaller deviation, or where the rays fail.

    `fits` are all outlines by the rays, by marker; `curve` as in `measure_balls`.
    """
    # One blurred ball among sharp ones is partly hidden, or another object.
    shown = [fit.lens_blur_px for own in fits for fit in own if fit is not None]
    blur_px = median(shown) if shown else np.inf
    if blur_px < LEAST_TRIED_BLUR_PX:
        return views
    tried = {
        index: one
        for index, one in enumerate(wanted)
        if one is not None and one.radius_px < blur_px / TRIED_BLUR_SHARE
    }
    result = list(views)
    for index, ball in zip(
        tried, blurred_views(bgr, list(tried.values()), camera, options, coded, ghost, curve), strict=True
    ):
        if ball is not None and (
            ball.moved or not views[index].ok or _variance(ball.view) < _variance(views[index])
        ):
            result[index] = ball.view
    return result


def _variance(view: MarkerView) -> float:
    return float("inf") if view.covariance_px2 is None else float(np.trace(view.covariance_px2))


def blurred_views(
    bgr: npt.NDArray[np.uint8],
    wanted: Sequence[Expected],
    camera: Camera,
    options: MarkerOptions,
    coded: bool,
    ghost: Ghost | None = None,
    curve: float = 0.0,
) -> list[Blurred | None]:
    """Each marker's ball as a whole, where one region of its colour is a blurred ball of the size that the model expects; None otherwise. Three or more share their blur.

    `coded`: the codec keeps colour coarser than brightness.
    """
    tried = [(index, region) for index, one in enumerate(wanted) for region in _plausible(one)]
    starts = [Circle(np.array(region.centroid_px), wanted[index].radius_px) for index, region in tried]
    found: list[list[Blurred]] = [[] for _ in wanted]
    for (index, region), alone in zip(
        tried,
        measure_blurred_balls(without_ghost(bgr, ghost, starts), starts, KNOWN_SIZE_SHARE, camera, curve),
        strict=True,
    ):
        one, fit = wanted[index], with_ghost_left(alone, ghost, False)
        if fit is None or not _is_blurred_ball(fit, region, one.radius_px, coded):
            continue
        view = judged(bgr, one.marker, region, fit, options)
        if view.ok and (view.visible_fraction or 0.0) >= LEAST_SEEN:
            found[index].append(Blurred(view, _has_moved(fit)))
    return [_chosen(balls, one, camera.mean_focal_px) for balls, one in zip(found, wanted, strict=True)]


def _plausible(one: Expected) -> list[Region]:
    place = np.array(one.hint.pixel_px)
    low, high = (share * one.radius_px for share in REGION_SIZES)
    fitting = [region for region in one.regions if low <= region.equivalent_radius_px <= high]
    return sorted(fitting, key=lambda region: float(np.linalg.norm(np.array(region.centroid_px) - place)))[
        :MOST_REGIONS
    ]


def _chosen(balls: list[Blurred], one: Expected, focal_px: float) -> Blurred | None:
    if not balls:
        return None
    # All were measured with the expected size: it does not tell them apart.
    places = [ball.view.pixel_px for ball in balls if ball.view.pixel_px is not None]
    index, _ = choose(
        [Rival(place) for place in places], one.hint, focal_px, one.marker.diameter_m, one.elsewhere
    )
    return balls[index] if index >= 0 else None


def _has_moved(fit: OutlineFit) -> bool:
    return (
        fit.narrow_blur_px < MOVED_SHARE * fit.blur_px and fit.blur_px > MUCH_MOVED_SHARE * fit.mean_radius_px
    )


def _is_blurred_ball(fit: OutlineFit, region: Region, radius_px: float, coded: bool) -> bool:
    std = float(np.sqrt(0.5 * np.trace(fit.centroid_covariance_px2)))
    away = float(np.linalg.norm(fit.centroid_px - np.array(region.centroid_px)))
    return (
        fit.blur_px > (CODED_BLURRED_SHARE if coded else BLURRED_SHARE) * radius_px
        and abs(fit.mean_radius_px / radius_px - 1.0) <= SIZE_SHARE
        and fit.arc_fraction >= LEAST_RIM
        and std <= MOST_STD_SHARE * radius_px
        and away < 0.5 * radius_px
    )
