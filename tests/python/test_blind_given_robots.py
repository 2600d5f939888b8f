"""Robots that the user gives: an MJCF becomes the URDF that MuJoCo itself would move in the same way."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

pytest.importorskip("mujoco", reason="blind sessions need MuJoCo")

from mirror_lab.blind import BlindError
from mirror_lab.blind.given_robots import from_file
from mirror_lab.blind.identify import judge
from mirror_lab.blind.kinematics import Change, chain, moments
from mirror_lab.blind.simulate import Options, simulate
from mirror_lab.blind.truth import Commands

MJCF = """<mujoco><compiler angle="radian"/><worldbody><body name="base" pos="0 0 1"><freejoint/>
<geom type="box" size=".1 .1 .2" mass="5"/>
<camera name="camera_optical" pos=".05 0 .3" xyaxes="0 -1 0 0 0 1"/>
<site name="chest_board" pos=".1 0 0" xyaxes="0 1 0 0 0 1"/>
<body name="upper" pos="0 -.2 .15" euler=".1 0 -.2">
  <joint name="lift" axis="0 1 0" pos="0 .02 .01" range="-1 .6" limited="true"/>
  <joint name="roll" axis="1 0 .1" pos="0 .01 0" range="-.8 .8" limited="true"/>
  <geom type="capsule" fromto="0 0 0 .05 0 -.2" size=".03" mass="1.2"/>
  <body name="fore" pos=".05 0 -.22" euler="0 .2 0">
    <joint name="elbow" axis="0 1 0" range="-1.4 .1" limited="true"/>
    <geom type="capsule" fromto="0 0 0 .03 0 -.2" size=".02" mass=".7"/>
    <site name="hand_marker" pos=".05 0 -.22"/><site name="wrist_marker" pos=".04 .02 -.12"/>
  </body><site name="upper_marker" pos=".06 0 -.1"/>
</body></body></worldbody></mujoco>"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "one_arm.xml"
    path.write_text(MJCF, encoding="utf-8")
    return path


def test_an_mjcf_moves_and_weighs_as_mujoco_has_it(file: Path) -> None:
    rng = np.random.default_rng(0)
    robot = from_file(file, rng)
    assert robot.commanded == ["elbow", "lift", "roll"] and robot.root == "base"
    q = rng.uniform(-0.5, 0.5, (6, 3))
    at = chain(robot, Commands(robot.commanded, q, np.arange(6.0)), Change())
    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    for p, row in enumerate(q):
        data.qpos[:] = 0
        data.qpos[3] = 1  # the root's quaternion
        for name, angle in zip(robot.commanded, row, strict=True):
            data.qpos[model.joint(name).qposadr[0]] = angle
        mujoco.mj_forward(model, data)
        for marker in robot.markers:
            got = at.position_m[robot.index[f"{marker}_marker"], p]
            np.testing.assert_allclose(got, data.site(f"{marker}_marker").xpos, atol=1e-9)
        optical = at.rotation[robot.index["camera_optical"], p]
        np.testing.assert_allclose(
            optical[:, 2], -data.cam("camera_optical").xmat.reshape(3, 3)[:, 2], atol=1e-9
        )
        for name in robot.commanded:
            body = robot.body_of_joint(name)
            torque = moments(robot, at, np.array([0, 0, -9.81]), body)[p] @ robot.bodies[body].axis
            assert torque == pytest.approx(-data.qfrc_bias[model.joint(name).dofadr[0]], abs=1e-6)


def test_a_session_is_made_with_it(file: Path) -> None:
    options = Options(frames=(60, 61), simple_laws=True)
    case = simulate("case", str(file), ["joint_offset"], np.random.default_rng(1), options)
    assert case.answer["robot"] == "one_arm"
    assert judge(case)["detectable"]


def test_what_is_no_robot_is_told(tmp_path: Path, file: Path) -> None:
    with pytest.raises(BlindError, match="no such file"):
        from_file(tmp_path / "none.urdf", np.random.default_rng(0))
    other = tmp_path / "page.xml"
    other.write_text("<html/>", encoding="utf-8")
    with pytest.raises(BlindError, match=r"<html>.*<robot>.*<mujoco>"):
        from_file(other, np.random.default_rng(0))
    bare = tmp_path / "bare.xml"
    bare.write_text(MJCF.replace("chest_board", "chest"), encoding="utf-8")
    with pytest.raises(BlindError, match="_board"):
        from_file(bare, np.random.default_rng(0))
