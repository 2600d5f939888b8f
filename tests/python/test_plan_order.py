"""The order of a plan's postures: arrivals of each joint balanced over side, load and position, counted here along the path."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mirror_posture.plan.choose import between, order, path_blocked
from mirror_posture.plan.room import STEP_RAD, Room
from mirror_posture.plan.run import _standing


class FreeRoom:
    """A room in which nothing blocks."""

    steps = np.full(4, STEP_RAD)

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
    joints = np.full(3, STEP_RAD)
    inside = np.array(list(between(joints, start, end)))
    steps = np.diff(np.vstack([start, inside, end]), axis=0)
    assert np.abs(steps).max() <= STEP_RAD + 1e-12
    assert len(inside) > 0 and np.allclose(steps, steps[0])
    assert len(list(between(joints, start, start + 1e-3))) == 1


class Post:
    """A body with a post in the way of its first joint, about as wide as the clearance."""

    def __init__(self, begin: float, end: float) -> None:
        self.begin, self.end, self.at = begin, end, 0.0

    def put(self, positions: np.ndarray) -> None:
        self.at = float(positions[0])

    def touching(self) -> bool:
        return self.begin < self.at < self.end


@pytest.mark.parametrize(
    ("kind", "multiplier", "post", "found"),
    [
        # At every 15 cm, as if it turned, nothing is seen of it.
        ("prismatic", 1.0, (0.10, 0.12), "touches itself"),
        # A slide that goes three times as far as the one it follows.
        ("prismatic", 3.0, (0.104, 0.108), "touches itself"),
        ("revolute", 1.0, (0.10, 0.12), None),
    ],
)
def test_a_joint_that_slides_is_checked_at_every_clearance(
    kind: str, multiplier: float, post: tuple[float, float], found: str | None
) -> None:
    joints = [
        SimpleNamespace(kind=kind, position=0, multiplier=1.0),
        SimpleNamespace(kind=kind, position=0, multiplier=multiplier),
        SimpleNamespace(kind="fixed", position=None, multiplier=1.0),
        SimpleNamespace(kind="revolute", position=1, multiplier=1.0),
    ]
    robot = SimpleNamespace(joints=joints, position_names=("lift", "turn"))
    setting: Any = SimpleNamespace(nominal=SimpleNamespace(robot=robot))
    body: Any = Post(*post)
    room = Room(setting, body, 0.01, table_m=None)
    start, end = np.array([0.0, 0.2]), np.array([0.30, 0.1])
    assert path_blocked(setting, room, None, start, end) == found
    assert path_blocked(setting, room, None, end, start) == found


class Glass(FreeRoom):
    """A room with mirrors that are told by how far the first joint may go before them."""

    def take(self, posture: np.ndarray) -> None:
        self.at = posture[0]

    def glass_free(self, mirror: Any) -> bool:
        return bool(mirror is None or self.at < mirror)


def test_the_last_posture_of_a_view_is_clear_of_the_next_views_mirror() -> None:
    """The robot stands there while the mirror is turned; before, it was compared with the view's own only."""
    setting: Any = SimpleNamespace(low=np.full(4, -1.0), high=np.full(4, 1.0), home=np.zeros(4))
    mirror: Any = 2.0
    nowhere: Any = -3.0
    for seed in range(8):
        generator = np.random.default_rng(seed)
        positions, load = generator.uniform(-1, 1, (12, 4)), generator.uniform(0.2, 1, (12, 4))
        room: Any = Glass()
        for limit in (-0.2, 0.5):
            after: Any = limit
            rows, trouble = order(
                setting, room, mirror, positions, np.zeros(4), np.zeros((3, 4)), load, after
            )
            assert sorted(rows) == list(range(12)) and not trouble
            assert positions[rows[-1], 0] < limit
        # Where no posture is clear of it, all are taken all the same: the plan warns.
        rows, trouble = order(setting, room, mirror, positions, np.zeros(4), np.zeros((3, 4)), load, nowhere)
        assert sorted(rows) == list(range(12)) and not trouble


def test_a_plan_warns_where_the_robot_stands_in_the_way() -> None:
    setting: Any = SimpleNamespace(home=np.array([0.5]))
    room: Any = Glass()
    near, far = np.array(0.3), np.array(0.9)
    mirrors: Any = [far, far, near, near]
    positions = np.array([[0.2], [0.4], [0.1], [0.0]])
    (told,) = _standing(setting, room, mirrors, positions)
    assert told.startswith("at frame 1 the robot is too near to the glass of the next view")
    (told,) = _standing(setting, room, mirrors[2:], positions[2:])
    assert told.startswith(
        "at home the robot comes too near to the glass of the first view: begin at another"
    )
    room.collision = lambda: "touches the table"
    (told,) = _standing(setting, room, mirrors[:2], positions[:2])
    assert told.startswith("at home the robot touches the table: begin at another --home, or check --table")
