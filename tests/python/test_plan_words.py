"""Sizes of causes in a plan's words: in the unit that a person measures, which a prismatic joint has another of."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from mirror_posture.plan.picture import MOST_ROWS, _table
from mirror_posture.plan.sizes import apart_in_words, size_in_words
from mirror_posture.plan.telling import Rival, Tells

JOINTS = [SimpleNamespace(name="elbow", kind="revolute"), SimpleNamespace(name="rail", kind="prismatic")]
PLAN: Any = SimpleNamespace(
    setting=SimpleNamespace(nominal=SimpleNamespace(robot=SimpleNamespace(joints=JOINTS)))
)


def tells(effect: str, at: str) -> Tells:
    return Tells(effect, at, {}, ())


@pytest.mark.parametrize(
    ("effect", "at", "size", "words"),
    [
        ("joint_offset", "joint:elbow", math.radians(0.25), "0.25°"),
        ("joint_offset", "joint:rail", 0.00123, "1.2 mm"),
        ("backlash", "joint:rail", 0.002, "2 mm"),
        ("joint_compliance", "joint:elbow", math.radians(0.3), "0.3°/N m"),
        ("joint_compliance", "joint:rail", 1e-4, "0.1 mm/N"),
        ("drift", "joint:rail", 1e-5, "36 mm/h"),
        ("drift", "joint:elbow", math.radians(0.01), "36°/h"),
        # A share is a share of either.
        ("gear_ratio", "joint:rail", 0.02, "2 %"),
        ("axis_tilt", "joint:rail", math.radians(1.0), "1°"),
        ("link_length", "link:hand", 0.0034, "3.4 mm"),
    ],
)
def test_a_size_has_the_unit_of_its_joint(effect: str, at: str, size: float, words: str) -> None:
    assert size_in_words(PLAN, tells(effect, at), size) == words


def test_what_no_size_tells_apart_is_said_so() -> None:
    cause = tells("joint_offset", "joint:elbow")
    assert apart_in_words(PLAN, cause, Rival("gear_ratio@joint:elbow", math.inf)) == "at no size"
    assert apart_in_words(PLAN, cause, Rival("gear_ratio@joint:elbow", math.radians(2.0))) == "from 2° on"


@pytest.mark.parametrize(("more", "said"), [(0, []), (6, ["... and 6 more, see plan.json"])])
def test_joints_that_the_picture_has_no_room_for_are_counted(more: int, said: list[str]) -> None:
    figure = pytest.importorskip("matplotlib.figure").Figure()
    names = [f"joint_{number}" for number in range(MOST_ROWS + more)]
    joints = [SimpleNamespace(name=name, parent_link="base") for name in names]
    nominal = SimpleNamespace(robot=SimpleNamespace(joints=joints))
    plan: Any = SimpleNamespace(tells=(), setting=SimpleNamespace(nominal=nominal, joint_names=names))
    _table(axes := figure.subplots(), plan)
    assert [text.get_text() for text in axes.texts] == said
    (drawn,) = axes.tables
    assert {row for row, _ in drawn.get_celld()} == set(range(MOST_ROWS + 1))
