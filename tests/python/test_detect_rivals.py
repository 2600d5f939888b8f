"""Which of several balls is the marker: by place and size together, with odds that are what they say."""

from __future__ import annotations

import numpy as np
import pytest

from mirror_posture.detect.rivals import (
    LEAST_ODDS,
    ModelErrors,
    Rival,
    choose,
    clearly_nearer,
    errors_elsewhere,
)
from mirror_posture.detect.types import PredictedMarker

FOCAL_PX = 900.0
RADIUS_PX = 12.0
DIAMETER_M = 0.016
M_PER_PX = 0.5 * DIAMETER_M / RADIUS_PX
EXPECTED = PredictedMarker("hand", (100.0, 80.0), np.inf, RADIUS_PX)


def at(across_px: float, size: float | None = 1.0) -> Rival:
    return Rival((100.0 + 0.6 * across_px, 80.0 - 0.8 * across_px), size)


def test_a_ball_is_off_by_place_and_size_together() -> None:
    assert at(12.0).off_px(EXPECTED, FOCAL_PX) == pytest.approx(12.0)
    assert at(0.0, np.exp(0.01)).off_px(EXPECTED, FOCAL_PX) == pytest.approx(9.0)
    assert at(12.0, np.exp(-0.01)).off_px(EXPECTED, FOCAL_PX) == pytest.approx(15.0)
    assert at(12.0, None).off_px(EXPECTED, FOCAL_PX) == pytest.approx(12.0)


def test_the_nearest_in_space_is_taken_only_at_the_least_odds() -> None:
    ratio = LEAST_ODDS ** (1.0 / 3.0)
    assert choose([at(90.0), at(30.0)], EXPECTED, FOCAL_PX, DIAMETER_M)[0] == 1
    assert choose([at(30.0), at(30.0 * 1.02 * ratio)], EXPECTED, FOCAL_PX, DIAMETER_M)[0] == 0
    index, reason = choose([at(30.0), at(30.0 * 0.98 * ratio)], EXPECTED, FOCAL_PX, DIAMETER_M)
    assert index == -1 and "2 balls of its colour and size, 30 and 80 px" in reason
    # The one farther across, but of the expected size.
    assert choose([at(7.0, 1.05), at(14.0)], EXPECTED, FOCAL_PX, DIAMETER_M)[0] == 1
    # Without sizes an axis is missing: the places must say more.
    assert choose([at(30.0, None), at(30.0 * 1.02 * ratio, None)], EXPECTED, FOCAL_PX, DIAMETER_M)[0] == -1
    assert choose([at(30.0, None), at(135.0, None)], EXPECTED, FOCAL_PX, DIAMETER_M)[0] == 0
    # A few px do not tell balls apart, whatever their ratio.
    assert choose([at(1.0), at(0.5 * RADIUS_PX)], EXPECTED, FOCAL_PX, DIAMETER_M)[0] == -1


def test_the_other_balls_tell_how_far_the_model_is_off() -> None:
    def told(near_px: float, far_px: float, off_px: float, balls: int = 5) -> bool:
        elsewhere = ModelErrors(balls, balls * (off_px * M_PER_PX) ** 2)
        index, _ = choose([at(far_px), at(near_px)], EXPECTED, FOCAL_PX, DIAMETER_M, elsewhere)
        return index == 1

    # Alone, 10 px against 24 are too near, and 10 against 30 are told.
    assert not told(10.0, 24.0, 0.0, 0) and told(10.0, 30.0, 0.0, 0)
    # Errors of about 10 px are rarely of 24; where they are of 25, both are usual.
    assert told(10.0, 26.0, 10.0)
    assert not told(10.0, 30.0, 25.0)
    # A ball that is off by a joint of its own: that the others are not off at all is no proof.
    assert not told(20.0, 30.0, 1.0)
    offs_m = [0.001, None, 0.002, 0.004]
    assert errors_elsewhere(offs_m, 3).balls == 2
    assert errors_elsewhere(offs_m, 3).squares_m2 == pytest.approx(5e-6)


@pytest.mark.parametrize("others", [0, 5])
@pytest.mark.parametrize("model_m", [0.002, 0.005, 0.02])
def test_a_choice_is_wrong_no_more_often_than_the_odds_say(model_m: float, others: int) -> None:
    """Models that are off alike in all directions; a rival of about its size anywhere near."""
    rng = np.random.default_rng(3)
    distance_m = 0.6
    taken = wrong = 0
    for _ in range(4000):
        error = rng.normal(0.0, model_m, 3) / distance_m
        elsewhere = ModelErrors(others, float(np.sum(rng.normal(0.0, model_m, (others, 3)) ** 2)))
        marker = Rival((100.0 + FOCAL_PX * error[0], 80.0 + FOCAL_PX * error[1]), float(np.exp(error[2])))
        away = rng.uniform(-120.0, 120.0, 2)
        other = Rival((100.0 + away[0], 80.0 + away[1]), float(np.exp(rng.uniform(-0.05, 0.05))))
        index, _ = choose(
            [marker, other], EXPECTED, FOCAL_PX, 2.0 * RADIUS_PX * distance_m / FOCAL_PX, elsewhere
        )
        taken += index >= 0
        wrong += index == 1
    assert taken > (1000 if others == 0 or model_m > 0.01 else 3000)
    assert wrong / taken < 0.5 / (1.0 + LEAST_ODDS)


def test_a_thing_that_is_measured_and_of_another_size_is_not_nearer() -> None:
    chosen = at(20.0)
    assert clearly_nearer(at(3.0, None), chosen, EXPECTED, FOCAL_PX)
    assert clearly_nearer(at(3.0, 1.0), chosen, EXPECTED, FOCAL_PX)
    assert not clearly_nearer(at(3.0, 1.37), chosen, EXPECTED, FOCAL_PX)
    assert not clearly_nearer(at(15.0, None), chosen, EXPECTED, FOCAL_PX)
