"""The result of a diagnosed motion, as `diagnosis.json`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mirror_posture.arrays import Floats, Mask
from mirror_posture.diagnosis.fingerprint import KEY, fingerprint
from mirror_posture.diagnosis.result import FORMAT, VERSION

from .alternatives import LEAST_PROBABILITY, Rivals
from .effects import Key, told
from .encoders import encoder_witness
from .fit import SEGMENTS, Fitted, evaluated
from .next_moves import next_moves, postures
from .problem import Problem
from .search import Found
from .shown import bagged, limits, stability
from .words import WORDS, sentence

EXPLAINED = 1.15
"""RMS of the remainder, in units of the noise: up to here the noise explains it."""
LEAST_NAMED = 0.1
"""A cause less probable than this is not named: its place is reported, and that something there absorbs a
part."""
BOOTSTRAPS = 400


def document(
    problem: Problem,
    found: Found,
    rivals: Mapping[Key, Rivals],
    fitted: tuple[list[tuple[Key, int]], Floats, Floats],
) -> dict[str, Any]:
    """The JSON tree of a diagnosis."""
    of, covariance, columns = fitted
    view, best, scale = problem.view, found.best, found.noise_scale
    without = {
        key: evaluated(problem, {k: v for k, v in best.causes.items() if k != key}, scale)
        for key in best.causes
    }
    share = _shares(found, without)
    stable = stability(problem, found, without)
    left = float(np.sqrt(best.misfit.squares / best.misfit.rows))
    # Causes of a model that leaves something unexplained may replace a missing effect.
    trust = min(1.0, (EXPLAINED / left) ** 2)
    order = sorted(best.causes, key=lambda key: -share[key])
    causes = []
    for key in order:
        hypothesis = problem.hypotheses[key]
        slots = [of.index((key, k)) for k in range(len(hypothesis.step))]
        step = np.array(hypothesis.step)
        values, deviations = told(
            key, best.causes[key], covariance[np.ix_(slots, slots)] * np.outer(step, step)
        )
        causes.append(
            {
                "effect": key[0],
                "at": key[1],
                "kind": hypothesis.effect.kind,
                "probability": round(min(trust * rivals[key].probability, bagged(stable.get(key))), 4),
                "stability": stable.get(key),
                "parameters": {
                    name: {"value": float(value), "std": float(s)}
                    for name, value, s in zip(hypothesis.effect.parameters, values, deviations, strict=True)
                },
                "alternatives": [
                    {"effect": effect, "at": at, "probability": round(trust * p, 4)}
                    for (effect, at), p in rivals[key].others
                    if trust * p > LEAST_PROBABILITY
                ],
                "words": WORDS[key[0]],
                "rms_shift": float(
                    np.sqrt(share[key] / best.misfit.rows) * scale * view.noise_px * np.sqrt(2.0)
                ),
            }
        )
    causes, unsure = named(causes)
    gap = _gap(problem, found, columns)
    gap["steps"] = _steps(problem, order, best)
    # With all causes the gap is computed on held-out segments of time.
    gap["steps"][-1] |= {"rms_px": gap["after_px"], "rms_m": gap["after_m"]}
    verdict = _verdict(bool(causes), left) if causes or not order else "unknown"
    total = sum(share.values()) or 1.0
    where: dict[str, float] = {}
    for key in order:
        where[key[1]] = where.get(key[1], 0.0) + share[key] / total
    hidden = limits(problem, found)
    moves = next_moves(problem, found, rivals, hidden)
    session = problem.session
    seen, given = view.seen, session.mirror_view.marker_seen
    frames = session.frames.frame
    return {
        "format": FORMAT,
        "version": VERSION,
        "motion": {
            "seconds": float(np.ptp(problem.recording.board_time_s)),
            "simulated": problem.rollouts.count,
            "left_out_start_s": float(
                problem.recording.board_time_s[view.first] - problem.recording.board_time_s[0]
            ),
            "next_moves": [move.as_tree() for move in moves],
        },
        "verdict": verdict,
        "sentence": sentence(verdict, causes, gap),
        "causes": causes,
        "where": [{"at": at, "share": round(s, 4)} for at, s in sorted(where.items(), key=lambda p: -p[1])],
        "gap": gap,
        "limits": hidden,
        "encoder_witness": encoder_witness(problem, best.causes),
        "next_postures": postures(moves),
        "warnings": [
            *problem.rollouts.simulator.notes,
            *(
                f"{c['effect']} at {c['at']} takes a part of the gap and is not named: its probability is "
                f"{c['probability']:.3f}, needed is {LEAST_NAMED:g}"
                for c in unsure
            ),
        ],
        "noise": {"marker_px": scale * view.noise_px},
        "trace": list(found.trace),
        "ranking": [
            {
                "effect": s.key[0],
                "at": s.key[1],
                "log_bayes": float(0.5 * s.gain / found.nominal.misfit.inflation),
            }
            for s in found.first_look
        ],
        "data": {
            "frames_given": len(frames),
            "frames_used": int(seen.any(axis=1).sum()),
            "postures_given": len(frames),
            "postures_used": int(seen.any(axis=1).sum()),
            "points_given": int(given.sum()),
            "points_used": int(seen.sum()),
            "left_out": _left_out(problem, best, scale),
        },
        KEY: fingerprint(session),
    }


def _left_out(problem: Problem, best: Fitted, scale: float) -> list[dict[str, Any]]:
    """The false images: how far each lies from the model found, in units of the noise."""
    view = problem.view
    (motion,) = problem.rollouts.motions([best.causes])
    assert motion is not None
    off = view.deviations(problem.places(best.causes, motion), best.causes) / scale
    return [
        {
            "frame": int(problem.session.frames.frame[f]),
            "target": problem.session.marker_names[m],
            "deviations": float(off[f, m]) if np.isfinite(off[f, m]) else None,
            "why": "fits neither its neighbours nor the motion",
        }
        for f, m in zip(*np.nonzero(view.false), strict=True)
    ]


def named(causes: Sequence[dict[str, Any]]) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """The causes that are probable enough to be named, and those that are not."""
    sure = [c for c in causes if c["probability"] >= LEAST_NAMED]
    return sure, [c for c in causes if c not in sure]


def _verdict(any_cause: bool, left: float) -> str:
    if any_cause:
        return "explained" if left <= EXPLAINED else "partial"
    return "none" if left <= EXPLAINED else "unknown"


def _shares(found: Found, without: Mapping[Key, Fitted | None]) -> dict[Key, float]:
    """By how much the squares grow without each cause, the others as they are."""
    return {
        key: 0.0 if model is None else max(0.0, model.misfit.squares - found.best.misfit.squares)
        for key, model in without.items()
    }


def _steps(problem: Problem, order: list[Key], best: Fitted) -> list[dict[str, Any]]:
    steps: list[dict[str, Any]] = []
    for count in range(len(order) + 1):
        causes = {key: best.causes[key] for key in order[:count]}
        px, metres = problem.rms(causes)
        steps.append({"added": "@".join(order[count - 1]) if count else None, "rms_px": px, "rms_m": metres})
    return steps


def _gap(problem: Problem, found: Found, columns: Floats) -> dict[str, Any]:
    """The gap on segments of time whose pictures the parameters (one linear step) did not see."""
    view, best, scale = problem.view, found.best, found.noise_scale
    seen = view.seen
    held = held_out(found.best.residual, columns, seen)
    growth = np.sqrt((held[seen] ** 2).sum() / max(best.misfit.squares, 1e-12))
    metres = view.metres_per_px(problem.places({}, problem.rollouts.nominal()))
    before, after = (np.linalg.norm(problem.errors_px(c), axis=2) for c in ({}, best.causes))
    after = after * growth
    floor = scale * np.sqrt(view.variance_px2)
    by_name = {
        name: (float(np.sqrt((e[seen] ** 2).mean())), float(np.sqrt(((e * metres)[seen] ** 2).mean())))
        for name, e in (("before", before), ("after", after), ("noise_floor", floor))
    }
    out: dict[str, Any] = {f"{name}_m": m for name, (_, m) in by_name.items()}
    out |= {f"{name}_px": px for name, (px, _) in by_name.items()}
    open_m2 = by_name["before"][1] - by_name["noise_floor"][1]
    out["closed"] = out["closed_ci95"] = None
    if open_m2 > 0.05 * by_name["noise_floor"][1] and best.causes:
        out["closed"] = float((by_name["before"][1] - by_name["after"][1]) / open_m2)
        out["closed_ci95"] = _interval(before * metres, after * metres, floor * metres, seen)
    out["held_out_postures"] = int(seen.any(axis=1).sum()) if best.causes else 0
    out["held_out_segments"] = SEGMENTS
    return out


def held_out(residual: Floats, columns: Floats, seen: Mask) -> Floats:
    """Residuals (F, markers, 2) of each segment of time with parameters from the others, to first order."""
    out: Floats = residual.copy()
    count = columns.shape[-1]
    if not count:
        return out
    j = np.where(seen[..., None, None], columns, 0.0).reshape(len(columns), -1, count)
    r = np.where(seen[..., None], residual, 0.0).reshape(len(columns), -1)
    normal, gradient = np.einsum("fri,frj->ij", j, j), np.einsum("fri,fr->i", j, r)
    segment = (np.arange(len(columns)) * SEGMENTS) // len(columns)
    for s in range(SEGMENTS):
        rows = segment == s
        own, pull = np.einsum("fri,frj->ij", j[rows], j[rows]), np.einsum("fri,fr->i", j[rows], r[rows])
        step = np.linalg.lstsq(normal - own, gradient - pull, rcond=1e-10)[0]
        out[rows] -= columns[rows] @ step
    return out


def _interval(before: Floats, after: Floats, floor: Floats, seen: Mask) -> list[float]:
    """95 % of the share closed, by resampling tenths of the time."""
    rng = np.random.default_rng(0)
    parts = np.array_split(np.arange(len(seen)), 10)
    squares = np.array([[(e[p][seen[p]] ** 2).sum() for e in (before, after, floor)] for p in parts])
    count = np.array([seen[p].sum() for p in parts])
    drawn = []
    for _ in range(BOOTSTRAPS):
        pick = rng.integers(0, len(parts), len(parts))
        b, a, f = np.sqrt(squares[pick].sum(axis=0) / max(1, count[pick].sum()))
        if b > f:
            drawn.append((b - a) / (b - f))
    low, high = np.quantile(drawn, [0.025, 0.975]) if drawn else (0.0, 1.0)
    return [float(low), float(high)]
