"""The next moves, which would best separate what this motion could not.

For each cause and its most probable alternative (where there is none, for the effect that this motion hides
most) moves of the joint concerned are simulated with either model: slowly, quickly, and short and quick,
there and back with rests, with the other joints where the joint's load is smallest, largest, in between and
zero. With H the pictures' mean information on joint positions (in units of the noise) a move separates two
models by `√mean(Δqᵀ H Δq)`, Δq the difference of their positions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mirror_posture.arrays import Floats
from mirror_posture.session.types import States

from .alternatives import Rivals
from .effects import Causes, Key
from .fit import Fitted, evaluated
from .motions import Branch, Motion
from .positions import positions
from .problem import Problem
from .rollouts import STEP_S, Rollouts
from .search import Found

LEAST_PROBABILITY = 0.05
"""A less probable alternative needs no separate move."""
MOST_MOVES = 3
MOST_PICTURES, TOO_MANY = 3000, 10**9
LOG_STEP_S, PICTURE_STEP_S = 0.01, 1.0 / 30.0
REST_S, GO_THERE_S = 0.8, 1.5
SLOW, LONGEST_S = 0.15, 4.0
"""Of the joint's largest speed in the log; and the longest that one way may take."""
SHORT = 0.2
"""Of the way, as quick as the log: reversals."""
DRAWN, WITHIN = 100, 0.9
"""Postures drawn within the joints' ranges, and the share of a range that is used."""


@dataclass(frozen=True)
class Move:
    """A joint moves from its position in `start` to that in `end` and back, in `seconds` each way; the
    others stand still."""

    joint: str
    start: Mapping[str, float]
    end: Mapping[str, float]
    seconds: float
    why: str
    deviations: float
    """By how much of the noise, RMS a picture, it would part the two."""

    @property
    def pictures(self) -> int:
        """As many of the move part the two by a factor of twenty in probability, on average."""
        return min(TOO_MANY, int(np.ceil(2.0 * np.log(20.0) / max(self.deviations, 1e-6) ** 2)))

    def as_tree(self) -> dict[str, Any]:
        """As JSON."""
        return {
            "joint": self.joint,
            "from": self.start[self.joint],
            "to": self.end[self.joint],
            "seconds": self.seconds,
            "rest_s": REST_S,
            "why": self.why,
            "deviations": self.deviations,
            "pictures": self.pictures,
        }


@dataclass(frozen=True, eq=False)
class _Pair:
    """Two models that a move must separate, the joints it may move, and their difference in the present
    motion."""

    one: Causes
    other: Causes
    joints: tuple[str, ...]
    why: str
    now: float


def next_moves(
    problem: Problem, found: Found, rivals: Mapping[Key, Rivals], limits: Sequence[Mapping[str, Any]]
) -> list[Move]:
    """The moves that would separate alternatives or show what is hidden most; empty where none is better
    than this motion."""
    pairs = _ambiguous(problem, found, rivals) or _hidden(problem, found, limits)
    out = []
    for pair in pairs[:MOST_MOVES]:
        move = _best_move(problem, found, pair)
        if move is not None and move.deviations > 1.2 * pair.now and move.pictures <= MOST_PICTURES:
            out.append(move)
    return out


def postures(moves: Sequence[Move]) -> list[dict[str, float]]:
    """Where the moves begin and end, each once."""
    out: list[dict[str, float]] = []
    for move in moves:
        for posture in (dict(move.start), dict(move.end)):
            if posture not in out:
                out.append(posture)
    return out


def _ambiguous(problem: Problem, found: Found, rivals: Mapping[Key, Rivals]) -> list[_Pair]:
    out = []
    for key, told in rivals.items():
        fitted = [(p, other) for other, p in told.others if p >= LEAST_PROBABILITY and other in told.models]
        if not fitted:
            continue
        _, other = fitted[0]
        joints = _joints(problem, (key, other))
        if joints:
            model = told.models[other]
            now = _apart(problem, model, found.best)
            why = f"parts {_named(key)} from {_named(other)}"
            out.append((told.probability, _Pair(found.best.causes, model.causes, joints, why, now)))
    return [pair for _, pair in sorted(out, key=lambda entry: entry[0])]


def _apart(problem: Problem, one: Fitted, other: Fitted) -> float:
    """By how much of the noise two models differ in the motion as it is, RMS a picture."""
    seen = problem.view.seen
    squares = float(((one.residual - other.residual)[seen] ** 2).sum())
    return float(np.sqrt(squares / max(1, int(seen.any(axis=1).sum()))))


def _hidden(problem: Problem, found: Found, limits: Sequence[Mapping[str, Any]]) -> list[_Pair]:
    """The effect whose largest hidden size exceeds its usual size most."""
    worst: tuple[float, Key | None] = (1.0, None)
    taken = {at for _, at in found.best.causes}
    for entry in limits:
        key = (str(entry["effect"]), str(entry["at"]))
        joints = _joints(problem, (key,))
        hypothesis = problem.hypotheses.get(key)
        if hypothesis is None or not joints or key[1] == "camera" or key[1] in taken:
            continue
        sizes = list(entry["parameters"].values())
        ratio = max(
            np.inf if size is None else size / usual
            for size, usual in zip(sizes, hypothesis.usual, strict=True)
        )
        if ratio > worst[0]:
            worst = (ratio, key)
    hidden = worst[1]
    if hidden is None:
        return []
    key, usual = hidden, problem.hypotheses[hidden].usual
    there = {**found.best.causes, key: problem.hypotheses[key].clipped(np.array(usual))}
    model = evaluated(problem, there, found.noise_scale)
    now = 0.0 if model is None else _apart(problem, model, found.best)
    return [_Pair(found.best.causes, there, _joints(problem, (key,)), f"would show {_named(key)}", now)]


def _joints(problem: Problem, keys: Sequence[Key]) -> tuple[str, ...]:
    """The joints that a move may be of; none where one of the causes is no matter of how joints move."""
    if any(effect.endswith("_mount") for effect, _ in keys):
        return ()
    named = tuple(dict.fromkeys(at.partition(":")[2] for _, at in keys if at.startswith("joint:")))
    known = tuple(name for name in named if name in problem.scales)
    return known or (max(problem.scales, key=lambda name: problem.scales[name].speed),)


def _best_move(problem: Problem, found: Found, pair: _Pair) -> Move | None:
    tried = [move for joint in pair.joints for move in _candidates(problem, joint, pair.why)]
    if not tried:
        return None
    log, spans = _log(problem, tried)
    recording = replace(
        problem.recording, states=log, board_time_s=_times(log), marker_time_s=_times(log)[:, None]
    )
    rollouts = Rollouts(recording, problem.model_file, exact=False)
    motions = rollouts.motions([pair.one, pair.other])
    tables = []
    for causes, motion in zip((pair.one, pair.other), motions, strict=True):
        if motion is None:
            return None
        tables.append(positions(rollouts, causes, motion, recording.marker_time_s, recording.board_time_s)[1])
    by_position = problem.by_position()[problem.view.seen.any(axis=1)] / found.noise_scale
    information = np.einsum("fmij,fmik->jk", by_position, by_position) / max(1, len(by_position))
    apart = tables[0] - tables[1]
    squares = np.einsum("fj,jk,fk->f", apart, information, apart)
    times = recording.board_time_s
    powers = [float(np.sqrt(squares[(times >= begin) & (times < end)].mean())) for begin, end in spans]
    best = int(np.argmax(powers))
    return replace(tried[best], deviations=powers[best])


def _candidates(problem: Problem, joint: str, why: str) -> list[Move]:
    """Moves of a joint, the others standing in postures drawn for loads of all kinds: slow, quick, and short and quick."""
    rollouts = problem.rollouts
    column = rollouts.joints.index(joint)
    stood = problem.recording.commands(rollouts.joints, problem.recording.board_time_s)
    low, high = stood.min(axis=0), stood.max(axis=0)
    if high[column] - low[column] < 1e-3:
        return []
    drawn = np.random.default_rng(0).uniform(*_ranges(problem, low, high), size=(DRAWN, len(low)))
    drawn[:, column] = 0.5 * (low[column] + high[column])
    still = np.repeat(drawn[:, None], 3, axis=1).reshape(-1, len(low))
    load = rollouts.load(
        Motion(rollouts.start_s, STEP_S, [Branch(np.arange(len(low)), still, np.zeros_like(still))]),
        _middles(rollouts),
    )[:, column]
    order = np.argsort(load)
    bases = [drawn[row] for row in (order[0], order[len(order) // 2], order[-1], np.argmin(np.abs(load)))]
    out = []
    middle, half = 0.5 * (low[column] + high[column]), 0.5 * (high[column] - low[column])
    for base in bases:
        posture = {name: round(float(q), 4) for name, q in zip(rollouts.joints, base, strict=True)}
        for way, speed in ((1.0, SLOW), (1.0, 1.0), (SHORT, 1.0)):
            # Half a cosine goes by at most π / 2 of its mean speed.
            seconds = np.pi * way * half / (speed * problem.scales[joint].speed)
            seconds = round(min(LONGEST_S, max(0.1, float(seconds))), 2)
            start, end = (
                {**posture, joint: round(float(middle + side * way * half), 4)} for side in (-1.0, 1.0)
            )
            out.append(Move(joint, start, end, seconds, why, 0.0))
    return out


def _ranges(problem: Problem, low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """The joints' ranges, their middle part; if the robot states none, the range of the log."""
    low, high = low.copy(), high.copy()
    known = {joint.name: joint for joint in problem.session.robot.joints}
    for j, name in enumerate(problem.rollouts.joints):
        joint = known.get(name)
        if joint is not None and np.isfinite(joint.lower) and np.isfinite(joint.upper):
            low[j], high[j] = min(low[j], joint.lower), max(high[j], joint.upper)
    edge = 0.5 * (1.0 - WITHIN) * (high - low)
    return np.asarray(low + edge), np.asarray(high - edge)


def _middles(rollouts: Rollouts) -> Floats:
    """The times of the middle of each drawn posture, in a motion that stands three steps in each."""
    return np.asarray(rollouts.start_s + STEP_S * (3.0 * np.arange(DRAWN) + 1.0))


def _log(problem: Problem, moves: Sequence[Move]) -> tuple[States, list[tuple[float, float]]]:
    """One log that goes through the moves one after the other, and when each begins and ends."""
    joints = problem.rollouts.joints
    rows: list[Floats] = []
    spans: list[tuple[float, float]] = []
    now = 0.0
    for move in moves:
        start, end = (np.array([p[name] for name in joints]) for p in (move.start, move.end))
        before = rows[-1][-1] if rows else start
        rows.append(_way(before, start, GO_THERE_S))
        begin = now + GO_THERE_S
        for part in (_way(start, start, REST_S), _way(start, end, move.seconds), _way(end, end, REST_S)):
            rows.append(part)
        rows.append(_way(end, start, move.seconds))
        now = LOG_STEP_S * sum(len(part) for part in rows)
        spans.append((begin, now))
    table: Floats = np.concatenate(rows)
    times: Floats = LOG_STEP_S * np.arange(len(table), dtype=np.float64)
    return States(times, joints, table), spans


def _way(start: Floats, end: Floats, seconds: float) -> Floats:
    """Rows of the log along half a cosine."""
    count = max(1, round(seconds / LOG_STEP_S))
    share = 0.5 - 0.5 * np.cos(np.pi * (np.arange(count) + 1) / count)
    return np.asarray(start + share[:, None] * (end - start))


def _times(log: States) -> Floats:
    """Pictures throughout a log."""
    return np.arange(float(log.time_s[0]), float(log.time_s[-1]), PICTURE_STEP_S)


def _named(key: Key) -> str:
    return f"{key[0].replace('_', ' ')} at {key[1].partition(':')[2] or key[1]}"
