"""The order of a plan's postures: arrivals of each joint balanced over side, load and position, counted here along the path."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from mirror_posture.plan.choose import STEP_RAD, between, order


class FreeRoom:
    """A room in which nothing blocks."""

    def take(self, posture: np.ndarray) -> None:
        pass

    def collision(self) -> None:
        return None

    def glass_free(self, mirror: object) -> bool:
        return True


def imbalance(path: np.ndarray, load: np.ndarray) -> np.ndarray:
    """The largest joint's sum of arrival sides, alone and times load and position; `path` begins with the start."""
    side = np.sign(np.diff(path, axis=0))
    return np.array([np.abs((side * by).sum(axis=0)).max() for by in (np.ones_like(load), load, path[1:])])


def test_arrivals_are_balanced_far_better_than_in_an_order_by_chance() -> None:
    ordered, by_chance = np.zeros(3), np.zeros(3)
    for seed in range(5):
        generator = np.random.default_rng(seed)
        positions, load = generator.uniform(-1, 1, (60, 4)), generator.uniform(0.2, 1, (60, 4))
        setting = SimpleNamespace(low=np.full(4, -1.0), high=np.full(4, 1.0), home=np.zeros(4))
        tally = np.zeros((3, 4))
        rows, trouble = order(setting, FreeRoom(), None, positions, np.zeros(4), tally, load)
        assert sorted(rows) == list(range(60)) and not trouble
        path = np.vstack([np.zeros(4), positions[rows]])
        ordered += imbalance(path, load[rows])
        np.testing.assert_allclose(tally[0], np.sign(np.diff(path, axis=0)).sum(axis=0))
        for shuffled in (generator.permutation(60) for _ in range(20)):
            by_chance += imbalance(np.vstack([np.zeros(4), positions[shuffled]]), load[shuffled]) / 20
    assert (ordered < 0.6 * by_chance).all(), (ordered, by_chance)


def test_a_way_is_checked_along_a_straight_line_in_small_steps() -> None:
    start, end = np.array([0.0, 1.0, -0.2]), np.array([1.6, 0.9, -0.2])
    inside = np.array(list(between(start, end)))
    steps = np.diff(np.vstack([start, inside, end]), axis=0)
    assert np.abs(steps).max() <= STEP_RAD + 1e-12
    assert len(inside) > 0 and np.allclose(steps, steps[0])
    assert len(list(between(start, start + 1e-3))) == 1
