"""What a planned posture keeps clear of: the table, the glass, the robot's hiding parts; distances worked out by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mirror_posture.plan import candidates
from mirror_posture.plan.room import GLASS_CLEARANCES, Room

CLEARANCE_M = 0.01


def room(lowest_m: float, foremost_m: float) -> Room:
    """A body that reaches down to a height and forward to a distance, above a table at 0."""

    def extent_m(direction: np.ndarray, links: list[str] | None) -> float:
        return foremost_m if direction[0] > 0.0 else -lowest_m

    body: Any = SimpleNamespace(touching=lambda: set(), extent_m=extent_m)
    nominal = SimpleNamespace(robot=SimpleNamespace(joints=[]))
    setting: Any = SimpleNamespace(nominal=nominal, moving=[], up=np.array([0.0, 0.0, 1.0]))
    return Room(setting, body, CLEARANCE_M, table_m=0.0)


@pytest.mark.parametrize(("lowest_m", "found"), [(0.011, None), (0.009, "touches the table"), (-0.1, "touches the table")])  # fmt: skip
def test_the_robot_stays_its_clearance_above_the_table(lowest_m: float, found: str | None) -> None:
    assert room(lowest_m, 0.0).collision() == found


@pytest.mark.parametrize(("times", "free"), [(1.1, True), (0.9, False), (-1.0, False)])
def test_the_robot_stays_several_clearances_from_the_glass(times: float, free: bool) -> None:
    mirror: Any = SimpleNamespace(
        normal_in_root=np.array([1.0, 0.0, 0.0]), center_in_root_m=np.array([0.5, 0.2, 0.1])
    )
    assert room(0.0, 0.5 - times * GLASS_CLEARANCES * CLEARANCE_M).glass_free(mirror) == free
    assert GLASS_CLEARANCES >= 2.0


def test_a_posture_is_taken_if_one_of_its_balls_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    sight = SimpleNamespace(
        board=np.array([True, True, True]),
        markers=np.array([[True, True], [True, True], [True, True]]),
        real=np.array([False, False, False]),
    )
    hidden = {0: np.array([True, False]), 1: np.array([False, False]), 2: None}
    monkeypatch.setattr(candidates, "scene_of", lambda setting, postures: None)
    monkeypatch.setattr(candidates, "look", lambda setting, scene, mirror: sight)
    monkeypatch.setattr(candidates, "unhidden", lambda setting, body, scene, sight, mirror, row: hidden[row])
    setting: Any = SimpleNamespace(nominal=SimpleNamespace(metadata=SimpleNamespace(markers=["a", "b"])))
    free: Any = SimpleNamespace(
        take=lambda q: None, collision=lambda: None, glass_free=lambda m: True, body=None
    )
    options: Any = SimpleNamespace(real_balls_allowed=False)
    random = np.random.default_rng(0)
    found = candidates.sift(setting, [object()], free, options, np.arange(3.0)[:, None], 9, random)  # type: ignore[list-item]
    assert found.positions.tolist() == [[0.0]] and found.markers.tolist() == [[True, False]]
    assert found.reasons == {
        "the robot hides the board from the mirror": 1,
        "the robot hides its balls from the mirror": 1,
    }
