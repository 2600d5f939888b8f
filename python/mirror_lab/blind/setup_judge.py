"""Identifiability in a session with mounts by hand: board, camera, markers and zeros are free.

The exact pixels are compared with those of the true machine without the cause in question. The mounts, free within the spreads from which
they were drawn, and each frame's mirror are projected out to first order. Then every hypothesis of the vocabulary is compared as in
`identify`, each to first order
around the true mounts. The cause's own χ² is that of the exact model. An effect outside the vocabulary is judged as in `identify`, by what
mounts and one to three causes leave of it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .fitting import Fit, screen
from .hypotheses import Hypothesis, all_hypotheses
from .identify import CLEAR_DEVIATIONS, FREE_FORM, MARGIN, MIMICS, _contains, _one_per_name, _truths
from .kinematics import Change
from .mounting import SHIFT_M, TURN_RAD, ZERO_RAD, Mounting
from .reference import Reference, clean_pixels, reference_of
from .robots import Robot
from .shrinkage import PARAMETERS

if TYPE_CHECKING:
    from .simulate import Case

Array = NDArray[np.float64]


def judge_by_hand(case: Case, mounting: Mounting) -> dict[str, Any]:
    """`detectable`, `identifiable` and `rivals` of each cause (in the causes), with the set-up free."""
    robot, commands = case.robot, case.plan.commands
    causes = case.answer["causes"]
    ref, planes = reference_of(case), clean_pixels(case)[2]
    friction = {c["at"].removeprefix("joint:"): c["friction_nm"] for c in causes if "friction_nm" in c}
    everything = all_hypotheses(robot, commands, case.gravity, friction)
    free, spreads, values = set_up(robot, mounting, everything)
    if any(c["effect"] == "unknown" for c in causes):
        mounts = Fit(free, values, planes, float("nan"), float("nan"))
        return _judge_outside(ref, mounts, spreads, everything)
    true: list[tuple[Hypothesis, Array]] = []
    for cause in causes:
        fitting = _truths(everything, cause)
        chosen = next((h for h in fitting if h.variant == "known"), fitting[0])
        true.append((chosen, np.array([cause.get(n, 0.0) for n in PARAMETERS[cause["effect"]]])))
    logarithm = float(np.log(ref.size))
    for i, cause in enumerate(causes):
        others = [t for k, t in enumerate(true) if k != i]
        base = Fit(
            [*free, *(h for h, _ in others)],
            [*values, *(p for _, p in others)],
            planes,
            float("nan"),
            float("nan"),
        )
        # The other causes' values are free without a prior, as they are of any fit.
        prior = np.concatenate([spreads, np.full(sum(len(p) for _, p in others), np.inf)])
        number = len(prior)
        nothing = screen(ref, base, [], prior)[1]
        ranked, _ = screen(ref, base, everything, prior)
        with_it = replace(
            base, hypotheses=[*base.hypotheses, true[i][0]], parameters=[*base.parameters, true[i][1]]
        )
        own = screen(ref, with_it, [], np.append(prior, np.full(len(true[i][1]), np.inf)))[1]
        own_bic = own + (number + len(true[i][1])) * logarithm
        names = {h.name for h, _ in true}

        def clear(chi2: float, bic: float, own: float = own, own_bic: float = own_bic) -> bool:
            margin = bic - own_bic
            return margin > MARGIN and margin > CLEAR_DEVIATIONS * 2 * float(np.sqrt(max(chi2 - own, 0.0)))

        rivals: list[str] = []
        best = float("inf")
        at = {h.name: bic for bic, h in reversed(ranked)}
        for h in _one_per_name([h for _, h in ranked]):
            if h.name in names or _contains(h, cause):
                continue
            bic = at[h.name]
            best = min(best, bic)
            if not clear(bic - (number + len(h.steps)) * logarithm, bic):
                rivals.append(h.name)
        cause["detectable"] = clear(nothing, nothing + number * logarithm)
        cause["identifiable"] = cause["detectable"] and not rivals
        cause["rivals"] = rivals[:12]
        cause["gain"], cause["margin"] = nothing + number * logarithm - own_bic, best - own_bic
    return {
        "detectable": all(c["detectable"] for c in causes),
        "identifiable": all(c["identifiable"] for c in causes),
    }


def _judge_outside(
    ref: Reference, mounts: Fit, spreads: Array, everything: list[Hypothesis]
) -> dict[str, Any]:
    """Whether an effect outside the vocabulary is detectable, and whether mounts and a few causes produce the same pixels."""
    logarithm = float(np.log(ref.size))
    shows = MARGIN + FREE_FORM * logarithm
    base, prior = mounts, spreads
    ranked, left = screen(ref, base, everything, prior)
    seen = left > shows
    closest: list[dict[str, Any]] = []
    mimics: list[str] = []
    chosen: list[str] = []
    while seen and not mimics and len(chosen) < MIMICS:
        paid = {h.name: bic - (len(prior) + len(h.steps)) * logarithm for bic, h in reversed(ranked)}
        near = [h for h in _one_per_name([h for _, h in ranked]) if h.name not in chosen]
        near.sort(key=lambda h: paid[h.name])
        best = near[0]
        closest = closest or [{"name": h.name, "chi2_left": paid[h.name]} for h in near[:3]]
        chosen, left = [*chosen, best.name], paid[best.name]
        if left < shows:
            alone = [h.name for h in near if paid[h.name] < shows]
            mimics = alone if len(chosen) == 1 else chosen
        base = replace(
            base,
            hypotheses=[*base.hypotheses, best],
            parameters=[*base.parameters, np.zeros(len(best.steps))],
        )
        prior = np.append(prior, np.full(len(best.steps), np.inf))
        ranked, _ = screen(ref, base, everything, prior)
    return {
        "detectable": seen,
        "identifiable": seen and not mimics,
        "rivals": mimics,
        "closest": closest,
        "chi2_left": left,
    }


def set_up(
    robot: Robot, mounting: Mounting, everything: list[Hypothesis]
) -> tuple[list[Hypothesis], Array, list[Array]]:
    """The set-up as hypotheses, the spread of each of their parameters, and their true values."""

    def board(change: Change, p: Array) -> None:
        change.board_turn_rad, change.board_shift_m = (
            change.board_turn_rad + p[:3],
            change.board_shift_m + p[3:],
        )

    pose = np.array([TURN_RAD] * 3 + [SHIFT_M] * 3)
    free = [Hypothesis("board_mount", "board", (1e-4,) * 6, board, True)]
    spreads, values = [pose], [np.concatenate(mounting.board)]
    for h in everything:
        name = h.at.partition(":")[2]
        if h.effect == "camera_mount":
            spread, value = pose, np.concatenate(mounting.camera)
        elif h.effect == "marker_mount":
            spread, value = np.full(3, SHIFT_M), mounting.markers_m[name]
        elif h.effect == "joint_offset" and name in mounting.zeros_rad:
            spread, value = np.full(1, ZERO_RAD), np.array([mounting.zeros_rad[name]])
        else:
            continue
        free.append(h)
        spreads.append(spread)
        values.append(value)
    return free, np.concatenate(spreads), values
