"""Which joints a servo of servos.toml can be: those that turn by themselves."""

from __future__ import annotations

from pathlib import Path

import pytest

from mirror_posture import MirrorPostureError
from mirror_posture.robots import Nominal
from mirror_posture.robots.nominal import EMBEDDED_FOLDER
from mirror_posture.robots.servo_config import load_config

TOML = """
[bus]
port = "/dev/ttyUSB0"
torque_share = 0.3

[joints.{joint}]
id = 2
zero_counts = 2048
direction = 1
lower_rad = -0.1
upper_rad = 0.1
"""


def changed(tmp_path: Path, old: str, new: str) -> Nominal:
    """The embedded robot, whose elbow is another joint."""
    for name in ("session.toml", "camera.yaml"):
        (tmp_path / name).write_bytes((EMBEDDED_FOLDER / name).read_bytes())
    text = (EMBEDDED_FOLDER / "robot.urdf").read_text()
    begin = text.index('<joint name="r_elbow"')
    end = text.index("</joint>", begin)
    joint = text[begin:end]
    assert old in joint
    (tmp_path / "robot.urdf").write_text(text[:begin] + joint.replace(old, new) + text[end:])
    return Nominal.load(tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('type="revolute"', 'type="prismatic"', r"joints\.r_elbow: slides, .* leave it out .*--robot-class"),
        (
            'type="revolute"',
            'type="fixed"',
            r"joints\.r_elbow: is a fixed joint in the URDF; needed one of .*r_shoulder_roll",
        ),
        (
            "<limit",
            '<mimic joint="l_elbow"/><limit',
            "follows l_elbow by <mimic> in the URDF and has no command of its own",
        ),
    ],
)
def test_a_joint_that_no_servo_turns_is_refused(tmp_path: Path, old: str, new: str, said: str) -> None:
    """Before, 0.1 m of a joint that slides were 0.1 rad, 65 counts; of a mimic joint "the URDF has no such joint"."""
    file = tmp_path / "servos.toml"
    file.write_text(TOML.format(joint="r_elbow"))
    with pytest.raises(MirrorPostureError, match=said):
        load_config(file, changed(tmp_path, old, new), "feetech")


def test_one_that_turns_is_taken(tmp_path: Path) -> None:
    file = tmp_path / "servos.toml"
    file.write_text(TOML.format(joint="r_elbow"))
    assert [servo.joint for servo in load_config(file, Nominal.load(), "feetech").servos] == ["r_elbow"]
