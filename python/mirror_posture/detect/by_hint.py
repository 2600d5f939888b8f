"""A marker's ball where the robot's model expects it: its candidates' outlines are judged, and one is chosen among the balls of its size."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ..marker import Marker
from ..short_repr import ShortRepr
from .ball import Circle, OutlineFit, Start
from .blobs import Region
from .candidates import Candidate
from .marker_judge import (
    MarkerOptions,
    doubted_size,
    is_sharp,
    judged,
    masked,
    nothing_reason,
    size_share,
    widened_by_size,
)
from .rivals import LEAST_APART_RADII, NO_OTHERS, ModelErrors, Rival, choose, clearly_nearer
from .types import FloatArray, MarkerView, PredictedMarker

# Smallest outline that sub-pixel edges can be read from; below, the region's centroid is all there is.
MIN_OUTLINE_RADIUS_PX = 3.0

Measured = Callable[[list[Start]], list[OutlineFit | None]]


@dataclass(frozen=True, eq=False, repr=False)
class Found(ShortRepr):
    """What of a marker's colour was measured: its view where there is no choice (masked with its reason, or there is no hint), else the balls of its size, of which
    one is to be chosen, and what is not accepted, with why."""

    view: MarkerView
    hint: PredictedMarker | None = None
    diameter_m: float = 0.0
    good: tuple[MarkerView, ...] = ()
    bad: tuple[tuple[Rival, str], ...] = ()

    def _rivals(self, hint: PredictedMarker) -> list[Rival]:
        return [_rival(view, float(hint.ball_radius_px or 0.0)) for view in self.good]

    def off_m(self, focal_px: float) -> float | None:
        """How far the nearest ball is from where the model expects it; None where none is measured."""
        if self.hint is None or not self.good:
            return None
        off_px = min(one.off_px(self.hint, focal_px) for one in self._rivals(self.hint))
        return off_px * 0.5 * self.diameter_m / float(self.hint.ball_radius_px or np.inf)

    def chosen(self, focal_px: float, elsewhere: ModelErrors = NO_OTHERS) -> MarkerView:
        """The one ball of the size that the model expects, nearest to where it expects it; masked where another may be it."""
        if self.hint is None or not self.good:
            return self.view
        rivals = self._rivals(self.hint)
        index, reason = choose(rivals, self.hint, focal_px, self.diameter_m, elsewhere)
        if index >= 0:
            reason = _told_nearer(rivals[index], self.bad, self.hint, focal_px)
        view = self.good[max(index, 0)]
        return replace(view, ok=False, reason=reason) if reason else view


def found_by_hint(
    bgr: npt.NDArray[np.uint8],
    marker: Marker,
    regions: tuple[Region, ...],
    hint: PredictedMarker,
    candidates: Sequence[Candidate],
    fits: Sequence[OutlineFit | None],
    options: MarkerOptions,
    measured: Measured,
    coded: bool,
) -> Found:
    """The balls of about the size that the model expects, near where it expects one.

    `fits` are the candidates' outlines; `measured` measures others in the same picture; `coded`: its codec keeps colour coarser than brightness.
    """
    if not regions:
        return Found(masked(marker, nothing_reason(bgr, marker), None))
    radius = float(hint.ball_radius_px or 0.0)
    if radius < MIN_OUTLINE_RADIUS_PX:
        return Found(
            masked(
                marker,
                f"it would be {2.0 * radius:.1f} px wide there, needed {2.0 * MIN_OUTLINE_RADIUS_PX:.0f}: go nearer",
                None,
            )
        )
    good: list[MarkerView] = []
    # Those that are not accepted, and why; of another size than the marker's, or not measured.
    bad: list[tuple[Rival, str]] = []
    first_bad: MarkerView | None = None
    share = 1.0 + size_share(radius, options)

    def of_known_size(center_px: FloatArray) -> OutlineFit | None:
        (again,) = measured([Start(Circle(center_px, radius), radius / share, radius * share)])
        return again

    for one, fit in zip(candidates, fits, strict=True):
        if fit is None:
            # A short arc fits many sizes, and may have run away.
            fit = of_known_size(one.circle.center_px)
        if fit is None:
            u, v = one.circle.center_px
            bad.append((Rival((float(u), float(v))), ""))
            continue
        seen = judged(bgr, marker, one.region, fit, options)
        view = doubted_size(seen, fit, radius, options)
        if seen.ok and not view.ok and (coded or is_sharp(fit)):
            # A wrong part of its outline may have been used: it is measured again, with no other size.
            again = of_known_size(fit.centroid_px)
            if again is not None:
                seen = judged(bgr, marker, one.region, again, options)
                view, fit = (seen, again) if seen.ok else (view, fit)
        view = widened_by_size(view, fit, radius)
        if view.pixel_px is None or any(_same_place(view, other, radius) for other in good):
            continue
        if view.ok:
            good.append(view)
            continue
        # A good outline of another size is another thing; of a bad one the size says nothing.
        bad.append((Rival(view.pixel_px, fit.mean_radius_px / radius if seen.ok else None), view.reason))
        first_bad = first_bad or view
    if good:
        return Found(good[0], hint, marker.diameter_m, tuple(good), tuple(bad))
    return Found(
        first_bad
        or masked(
            marker,
            f"{len(regions)} regions of its colour, none with the outline of a ball of the size that it has there (radius {radius:.1f} px, the largest region's "
            f"{regions[0].equivalent_radius_px:.1f} px)",
            regions[0],
        )
    )


def _rival(view: MarkerView, radius_px: float) -> Rival:
    assert view.outline is not None and view.pixel_px is not None
    size = float(np.sqrt(view.outline.semi_major_px * view.outline.semi_minor_px)) / radius_px
    return Rival(view.pixel_px, size)


def _told_nearer(
    chosen: Rival, bad: Sequence[tuple[Rival, str]], hint: PredictedMarker, focal_px: float
) -> str:
    """The reason why a ball is ambiguous, if it is: something of its colour that is not measured well enough is clearly nearer to where the model expects it."""
    for other, why in bad:
        if clearly_nearer(other, chosen, hint, focal_px):
            u, v = other.pixel_px
            if why:
                return f"another of its colour is nearer to where the model expects it, at ({u:.0f}, {v:.0f}), and cannot be measured: {why}"
            return f"something round of its colour is nearer to where the model expects it, at ({u:.0f}, {v:.0f}), and its outline cannot be measured"
    return ""


def _same_place(one: MarkerView, other: MarkerView, radius_px: float) -> bool:
    """Whether two outlines are of one ball, found from two starts."""
    return (
        one.pixel_px is not None
        and other.pixel_px is not None
        and (
            float(np.hypot(one.pixel_px[0] - other.pixel_px[0], one.pixel_px[1] - other.pixel_px[1]))
            < LEAST_APART_RADII * radius_px
        )
    )
