"""Which of several balls is the marker: by place and size together, with odds that are what they say."""

from __future__ import annotations

import numpy as np
import pytest

from mirror_posture.detect.rivals import LEAST_ODDS, Rival, choose, clearly_nearer
from mirror_posture.detect.types import PredictedMarker

FOCAL_PX = 900.0
RADIUS_PX = 12.0
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
    assert choose([at(60.0), at(30.0)], EXPECTED, FOCAL_PX)[0] == 1
    assert choose([at(30.0), at(30.0 * 1.02 * ratio)], EXPECTED, FOCAL_PX)[0] == 0
    index, reason = choose([at(30.0), at(30.0 * 0.98 * ratio)], EXPECTED, FOCAL_PX)
    assert index == -1 and "2 balls of its colour and size, 30 and 47 px" in reason
    # The one farther across, but of the expected size.
    assert choose([at(7.0, 1.05), at(15.0)], EXPECTED, FOCAL_PX)[0] == 1
    # Without sizes an axis is missing: the places must say more.
    assert choose([at(30.0, None), at(30.0 * 1.02 * ratio, None)], EXPECTED, FOCAL_PX)[0] == -1
    assert choose([at(30.0, None), at(61.0, None)], EXPECTED, FOCAL_PX)[0] == 0
    # A few px do not tell balls apart, whatever their ratio.
    assert choose([at(1.0), at(0.5 * RADIUS_PX)], EXPECTED, FOCAL_PX)[0] == -1


@pytest.mark.parametrize("model_m", [0.002, 0.005, 0.02])
def test_a_choice_is_wrong_no_more_often_than_the_odds_say(model_m: float) -> None:
    """Models that are off alike in all directions; a rival of about its size anywhere near."""
    rng = np.random.default_rng(3)
    distance_m = 0.6
    taken = wrong = 0
    for _ in range(4000):
        error = rng.normal(0.0, model_m, 3) / distance_m
        marker = Rival((100.0 + FOCAL_PX * error[0], 80.0 + FOCAL_PX * error[1]), float(np.exp(error[2])))
        away = rng.uniform(-120.0, 120.0, 2)
        other = Rival((100.0 + away[0], 80.0 + away[1]), float(np.exp(rng.uniform(-0.05, 0.05))))
        index, _ = choose([marker, other], EXPECTED, FOCAL_PX)
        taken += index >= 0
        wrong += index == 1
    assert taken > 2000
    assert wrong / taken < 1.0 / (1.0 + LEAST_ODDS)


def test_a_thing_that_is_measured_and_of_another_size_is_not_nearer() -> None:
    chosen = at(20.0)
    assert clearly_nearer(at(3.0, None), chosen, EXPECTED, FOCAL_PX)
    assert clearly_nearer(at(3.0, 1.0), chosen, EXPECTED, FOCAL_PX)
    assert not clearly_nearer(at(3.0, 1.37), chosen, EXPECTED, FOCAL_PX)
    assert not clearly_nearer(at(15.0, None), chosen, EXPECTED, FOCAL_PX)
