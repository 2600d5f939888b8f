"""Predicted detection limits of a plan: the smallest detectable size of each effect, and which effects stay
twins.

With the Fisher information F of all pixels and the mounts free within their tolerances, one cause h at a
time has the covariance `S⁻¹`, `S = F_hh − F_hN (F_NN + Λ)⁻¹ F_Nh`. A cause is detected with certainty from
`SURE` standard deviations on. A cause h can hide as another cause k where even the best size of k leaves
fewer than `SURE` deviations: `s² (S_hh − S_hk S_kk⁺ S_kh) < SURE²`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Floats
from .causes import Cause
from .sensitivity import Sensitivity

SURE = 5.0
"""Standard deviations: a search over a hundred places needs more than the usual 2."""
UNSEEN = 30.0
"""Typical sizes: what must be larger than this is as good as unseen."""
REPORTED = (
    "joint_offset", "gear_ratio", "gear_eccentricity", "backlash", "joint_compliance", "drift", "axis_tilt", "link_length", "marker_mount",
)  # fmt: skip


@dataclass(frozen=True)
class Rival:
    """Another cause that looks alike, and the size (of the first parameter) from which both are separated;
    infinite: never."""

    name: str
    apart_from: float


@dataclass(frozen=True)
class Tells:
    """The predicted detection limits of one cause."""

    effect: str
    at: str
    parameters: dict[str, float]
    """The smallest size of each parameter that is detected with certainty, in its unit; infinite where it
    cannot be seen."""
    twins: tuple[Rival, ...]
    """Causes that it can hide as at a size at which it matters, the nearest first."""
    typical: tuple[float, ...]

    @property
    def name(self) -> str:
        """`effect@place`."""
        return f"{self.effect}@{self.at}"

    @property
    def seen(self) -> bool:
        """Whether the plan shows it at all."""
        return all(
            size < UNSEEN * usual for size, usual in zip(self.parameters.values(), self.typical, strict=True)
        )


def what_it_tells(sensitivity: Sensitivity, rows: Sequence[Floats]) -> list[Tells]:
    """The limits and twins of all causes of the robot, from the whitened rows of the plan's frames."""
    typical = np.concatenate([cause.typical for cause in sensitivity.causes])
    scaled = [part * typical for part in rows]
    information = sum((part.T @ part for part in scaled), np.zeros((sensitivity.width, sensitivity.width)))
    prior = sensitivity.prior_precision() * typical**2
    setup = [c for c in sensitivity.causes if prior[c.columns].any()]
    told = []
    causes = [cause for cause in sensitivity.causes if cause.effect in REPORTED]
    whole = _without(information, prior, [column for c in setup for column in _columns(c)])
    for cause in causes:
        own = _columns(cause)
        free = [column for c in setup if c is not cause for column in _columns(c)]
        here = _without(information, prior, free) if cause in setup else whole
        block = here[np.ix_(own, own)]
        # Each parameter alone, the others of its cause at 0: how small it may be and still be found.
        sizes = [_size(block[i, i]) * usual for i, usual in enumerate(cause.typical)]
        rivals = []
        for other in causes:
            if other is cause or (cause in setup and other in setup):
                continue
            view = here if other not in setup else _without(
                information, prior, [column for c in setup if c not in (cause, other) for column in _columns(c)]
            )  # fmt: skip
            k = _columns(other)
            kk, hk = view[np.ix_(k, k)], view[np.ix_(own, k)]
            left = np.diag(
                view[np.ix_(own, own)] - hk @ np.linalg.pinv(kk, rcond=1e-9, hermitian=True) @ hk.T
            )
            # They are separated if any of the parameters is; an alternative must imitate all of them.
            apart = min(_size(value) for value in left)
            visible = min(_size(block[i, i]) for i in range(len(own)))
            if apart > max(1.0, 2.0 * visible) and visible < UNSEEN:
                rivals.append(Rival(other.name, apart * cause.typical[0]))
        rivals.sort(key=lambda rival: (-rival.apart_from, rival.name))
        told.append(
            Tells(
                cause.effect, cause.at, dict(zip(cause.parameters, sizes, strict=True)), tuple(rivals), cause.typical
            )
        )  # fmt: skip
    return told


def _columns(cause: Cause) -> list[int]:
    return list(range(cause.columns.start, cause.columns.stop))


def _without(information: Floats, prior: Floats, free: Sequence[int]) -> Floats:
    """The information that is left when the columns `free`, with their priors, are fitted as well."""
    f = list(free)
    block = information[np.ix_(f, f)] + np.diag(np.maximum(prior[f], 1e-9))
    side = information[:, f]
    left: Floats = information - side @ np.linalg.solve(block, side.T)
    return left


def _size(information: float) -> float:
    """The size, in typical sizes, that is found surely."""
    return SURE / math.sqrt(information) if information > 1e-6 else math.inf
