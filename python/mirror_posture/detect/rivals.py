"""Which of several balls of a marker's colour and size is the marker: the one nearest in space to where the robot's model expects it.

A model that is off by e displaces a ball of radius r (px) at a distance z by `d = f e / z` across, f the focal length, and by `r/r₀ = 1 − e / z` in size along the line of
sight. Both in px at the ball's distance, a ball is off by

    δ = √(d² + (f ln(r/r₀))²).

How large the model's errors are, the picture's other balls tell: errors of any direction alike, of a size that `n` errors with squares that add up to `S` show (density
`1/σ` before them), have Student's density in `k` axes

    p(δ) ∝ (1 + δ²/S)^(−(ν + k)/2), ν = 3 n.

But a ball may be off by a joint of its own: with half of the weight its error's size is unknown, `p(δ) ∝ δ⁻ᵏ`. The odds that the expected place belongs to ball 1 rather than to
ball 2 are `p(δ₁)/p(δ₂)`: alone in its picture `(δ₂/δ₁)³`, and by the places alone, where no size was measured, `(d₂/d₁)²`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..short_repr import ShortRepr
from .types import PredictedMarker

# Least odds of the nearest against the next (strong evidence), and by how many of the ball's radii it must be nearer: outlines that are nearer to each other are of one ball.
LEAST_ODDS = 20.0
LEAST_APART_RADII = 0.5
# By how many of them something that cannot be measured must be nearer than the chosen one, to mask it.
NEARER_RADII = 0.7
AXES = 3
AXES_WITHOUT_SIZE = 2
# Weight of an error of a size of its own, and the ratio of the largest to the smallest such size: 0.1 mm to 0.1 m.
OWN_WEIGHT = 0.5
OWN_SIZES = 1000.0
# Two outlines of the same place have errors of the same size, not of none, px.
LEAST_OFF_PX = 1e-3


@dataclass(frozen=True, eq=False, repr=False)
class ModelErrors(ShortRepr):
    """How far the model is off at other balls of the picture: their number, and the sum of their squares, m²."""

    balls: int = 0
    squares_m2: float = 0.0

    def log_density(self, off_px: float, m_per_px: float, axes: int) -> float:
        """The logarithm of the density of an error in so many axes, up to a constant of the ball."""
        off_m = max(off_px, LEAST_OFF_PX) * m_per_px
        own = math.gamma(0.5 * axes) / (2.0 * math.pi ** (0.5 * axes) * off_m**axes * math.log(OWN_SIZES))
        if self.balls == 0 or self.squares_m2 <= 0.0:
            return math.log(own)
        freedoms = AXES * self.balls
        alike = math.exp(
            math.lgamma(0.5 * (freedoms + axes))
            - math.lgamma(0.5 * freedoms)
            - 0.5 * axes * math.log(math.pi * self.squares_m2)
            - 0.5 * (freedoms + axes) * math.log1p(off_m**2 / self.squares_m2)
        )
        return math.log(OWN_WEIGHT * own + (1.0 - OWN_WEIGHT) * alike)


NO_OTHERS = ModelErrors()


def errors_elsewhere(offs_m: Sequence[float | None], index: int) -> ModelErrors:
    """What the other balls show, of each marker's distance from where the model expects it, m; None where it is not measured."""
    others = [off for other, off in enumerate(offs_m) if other != index and off is not None]
    return ModelErrors(len(others), float(sum(off**2 for off in others)))


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


def choose(
    rivals: Sequence[Rival],
    expected: PredictedMarker,
    focal_px: float,
    diameter_m: float,
    elsewhere: ModelErrors = NO_OTHERS,
) -> tuple[int, str]:
    """The index of the marker, or -1 and the reason why it cannot be decided. All sizes are known, or none.

    `diameter_m`: the ball's; `elsewhere`: how far the model is off at the picture's other balls.
    """
    if len(rivals) == 1:
        return 0, ""
    off = np.array([one.off_px(expected, focal_px) for one in rivals])
    order = np.argsort(off)
    nearest, second = float(off[order[0]]), float(off[order[1]])
    axes = AXES_WITHOUT_SIZE if rivals[0].size is None else AXES
    m_per_px = 0.5 * diameter_m / _radius_px(expected)
    log_odds = elsewhere.log_density(nearest, m_per_px, axes) - elsewhere.log_density(second, m_per_px, axes)
    if log_odds >= math.log(LEAST_ODDS) and second - nearest >= LEAST_APART_RADII * _radius_px(expected):
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
