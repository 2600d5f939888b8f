"""The program of a robot of Dynamixel servos ends, is signalled, killed or loses its parent: the servos do not go on."""

from __future__ import annotations

import math
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from dynamixel_arm import TOML, bus, nominal  # noqa: F401
from dynamixel_bus import SimulatedBus
from mirror_posture.robots import (
    Nominal,
)

pytest.importorskip("dynamixel_sdk")

from mirror_posture.robots.servo_motion import WATCHDOG_S
from mirror_posture.robots.servo_robot import KEEP_S

pytestmark = pytest.mark.realtime


ORPHAN = """
import os, sys, time
hears, tells = os.pipe()
if os.fork():
    os.read(hears, 1)
    time.sleep(0.5)
    os._exit(0)
from mirror_posture.robots import Nominal
from mirror_posture.robots.dynamixel import DynamixelRobot
with DynamixelRobot(Nominal.load(), sys.argv[1], lambda: None) as robot:
    print("open", flush=True)
    os.write(tells, b"x")
    time.sleep(20)
"""


def test_a_robot_whose_program_lost_its_parent(bus: SimulatedBus, tmp_path: Path) -> None:
    file = tmp_path / "child.toml"
    file.write_text(TOML.format(port=bus.port))
    child = subprocess.Popen([sys.executable, "-c", ORPHAN, str(file)], stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None and child.stdout.readline() == "open\n"
    assert not bus.all_off()
    child.wait(20.0)
    end = time.monotonic() + 10.0
    while not bus.all_off() and time.monotonic() < end:
        time.sleep(0.2 * KEEP_S)
    assert bus.all_off()


CHILD = """
import sys, time
from dataclasses import replace
from mirror_posture.robots import ImagePoints, Nominal
from mirror_posture.robots.dynamixel import DynamixelRobot
from mirror_posture.robots.servo_config import load_config
nominal = Nominal.load()
robot = DynamixelRobot(nominal, load_config(sys.argv[1], nominal), lambda: None)
print("open", flush=True)
if sys.argv[2] == "wait":
    time.sleep(20)
if sys.argv[2] == "move":
    robot.command({"r_shoulder_roll": 1.5})
sys.exit(3)
"""


@pytest.mark.parametrize("how", ["ends", "killed", "SIGTERM", "SIGHUP", "SIGINT", "SIGHUP at rest"])
def test_a_process_that_ends_or_is_killed(
    bus: SimulatedBus, nominal: Nominal, tmp_path: Path, how: str
) -> None:
    """Without a context, too: the signal comes in the middle of a motion, or while the robot stands."""
    file = tmp_path / "child.toml"
    file.write_text(TOML.format(port=bus.port).replace("speed_rad_per_s = 2.0", "speed_rad_per_s = 0.5"))
    moves = {"ends": "stand", "SIGHUP at rest": "wait"}.get(how, "move")
    child = subprocess.Popen(
        [sys.executable, "-c", CHILD, str(file), moves],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert child.stdout is not None and child.stdout.readline() == "open\n"
    if how == "ends":
        assert child.wait(20.0) == 3
        assert bus.all_off()
        return
    time.sleep(0.3)
    if how == "killed":
        child.kill()
    else:
        child.send_signal(getattr(signal, how.split()[0]))
    _, said = child.communicate(timeout=20.0)
    if how == "killed":
        time.sleep(WATCHDOG_S + 0.1)
    else:
        assert bus.all_off() and "torque is off" in said
    stopped = bus.positions()[1]
    assert moves == "wait" or 1110.0 < stopped < 1024 + 1.2 * 4096 / (2 * math.pi)
    time.sleep(0.2)
    assert bus.positions()[1] == stopped
