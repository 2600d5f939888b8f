"""A corrected LeRobot calibration, read and used by LeRobot's own code for motors, where that is installed.

Without PyTorch: pip install --no-deps lerobot draccus deepdiff orderly-set cachebox mergedeep toml typing-inspect mypy-extensions pyyaml-include tqdm pyserial
"""

from __future__ import annotations

import importlib.util
import math
import sys
from pathlib import Path
from unittest.mock import MagicMock

import pytest

from mirror_posture.diagnosis.applied.lerobot import patch_lerobot
from test_apply_patch import LEROBOT, changed_lines, found

draccus = pytest.importorskip("draccus")
pytest.importorskip("lerobot")
# The module of motors imports one of small helpers, which imports these for others.
HEAVY = ("torch", "accelerate", "datasets", "datasets.utils", "datasets.utils.logging")
absent = [] if importlib.util.find_spec("torch") else [name for name in HEAVY if name not in sys.modules]
sys.modules.update((name, MagicMock()) for name in absent)
motors = pytest.importorskip("lerobot.motors")
feetech = pytest.importorskip("lerobot.motors.feetech")
for name in absent:
    del sys.modules[name]


def read(file: Path) -> dict:
    """As `lerobot.robots.Robot._load_calibration` reads it."""
    with file.open() as stream, draccus.config_type("json"):
        return draccus.load(dict[str, motors.MotorCalibration], stream)


def reported_deg(calibration: dict, actual: int) -> float:
    """What LeRobot's bus says of a servo that stands at a tick: Feetech's present position, normalised by LeRobot."""
    norm = motors.MotorNormMode.DEGREES
    bus = feetech.FeetechMotorsBus(
        "nowhere",
        {name: motors.Motor(entry.id, "sts3215", norm) for name, entry in calibration.items()},
        calibration,
    )
    pan = calibration["shoulder_pan"]
    return bus._normalize({pan.id: actual - pan.homing_offset})[pan.id]


def test_lerobot_reads_it_back_and_reports_as_the_joint_stands(tmp_path: Path) -> None:
    own, out = tmp_path / "arm.json", tmp_path / "better.json"
    own.write_text(LEROBOT)
    patch_lerobot(own, found(("joint_offset", "joint:shoulder_pan", {"offset_rad": 0.05})).causes, out)
    assert len(changed_lines(LEROBOT, out.read_text())) == 1
    before, after = read(own), read(out)
    assert before["gripper"] == after["gripper"] and before["shoulder_pan"] != after["shoulder_pan"]
    grown = reported_deg(after, 1000) - reported_deg(before, 1000)
    assert grown == pytest.approx(math.degrees(0.05), abs=0.05)
    # LeRobot writes it as it stands, to the letter.
    with (tmp_path / "theirs.json").open("w") as stream, draccus.config_type("json"):
        draccus.dump(after, stream, indent=4)
    assert (tmp_path / "theirs.json").read_text() == out.read_text()
