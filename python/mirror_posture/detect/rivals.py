"""Which of several balls of a marker's colour and size is the marker: the one nearest in space to where the robot's model expects it.

A model that is off by e displaces a ball of radius r (px) at a distance z by `d = f e / z` across, f the focal length, and by `r/r₀ = 1 − e / z` in size along the line of
sight. Both in px at the ball's distance, a ball is off by

    δ = √(d² + (f ln(r/r₀))²).

For errors of any direction alike, and of unknown size (density `1/σ`), that the expected place belongs to ball 1 rather than to ball 2 has the odds `(δ₂/δ₁)³`; by the places
alone, where no size was measured, `(d₂/d₁)²`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..short_repr import ShortRepr
from .types import PredictedMarker

# Least odds of the nearest against the next, and by how many of the ball's radii it must be nearer: outlines that are nearer to each other are of one ball.
LEAST_ODDS = 4.0
LEAST_APART_RADII = 0.5
# By how many of them something that cannot be measured must be nearer than the chosen one, to mask it.
NEARER_RADII = 0.7
AXES = 3
AXES_WITHOUT_SIZE = 2


@dataclass(frozen=True, eq=False, repr=False)
class Rival(ShortRepr):
    """Something of a marker's colour that may be it: its place, px, and where it was measured, its radius as a share of the expected one."""

    pixel_px: tuple[float, float]
    size: float | None = None

    def across_px(self, expected: PredictedMarker) -> float:
        """Distance from the expected place, px."""
        return float(
            np.hypot(self.pixel_px[0] - expected.pixel_px[0], self.pixel_px[1] - expected.pixel_px[1])
        )

    def off_px(self, expected: PredictedMarker, focal_px: float) -> float:
        """The same in space, px at the ball's distance; across only, where no size is known."""
        along = 0.0 if self.size is None else focal_px * float(np.log(self.size))
        return float(np.hypot(self.across_px(expected), along))


def choose(rivals: Sequence[Rival], expected: PredictedMarker, focal_px: float) -> tuple[int, str]:
    """The index of the marker, or -1 and the reason why it cannot be decided. All sizes are known, or none."""
    if len(rivals) == 1:
        return 0, ""
    off = np.array([one.off_px(expected, focal_px) for one in rivals])
    order = np.argsort(off)
    nearest, second = off[order[0]], off[order[1]]
    axes = AXES_WITHOUT_SIZE if rivals[0].size is None else AXES
    if second >= LEAST_ODDS ** (1.0 / axes) * nearest and second - nearest >= (
        LEAST_APART_RADII * _radius_px(expected)
    ):
        return int(order[0]), ""
    first, other = (rivals[int(index)] for index in order[:2])
    u, v = other.pixel_px
    return -1, (
        f"{len(rivals)} balls of its colour and size, {first.across_px(expected):.0f} and {other.across_px(expected):.0f} px from where the model expects it "
        f"(another at ({u:.0f}, {v:.0f})): take away what has its colour, or give it another"
    )


def clearly_nearer(other: Rival, chosen: Rival, expected: PredictedMarker, focal_px: float) -> bool:
    """Whether something that is not measured well enough to be the marker is clearly nearer to where the model expects it than the chosen ball is: in space where
    both sizes are known, else across."""
    if other.size is not None and chosen.size is not None:
        apart = chosen.off_px(expected, focal_px) - other.off_px(expected, focal_px)
    else:
        apart = chosen.across_px(expected) - other.across_px(expected)
    return apart > NEARER_RADII * _radius_px(expected)


def _radius_px(expected: PredictedMarker) -> float:
    return float(expected.ball_radius_px or 0.0)
