"""docs/robots.md: everything that it prints is run."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from mirror_lab.robots import HiddenEffect, TwinOptions, TwinRobot
from mirror_posture.correct import PAPER_VIEWS, CorrectOptions, StopOptions, correct
from mirror_posture.render import PictureOptions
from mirror_posture.robots import Nominal, TurnsView
from mirror_posture.viewpoint import View

PAGE = Path(__file__).resolve().parents[2] / "docs" / "robots.md"


def printed(language: str, containing: str) -> str:
    blocks = re.findall(rf"```{language}\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    (block,) = [block for block in blocks if containing in block]
    return str(block)


def test_the_twin_of_the_page_converges(capsys: pytest.CaptureFixture[str]) -> None:
    exec(printed("python", "TwinRobot(hidden"), {})
    assert capsys.readouterr().out.startswith("converged")


def test_the_page_s_mujoco_runs() -> None:
    pytest.importorskip("mujoco")
    names: dict = {}
    exec(printed("python", "MujocoRobot("), names)
    assert names["arrival"].measured["r_shoulder_roll"] == pytest.approx(1.2, abs=0.002)


def test_the_page_s_robot_by_hand_runs(capsys: pytest.CaptureFixture[str]) -> None:
    exec(printed("python", "ByHandRobot("), {})
    assert "+17.189°  +0.30000 rad" in capsys.readouterr().out


def test_the_page_s_servo_files_are_read(tmp_path: Path) -> None:
    from mirror_posture.robots.servo_config import load_config

    (tmp_path / "servos.toml").write_text(printed("toml", "[joints.r_elbow]"))
    config = load_config(tmp_path / "servos.toml", Nominal.load())
    assert config.servos[0].joint == "r_elbow" and config.rest == {"r_elbow": 0.0}
    # What is commented out can be said, too.
    said = re.sub(r"(?m)^# (?=\w+ = )", "", printed("toml", "[joints.r_elbow]"))
    (tmp_path / "servos.toml").write_text(said)
    config = load_config(tmp_path / "servos.toml", Nominal.load())
    assert config.at_end == "hold" and not config.end_with_parent and config.servos[0].reversed
    feetech = printed("toml", "torque_share").replace("shoulder_pan", "r_elbow")
    (tmp_path / "servos.toml").write_text(feetech)
    config = load_config(tmp_path / "servos.toml", Nominal.load(), "feetech")
    assert config.servos[0].homing_offset == -85 and config.torque_share == 0.4


class Client:
    """A maker's client, with a twin for a robot."""

    def __init__(self) -> None:
        hidden = [HiddenEffect("joint_offset", "joint:r_elbow", {"offset_rad": 0.06})]
        self.robot = TwinRobot(
            hidden, TwinOptions(camera=PictureOptions(samples=1, edge_samples=2, ghosts=False))
        )
        self.off = False

    def move_to(self, positions: dict[str, float], speed: float) -> None:
        self.robot.command(positions)

    def read_joints(self) -> dict[str, float]:
        return {}

    def take_picture(self) -> np.ndarray | None:
        return self.robot.look().picture_bgr

    def turn_stand(self, yaw_rad: float, pitch_rad: float) -> None:
        self.robot.turn(View(yaw_rad, pitch_rad))

    def torque_off(self) -> None:
        self.off = True


def test_the_page_s_new_robot_is_corrected() -> None:
    names: dict = {}
    exec(printed("python", "class MyRobot"), names)
    client = Client()
    options = CorrectOptions(views=PAPER_VIEWS, markers=("r_hand",), stop=StopOptions(looks=2))
    with names["MyRobot"](client, Nominal.load()) as robot:
        assert isinstance(robot, TurnsView)
        outcome = correct(
            robot, {"r_shoulder_pitch": -0.26, "r_shoulder_roll": 1.2, "r_elbow": 0.26}, options
        )
    assert client.off
    first, second = (look.markers[0].distance_m for look in outcome.looks)
    assert first is not None and second is not None
    assert first > 3e-3 and second < 0.4 * first, "from pictures of a robot that knew nothing of this package"
