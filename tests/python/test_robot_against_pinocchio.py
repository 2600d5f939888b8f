"""Kinematics, Jacobians and gravity torques against pinocchio, on public robots at random postures.

pinocchio reads the same URDF by its own parser. Mimic joints are given to it as free joints whose positions, Jacobian columns
and torques are combined here, by the file's own tags.
"""

from __future__ import annotations

import importlib.util
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from mirror_posture.robot import Robot

pin = pytest.importorskip("pinocchio", reason="pinocchio (pip install pin) is not installed")
_spec = importlib.util.find_spec("cmeel")
_cmeel = Path(_spec.origin).parent.parent if _spec and _spec.origin else None
DATA = _cmeel / "cmeel.prefix/share/example-robot-data/robots" if _cmeel else Path("absent")

ROBOTS = {
    "talos": "talos_data/robots/talos_full_v2.urdf",
    "g1": "g1_description/urdf/g1_29dof_rev_1_0.urdf",
    "g1 with hands": "g1_description/urdf/g1_29dof_with_hand_rev_1_0.urdf",
    "icub": "icub_description/robots/icub.urdf",
    "romeo": "romeo_description/urdf/romeo.urdf",
    "pr2": "pr2_description/urdf/pr2.urdf",
    "so101": "so_arm_description/urdf/so101.urdf",
}
POSTURES = 6
TOLERANCE = 1e-9
GRAVITY = np.array([0.7, -1.3, -9.81])  # in the held link's frame, on no axis


@dataclass
class Pair:
    """A robot as the project and as pinocchio (on a free-flying base) read it."""

    robot: Robot
    model: pin.Model
    data: pin.Data
    mimics: dict[str, tuple[str, float, float]]

    def angle(self, name: str, q: dict[str, float]) -> float:
        """Position of a joint, through its `<mimic>` tags."""
        if name in self.mimics:
            of, multiplier, offset = self.mimics[name]
            return multiplier * self.angle(of, q) + offset
        return q[name]

    def weights(self, name: str) -> tuple[str, float]:
        """The joint that drives a joint, and how fast."""
        if name in self.mimics:
            of, multiplier, _ = self.mimics[name]
            driver, factor = self.weights(of)
            return driver, multiplier * factor
        return name, 1.0

    def spread(self) -> np.ndarray:
        """`∂ velocities of pinocchio's joints / ∂ velocities of the project's positions`, (nv, nq)."""
        out = np.zeros((self.model.nv, len(self.robot.position_names)))
        for j in range(2, self.model.njoints):
            driver, factor = self.weights(self.model.names[j])
            out[self.model.joints[j].idx_v, self.robot.position_index(driver)] += factor
        return out

    def configuration(self, q: dict[str, float]) -> np.ndarray:
        out = pin.neutral(self.model)
        for j in range(2, self.model.njoints):
            joint, theta = self.model.joints[j], self.angle(self.model.names[j], q)
            if joint.nq == 2:  # a continuous joint
                out[joint.idx_q : joint.idx_q + 2] = np.cos(theta), np.sin(theta)
            else:
                out[joint.idx_q] = theta
        return out

    def frame(self, link: str) -> int:
        return self.model.getFrameId(link, pin.FrameType.BODY)


def read(name: str) -> Pair:
    path = DATA / ROBOTS[name]
    if not path.exists():
        pytest.skip(f"example-robot-data has no {ROBOTS[name]}")
    model = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
    mimics = {}
    for joint in ET.parse(path).getroot().iter("joint"):
        tag = joint.find("mimic")
        if tag is not None and joint.get("type") != "fixed":
            numbers = float(tag.get("multiplier", 1.0)), float(tag.get("offset", 0.0))
            mimics[joint.get("name")] = (tag.get("joint"), *numbers)
    return Pair(Robot.from_urdf(path), model, model.createData(), mimics)


@pytest.fixture(params=ROBOTS, scope="module")
def pair(request: pytest.FixtureRequest) -> Pair:
    return read(request.param)


@pytest.fixture(scope="module")
def postures(pair: Pair) -> np.ndarray:
    return np.random.default_rng(7).uniform(-3.0, 3.0, (POSTURES, len(pair.robot.position_names)))


def update(pair: Pair, q: np.ndarray) -> np.ndarray:
    x = pair.configuration(dict(zip(pair.robot.position_names, q, strict=True)))
    pin.computeJointJacobians(pair.model, pair.data, x)
    pin.updateFramePlacements(pair.model, pair.data)
    return x


def some_links(pair: Pair, count: int) -> list[str]:
    rng = np.random.default_rng(11)
    return [pair.robot.link_names[0], *rng.choice(pair.robot.link_names, count)]


def test_all_links_are_where_pinocchio_has_them(pair: Pair, postures: np.ndarray) -> None:
    poses = pair.robot.forward_kinematics(postures)
    some = [pair.robot.link_names[-1], pair.robot.link_names[1]]
    assert np.array_equal(pair.robot.link_poses(postures, some), poses[:, [-1, 1]])
    assert poses.shape == (POSTURES, len(pair.robot.link_names), 4, 4)
    for row, q in zip(poses, postures, strict=True):
        update(pair, q)
        for pose, link in zip(row, pair.robot.link_names, strict=True):
            np.testing.assert_allclose(
                pose, pair.data.oMf[pair.frame(link)].homogeneous, rtol=0, atol=TOLERANCE
            )


def test_movable_joints_and_their_positions_are_pinocchios(pair: Pair) -> None:
    ours = {j.name for j in pair.robot.joints if j.kind != "fixed"}
    assert ours == set(pair.model.names[2:])
    assert set(pair.robot.position_names) == ours - set(pair.mimics)


def test_masses_are_pinocchios(pair: Pair) -> None:
    assert sum(link.mass_kg for link in pair.robot.links) == pytest.approx(
        pin.computeTotalMass(pair.model), abs=TOLERANCE
    )


def test_joint_twists_are_the_columns_of_pinocchios_jacobian(pair: Pair, postures: np.ndarray) -> None:
    twists = pair.robot.joint_twists(postures)
    for row, q in zip(twists, postures, strict=True):
        update(pair, q)
        for j, joint in enumerate(pair.robot.joints):
            expected = np.zeros(6)
            if joint.kind != "fixed":
                # pinocchio puts the linear part first.
                column = pair.data.J[:, pair.model.joints[pair.model.getJointId(joint.name)].idx_v]
                expected = np.concatenate([column[3:], column[:3]])
            np.testing.assert_allclose(row[j], expected, rtol=0, atol=TOLERANCE)


def test_point_jacobians_between_any_two_links(pair: Pair, postures: np.ndarray) -> None:
    point, spread = np.array([0.1, -0.2, 0.05]), pair.spread()
    aligned = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    for a in some_links(pair, 3):
        for b in some_links(pair, 3)[1:]:
            jacobians = pair.robot.point_jacobians(postures, a, b, point)
            points = pair.robot.points(postures, a, b, point)
            for q, jacobian, in_a in zip(postures, jacobians, points, strict=True):
                update(pair, q)
                o_a, o_b = pair.data.oMf[pair.frame(a)], pair.data.oMf[pair.frame(b)]
                j_a = pin.getFrameJacobian(pair.model, pair.data, pair.frame(a), aligned)
                j_b = pin.getFrameJacobian(pair.model, pair.data, pair.frame(b), aligned)
                x = o_b.act(point)
                velocity_b = j_b[:3] - pin.skew(x - o_b.translation) @ j_b[3:]
                velocity_a = j_a[:3] - pin.skew(x - o_a.translation) @ j_a[3:]
                expected = o_a.rotation.T @ (velocity_b - velocity_a) @ spread
                np.testing.assert_allclose(in_a, o_a.actInv(x), rtol=0, atol=TOLERANCE)
                np.testing.assert_allclose(jacobian, expected, rtol=0, atol=TOLERANCE)


def test_gravity_torques_while_any_link_is_held(pair: Pair, postures: np.ndarray) -> None:
    spread = pair.spread()
    for held in some_links(pair, 4):
        torques = pair.robot.gravity_torques(postures, GRAVITY, held)
        for q, torque in zip(postures, torques, strict=True):
            x = update(pair, q)
            frame = pair.frame(held)
            pair.model.gravity.linear = pair.data.oMf[frame].rotation @ GRAVITY
            jacobian = pin.getFrameJacobian(pair.model, pair.data, frame, pin.ReferenceFrame.LOCAL)
            # The base flies so that the held link stands: J_base v_base + J_joints v_joints = 0.
            base = -np.linalg.solve(jacobian[:, :6], jacobian[:, 6:])
            force = -pin.computeGeneralizedGravity(pair.model, pair.data, x)
            expected = spread[6:].T @ (force[6:] + base.T @ force[:6])
            np.testing.assert_allclose(torque, expected, rtol=0, atol=TOLERANCE)


def test_gravity_moments_have_the_torque_along_the_axis(pair: Pair, postures: np.ndarray) -> None:
    for held in some_links(pair, 2):
        moments = pair.robot.gravity_moments(postures, GRAVITY, held)
        torques = pair.robot.gravity_torques(postures, GRAVITY, held)
        summed = np.zeros_like(torques)
        slides = set()
        for j, joint in enumerate(pair.robot.joints):
            if joint.position is not None:
                summed[:, joint.position] += joint.multiplier * (moments[:, j] @ joint.axis)
                if joint.kind == "prismatic":
                    slides.add(joint.position)
        turning = [k for k in range(torques.shape[1]) if k not in slides]
        np.testing.assert_allclose(summed[:, turning], torques[:, turning], rtol=0, atol=TOLERANCE)
