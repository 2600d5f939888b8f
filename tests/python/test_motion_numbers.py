"""Numbers of moving sessions and of the simulator's gap against integrals and least squares written out here."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mirror_simulation.motion.evidence import volume
from mirror_simulation.motion.standing import _first
from mirror_simulation.motion.statistics import misfit
from mirror_simulation.simulate.gap import FREE_MARKER_M, _Images, _metre_squares


@pytest.mark.parametrize("information", [0.3, 40.0, 5e4])
def test_the_evidence_keeps_what_the_pictures_leave_of_what_is_usual(information: float) -> None:
    usual, step, inflation = 0.04, 0.01, 2.5
    effect = SimpleNamespace(is_limit=False)
    problem = SimpleNamespace(hypotheses={"key": SimpleNamespace(step=[step], usual=[usual], effect=effect)})
    causes = {("joint_offset", "joint:a"): (0.0,)}
    problem.hypotheses = {("joint_offset", "joint:a"): problem.hypotheses["key"]}
    model: Any = SimpleNamespace(
        information=np.array([[information]]), of=((("joint_offset", "joint:a"), 0),), causes=causes
    )
    # ∫ exp(−information p² / 2 φ) N(p; 0, usual²) dp, p in steps.
    std = usual / step
    p = np.linspace(-12.0 * std, 12.0 * std, 400_001)
    prior = np.exp(-0.5 * (p / std) ** 2) / (std * np.sqrt(2.0 * np.pi))
    kept = float(np.sum(np.exp(-0.5 * information * p**2 / inflation) * prior) * (p[1] - p[0]))
    assert volume(problem, model, inflation) == pytest.approx(np.log(kept), abs=1e-3)  # type: ignore[arg-type]


def test_the_gap_in_metres_is_the_least_squares_place_of_the_markers() -> None:
    random = np.random.default_rng(9)
    frames, markers, noise_px = 4, 2, 0.3
    posture = np.array([0, 0, 1, 1])
    residual, by_point = (
        random.normal(0.0, 2.0, (frames, markers, 2)),
        random.normal(0.0, 900.0, (frames, markers, 2, 3)),
    )
    by_foot = random.normal(0.0, 1500.0, (frames, markers, 2, 3))
    half = random.normal(0.0, 4e-4, (frames, 3, 3))
    feet = half @ half.swapaxes(1, 2)
    seen, usable = np.ones((frames, markers), dtype=bool), np.ones(frames, dtype=bool)
    none = np.zeros_like
    mirrored = _Images(residual, by_point, by_foot, seen, usable)
    direct = _Images(none(residual), none(by_point), none(by_foot), none(seen), usable)
    session: Any = SimpleNamespace(frames=SimpleNamespace(posture=posture))
    done: Any = SimpleNamespace(foot_covariance_m2=feet)
    found = np.array(_metre_squares(session, mirrored, direct, done, noise_px))
    for k in (0, 1):
        # Unknowns: both markers' places, then the foot of each view's mirror.
        rows, right = [], []
        for i, f in enumerate(np.flatnonzero(posture == k)):
            for m in range(markers):
                row = np.zeros((2, 12))
                row[:, 3 * m : 3 * m + 3] = by_point[f, m] / noise_px
                row[:, 6 + 3 * i : 9 + 3 * i] = by_foot[f, m] / noise_px
                rows.append(row)
                right.append(residual[f, m] / noise_px)
            of_foot = np.zeros((3, 12))
            of_foot[:, 6 + 3 * i : 9 + 3 * i] = np.linalg.inv(half[f])
            rows.append(of_foot)
            right.append(np.zeros(3))
        rows.append(np.eye(6, 12) / FREE_MARKER_M)
        right.append(np.zeros(6))
        places = np.linalg.lstsq(np.concatenate(rows), np.concatenate(right), rcond=None)[0][:6].reshape(2, 3)
        assert found[:, k] == pytest.approx((places**2).sum(axis=1), rel=1e-6)


def test_where_a_log_begins_is_known_as_well_as_is_claimed() -> None:
    random = np.random.default_rng(12)
    time = np.linspace(0.0, 0.3, 20)
    first_s, freedom = 0.24, int((time <= 0.24).sum()) - 4
    true = np.array([0.4, -1.5])
    squares = []
    for _ in range(800):
        readings = true[0] + true[1] * time + 3.0 * time**2 - 8.0 * time**3 + random.normal(0.0, 0.01, 20)
        found = _first(time, readings, first_s)
        assert found is not None
        off = found[1] - true
        squares.append(off @ found[2] @ off)
    # Two numbers of a fit whose noise is its own: the mean of 2 F(2, ν).
    assert np.mean(squares) == pytest.approx(2.0 * freedom / (freedom - 2), rel=0.12)


def test_a_remainder_that_lingers_counts_as_fewer_rows() -> None:
    random = np.random.default_rng(13)
    frames, correlation = 4000, 0.5
    residual = np.zeros((frames, 2, 2))
    for f in range(1, frames):
        residual[f] = correlation * residual[f - 1] + random.normal(0.0, 1.0, (2, 2))
    found = misfit(residual, np.ones((frames, 2), dtype=bool))
    assert found.correlation == pytest.approx(correlation, abs=0.03) and found.rows == 4 * frames
    # The mean of N rows of this scatters as one of N (1 − ρ) / (1 + ρ) rows that are independent.
    means = residual.reshape(40, 100, 4).mean(axis=1)
    assert found.effective_rows / (4 * frames) == pytest.approx(
        residual.var() / (100 * means.var()), rel=0.25
    )
