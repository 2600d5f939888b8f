"""Described robots before a mast: markers in front, ranges within limits, sessions that can be made; and a wrong link that shows."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="blind sessions need MuJoCo")
pytest.importorskip("pinocchio", reason="its package example-robot-data has the robots")

from mirror_lab.blind.described_robots import DESCRIBED, HALF_RANGE_RAD
from mirror_lab.blind.kinematics import Change, chain
from mirror_lab.blind.simulate import KINDS, Options, simulate
from mirror_lab.blind.truth import Commands


@pytest.mark.parametrize("name", DESCRIBED)
def test_a_described_robot_has_its_markers_in_front_of_its_board(name: str) -> None:
    robot = KINDS[name](np.random.default_rng(3))
    assert robot.markers == list(DESCRIBED[name].markers) and len(robot.commanded) >= 6
    tree = ET.fromstring(robot.urdf)
    for joint, (low, high) in robot.ranges.items():
        body = robot.bodies[robot.body_of_joint(joint)]
        assert 0.2 < high - low <= 2 * HALF_RANGE_RAD + 1e-9 and body.lower <= low < high <= body.upper
        assert any(j.get("name") == joint for j in tree.findall("joint"))
    middle = np.array([[np.mean(robot.ranges[j]) for j in robot.commanded]])
    at = chain(robot, Commands(robot.commanded, middle, np.zeros(1)), Change())
    places = {n: at.position_m[robot.index[n], 0] for n in ("chest_board", "camera_optical")}
    in_front = [at.position_m[robot.index[f"{m}_marker"], 0] - places["chest_board"] for m in robot.markers]
    # The board looks along x.
    assert all(p[0] > 0 for p in in_front), in_front
    assert places["camera_optical"][2] > places["chest_board"][2]


def test_a_wrong_link_is_one_that_moves_otherwise_and_fixed_links_are_one() -> None:
    options = Options(robots=("baxter",), frames=(60, 61), least_postures=30)
    for seed in range(4):
        case = simulate("case", "baxter", ["marker_parent"], np.random.default_rng(seed), options)
        (cause,) = case.answer["causes"]
        on = cause["at"].split("<-link:")[1]
        marker = cause["at"].split("<-")[0].removeprefix("marker:")
        mount = next(
            j
            for j in ET.fromstring(case.told.urdf).findall("joint")
            if j.find("child").get("link") == f"{marker}_marker"
        )
        told = mount.find("parent").get("link")
        robot = case.robot
        bodies = [robot.rigid_root(robot.index[link]) for link in (on, told)]
        assert bodies[0] != bodies[1], (on, told)
        for other in cause.get("tolerated", []):
            same = other["at"].split("<-link:")[1]
            assert robot.rigid_root(robot.index[same]) == bodies[0]
