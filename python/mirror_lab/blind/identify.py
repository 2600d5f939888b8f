"""Identifiability: could another effect at another place produce the same pixels, within the noise?

The truth's noise-free pixels are fitted by every hypothesis of the vocabulary: first to first order, with
each frame's mirror plane (three parameters) projected out, then the best few by Gauss and Newton on the exact
model, planes included. With σ the noise that the session truly has,

    BIC(h) = Σ ‖clean − predicted(h)‖² / σ² + k(h) ln(n)

is what a reference that knows the noise expects of h. Noise scatters the difference of two of them about its
expectation by 2√D, D the difference of their χ². One hypothesis is *clearly* better where the difference is more than
`MARGIN` and more than `CLEAR_DEVIATIONS` of these. A cause is *detectable* when the model with it is clearly
better than without, and *identifiable* when it is so against every other effect at any place.

An effect outside the vocabulary has no hypothesis of its own: it can only be found by a free-form test. It is detectable,
and not mimicked, when what one to three causes of the vocabulary leave of it pays for `FREE_FORM` parameters.

This is code of its own: it shares nothing with the diagnosis, and knows what a diagnosis cannot (the noise, and
the pixels without it).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from .fitting import Fit, fit, screen
from .hypotheses import Hypothesis, all_hypotheses
from .reference import Reference, clean_pixels, reference_of

if TYPE_CHECKING:
    from .simulate import Case

MARGIN = 10.0
"""Twice the logarithm of the odds at which one hypothesis is called clearly better: 150 to 1."""
REFINED = 8
"""Rivals that are refined on the exact model after the first-order screening."""
CLEAR_DEVIATIONS = 2.6
"""In standard deviations of BIC's difference: the reference itself errs in one case of 200."""
FREE_FORM = 12
"""Number of parameters of a free-form test at one place, enough to describe an unknown curve."""
MIMICS = 3
"""Causes of the vocabulary that together may mimic an effect outside it."""


def judge(case: Case) -> dict[str, Any]:
    """`detectable`, `identifiable` and `rivals` for the answer: of a single cause, or of each of several."""
    ref = reference_of(case)
    causes = case.answer["causes"]
    start = clean_pixels(case)[2]
    empty = fit(ref, [], start)
    report: dict[str, Any] = {"nominal_chi2": empty.chi2, "residuals": ref.size}
    if not causes:
        best = screen(ref, empty, all_hypotheses(case.robot, case.plan.commands, case.gravity))[0][0]
        report["distraction"] = {"best": best[1].name, "gain": empty.bic - best[0]}
        return report
    friction = {c["at"].removeprefix("joint:"): c["friction_nm"] for c in causes if "friction_nm" in c}
    everything = all_hypotheses(case.robot, case.plan.commands, case.gravity, friction)
    if len(causes) == 1:
        return report | _judge_single(ref, empty, everything, causes[0])
    return report | _judge_several(ref, empty, everything, causes)


def _truths(everything: list[Hypothesis], cause: dict[str, Any]) -> list[Hypothesis]:
    return [h for h in everything if h.effect == cause["effect"] and h.at == cause["at"]]


def _judge_single(
    ref: Reference, empty: Fit, everything: list[Hypothesis], cause: dict[str, Any]
) -> dict[str, Any]:
    ranked = [h for _, h in screen(ref, empty, everything)[0]]
    truths = _truths(everything, cause)
    if cause["effect"] in ("geometry", "pairing"):
        best = min((fit(ref, [h], empty.planes) for h in ranked[:3]), key=lambda f: f.bic)
        explained = best.bic < 0.5 * empty.bic
        seen = empty.chi2 > 100
        return {
            "detectable": seen,
            "identifiable": seen and not explained,
            "rivals": [best.hypotheses[0].name] * explained,
        }
    if cause["effect"] == "unknown":
        return _judge_outside(ref, empty, everything)
    own = min((fit(ref, [h], empty.planes) for h in truths), key=lambda f: f.bic)
    others = [h for h in _one_per_name(ranked) if h not in truths and not _contains(h, cause)][:REFINED]
    fits = [fit(ref, [h], empty.planes) for h in others]
    rivals = [f.hypotheses[0].name for f in sorted(fits, key=lambda f: f.bic) if not clearly(own, f)]
    detectable = clearly(own, empty)
    return {
        "detectable": detectable,
        "identifiable": detectable and not rivals,
        "rivals": rivals,
        "left_out": _judge_outside(ref, empty, [h for h in everything if h.effect != cause["effect"]]),
        "own_chi2": own.chi2,
        "gain": empty.bic - own.bic,
        "margin": float(min((f.bic for f in fits), default=math.inf) - own.bic),
    }


def clearly(better: Fit, worse: Fit) -> bool:
    """Whether one fit is better by more than the noise can hide."""
    margin, scatter = worse.bic - better.bic, 2 * math.sqrt(max(worse.chi2 - better.chi2, 0.0))
    return margin > MARGIN and margin > CLEAR_DEVIATIONS * scatter


def _judge_outside(ref: Reference, empty: Fit, everything: list[Hypothesis]) -> dict[str, Any]:
    """Whether the effect is detectable, and whether one or a few causes of the vocabulary produce the same pixels."""
    ranked = [h for _, h in screen(ref, empty, everything)[0]]
    shows = MARGIN + FREE_FORM * math.log(ref.size)
    seen = empty.chi2 > shows
    fits = sorted(
        (fit(ref, [h], empty.planes) for h in _one_per_name(ranked)[:REFINED]), key=lambda f: f.chi2
    )
    closest = [{"name": f.hypotheses[0].name, "chi2_left": f.chi2} for f in fits[:3]]
    mimics = [f.hypotheses[0].name for f in fits if f.chi2 < shows]
    best = fits[0]
    while seen and not mimics and len(best.hypotheses) < MIMICS:
        names = {h.name for h in best.hypotheses}
        near = _one_per_name([h for _, h in screen(ref, best, everything)[0] if h.name not in names])
        best = min(
            (
                fit(
                    ref,
                    [*best.hypotheses, h],
                    best.planes,
                    [*(p.copy() for p in best.parameters), np.zeros(len(h.steps))],
                )
                for h in near[: REFINED // 2]
            ),
            key=lambda f: f.chi2,
        )
        if best.chi2 < shows:
            mimics = [h.name for h in best.hypotheses]
    return {
        "detectable": seen,
        "identifiable": seen and not mimics,
        "rivals": mimics,
        "closest": closest,
        "chi2_left": best.chi2,
    }


def _contains(h: Hypothesis, cause: dict[str, Any]) -> bool:
    """A hypothesis that contains the true law is no rival: a sticking servo droops as a compliant joint does."""
    return h.effect == "stiction" and cause["effect"] == "joint_compliance" and h.at == cause["at"]


def _one_per_name(ranked: list[Hypothesis]) -> list[Hypothesis]:
    seen: dict[str, Hypothesis] = {}
    for h in ranked:
        seen.setdefault(h.name, h)
    return list(seen.values())


def _judge_several(
    ref: Reference, empty: Fit, everything: list[Hypothesis], causes: list[dict[str, Any]]
) -> dict[str, Any]:
    """Each cause in turn, with the others in the model: can it be left out, or another take its place?"""
    chosen = []
    for cause in causes:
        ranked = [h for _, h in screen(ref, empty, _truths(everything, cause))[0]]
        chosen.append(ranked[0])
    whole = fit(ref, chosen, empty.planes)
    for i, cause in enumerate(causes):
        for other in _truths(everything, cause):
            if other is not chosen[i] and cause["effect"] == "backlash":
                trial = fit(ref, [*chosen[:i], other, *chosen[i + 1 :]], whole.planes)
                if trial.bic < whole.bic:
                    whole, chosen = trial, list(trial.hypotheses)
    judged = []
    for i, cause in enumerate(causes):
        rest = [h for k, h in enumerate(chosen) if k != i]
        without = fit(ref, rest, whole.planes, [p.copy() for k, p in enumerate(whole.parameters) if k != i])
        names = {h.name for h in chosen}
        candidates = [h for h in everything if h.name not in names and not _contains(h, cause)]
        near = _one_per_name([h for _, h in screen(ref, without, candidates)[0]])[: REFINED // 2]
        start = [*without.parameters]
        fits = [
            fit(ref, [*rest, h], without.planes, [*(p.copy() for p in start), np.zeros(len(h.steps))])
            for h in near
        ]
        rivals = [f.hypotheses[-1].name for f in fits if not clearly(whole, f)]
        detectable = clearly(whole, without)
        cause["detectable"], cause["identifiable"], cause["rivals"] = (
            detectable,
            detectable and not rivals,
            rivals,
        )
        cause["gain"] = without.bic - whole.bic
        cause["margin"] = min((f.bic for f in fits), default=math.inf) - whole.bic
        judged.append(cause["identifiable"])
    return {
        "detectable": all(c["detectable"] for c in causes),
        "identifiable": all(judged),
        "rivals": sorted({r for c in causes for r in c["rivals"]}),
        "own_chi2": whole.chi2,
    }
