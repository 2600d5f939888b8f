"""Parts of the diagnosis of a motion that need no simulated session: laws of commands, the noise, gross errors."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("mujoco")

from mirror_simulation.motion.drives import lagged, slewed
from mirror_simulation.motion.false_images import false_images
from mirror_simulation.motion.report import named
from mirror_simulation.motion.rollouts import STEP_S
from mirror_simulation.motion.shown import bagged
from mirror_simulation.motion.statistics import misfit, noise_scale


def test_laws_of_commands() -> None:
    time = np.arange(0.0, 2.0, STEP_S)
    ramp = np.maximum(time - 0.2, 0.0)
    late = lagged(ramp, 0.05, STEP_S)
    # Behind a ramp a filter of first order stays by its time constant.
    assert np.allclose((ramp - late)[-100:], 0.05, atol=1e-6)
    slow = slewed(ramp, 0.4, STEP_S)
    assert np.isclose(np.diff(slow).max() / STEP_S, 0.4) and np.all(slow <= ramp + 1e-12)


def test_noise_is_read_off_beside_a_slow_error_and_correlation_counts() -> None:
    rng = np.random.default_rng(1)
    seen = np.ones((600, 4), dtype=bool)
    time = np.arange(600)[:, None, None] / 30.0
    white = rng.normal(size=(600, 4, 2))
    slow = 10.0 * np.sin(2.0 * np.pi * 0.5 * time)
    assert abs(noise_scale(1.3 * white + slow, seen) - 1.3) < 0.08
    late = white.copy()
    for i in range(1, 600):
        late[i] = 0.35 * late[i - 1] + np.sqrt(1.0 - 0.35**2) * late[i]
    assert abs(noise_scale(late + slow, seen) - 1.0) < 0.08
    assert misfit(white, seen).inflation < 1.15
    assert misfit(white + slow, seen).inflation > 50.0


def test_a_limbs_own_quick_error_is_no_noise() -> None:
    rng = np.random.default_rng(5)
    seen = np.ones((600, 4), dtype=bool)
    shaken = rng.normal(size=(600, 4, 2))
    # Two of four markers are on what shakes, for most of the time.
    shaken[100:, :2] *= 4.0
    assert abs(noise_scale(shaken, seen) - 1.0) < 0.15


def test_correlated_rows_count_less_and_a_larger_error_widens() -> None:
    rng = np.random.default_rng(6)
    seen = np.ones((4000, 2), dtype=bool)
    white = rng.normal(size=(4000, 2, 2))
    assert abs(misfit(2.0 * white, seen).inflation - 4.0) < 0.4
    # What a model leaves less of than the noise is no reason to claim more.
    assert abs(misfit(0.5 * white, seen).inflation - 1.0) < 0.1
    late = white.copy()
    for i in range(1, 4000):
        late[i] = 0.6 * late[i - 1] + 0.8 * late[i]
    found = misfit(late, seen)
    assert abs(found.correlation - 0.6) < 0.05
    # n (1 − ρ)/(1 + ρ), and the inverse for a square.
    assert abs(found.effective_rows / found.rows - 0.25) < 0.04 and abs(found.inflation - 4.0) < 0.6


def test_gross_errors_are_told_from_a_body_that_moves_otherwise() -> None:
    rng = np.random.default_rng(3)
    time = np.arange(180)[:, None, None] / 30.0
    images = 0.2 * rng.normal(size=(180, 3, 2)) + 8.0 * np.sin(2.0 * np.pi * 0.7 * time)
    images[40, 1] = np.nan
    wrong = np.zeros((180, 3), dtype=bool)
    wrong[[0, 60, 62, 90, 91, 150, 153, 155, 179], 1] = True
    images[wrong] += 6.0 * rng.choice([-1.0, 1.0], size=(int(wrong.sum()), 2))
    # A limb that swings once, unlike the model, within half a second.
    images[120:136, 2] += 15.0 * (1.0 - np.cos(2.0 * np.pi * np.arange(16) / 16.0))[:, None]
    assert (false_images(images, 0.2) == wrong).all()


def test_no_cause_is_more_probable_than_it_is_stable_and_an_improbable_one_is_not_named() -> None:
    assert bagged(None) == bagged(1.0) == 1.0 and 0.95 < bagged(0.975) < 0.975 and 0.0 < bagged(0.0) < 0.02
    assert abs(bagged(0.5) - 0.5) < 1e-12
    causes = [{"effect": "servo_lag", "probability": p} for p in (0.97, 0.04, 0.1)]
    sure, unsure = named(causes)
    assert [c["probability"] for c in sure] == [0.97, 0.1]
    assert [c["probability"] for c in unsure] == [0.04]
