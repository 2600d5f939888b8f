"""Feetech servos on a simulated line that speaks as their memory table says: the same promises as of any servo."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

import mirror_posture as mp
from feetech_bus import FINE_SPEED, ZERO_IS_FREE, SimulatedBus, SimulatedServo, magnitude, packet
from mirror_posture.robots import HardwareFaultError, LostRobotError, Nominal, NotSettledError
from mirror_posture.robots.interruption import Interrupted
from mirror_posture.robots.servo_config import ServoConfig, load_config
from mirror_posture.robots.servo_line import Register
from mirror_posture.robots.servo_motion import LEAD_S
from mirror_posture.robots.servo_robot import KEEP_S
from mirror_posture.robots.servo_state import State, Torque
from two_servos import JOINTS, blind

pytest.importorskip("scservo_sdk")

from mirror_posture.robots.feetech import FeetechRobot

pytestmark = pytest.mark.realtime

COUNTS = 4096 / (2.0 * math.pi)
TOML = (
    """
[bus]
port = "{port}"
speed_rad_per_s = 2.0
acceleration_rad_per_s2 = 20.0
torque_share = 0.4
"""
    + JOINTS
)


@pytest.fixture(scope="module")
def nominal() -> Nominal:
    return Nominal.load()


@pytest.fixture
def bus() -> Iterator[SimulatedBus]:
    with SimulatedBus(SimulatedServo(1, 1100.0), SimulatedServo(2, 2000.0)) as bus:
        yield bus


@pytest.fixture
def config(bus: SimulatedBus, nominal: Nominal, tmp_path: Path) -> ServoConfig:
    file = tmp_path / "servos.toml"
    file.write_text(TOML.format(port=bus.port))
    return load_config(file, nominal, "feetech")


def test_the_simulated_line_speaks_the_published_packets() -> None:
    """The protocol manual's own examples: a ping of servo 1, and reading two bytes from 56 on."""
    assert packet(1, b"\x01") == bytes.fromhex("ffff010201fb")
    assert packet(1, bytes([0x02, 56, 2])) == bytes.fromhex("ffff0104023802be")
    assert (magnitude(-5, 15), magnitude(5, 15)) == (0x8005, 5)


def test_a_sign_of_its_own_bit() -> None:
    offset = Register("offset", 31, 2, sign_bit=11)
    for value in (-2047, -1, 0, 1, 2047):
        assert offset.decode(magnitude(value, 11)) == value
        assert offset.encode(value) == magnitude(value, 11)
    with pytest.raises(ValueError, match="does not fit"):
        offset.encode(2048)


@pytest.mark.parametrize(
    ("phase", "speed"),
    [(FINE_SPEED | ZERO_IS_FREE, 1303), (ZERO_IS_FREE, 26), (FINE_SPEED, 1303), (0, 26)],
)
def test_limits_are_in_force_before_torque_and_nothing_jumps(
    nominal: Nominal, tmp_path: Path, phase: int, speed: int
) -> None:
    """The phase decides what a speed counts in: a factor of 50."""
    with SimulatedBus(SimulatedServo(1, 1100.0, phase), SimulatedServo(2, 2000.0, phase)) as bus:
        file = tmp_path / "servos.toml"
        file.write_text(TOML.format(port=bus.port))
        with FeetechRobot(nominal, file, blind) as robot:
            assert {on["id"] for on in bus.torque_on} == {1, 2}
            for on in bus.torque_on:
                assert on == {
                    "id": on["id"],
                    "mode": 0,
                    "speed": speed,
                    "time": 0,
                    "acceleration": 130,
                    "torque": 400,
                    "jump": 0,
                }
            assert bus.positions() == {1: 1100.0, 2: 2000.0}
            arrival = robot.command({"r_elbow": 0.5, "r_shoulder_roll": 1.0})
            assert arrival.measured["r_elbow"] == pytest.approx(0.5, abs=0.001)
            assert bus.positions()[2] == pytest.approx(2048 - 0.5 * COUNTS, abs=0.6)
            assert bus.positions()[1] == pytest.approx(1024 + 1.0 * COUNTS, abs=0.6)
            assert 0.8 * 2.0 * COUNTS < bus.fastest() <= 2.0 * COUNTS
            assert (
                robot.identities["r_elbow"].model == "STS3215"
                and robot.identities["r_elbow"].firmware == "3.10"
            )
        assert bus.all_off()


@pytest.mark.parametrize(
    ("address", "data", "words"),
    [
        (3, b"\x01\x02", "model number 513 is not known; known are STS3215"),
        (18, bytes([FINE_SPEED | 16]), "counts several turns"),
        (9, b"\x00\x07", "own position limits are 1792 to 4095"),
        (31, b"\x05\x08", "homing offset is -5, and the file says 0"),
    ],
)
def test_what_a_servo_is_is_known_before_it_gets_torque(
    bus: SimulatedBus, config: ServoConfig, nominal: Nominal, address: int, data: bytes, words: str
) -> None:
    bus.servos[2].table[address : address + len(data)] = data
    first, second = config.servos
    with pytest.raises(HardwareFaultError, match=rf"r_elbow \(servo 2\): .*{words}"):
        FeetechRobot(nominal, replace(config, servos=(first, replace(second, homing_offset=0))), blind)
    assert bus.all_off() and not bus.torque_on


def test_a_wheel_becomes_a_joint_again_and_stays_one(
    bus: SimulatedBus, config: ServoConfig, nominal: Nominal
) -> None:
    bus.servos[2].table[33] = 1
    with FeetechRobot(nominal, config, blind) as robot:
        robot.command({"r_elbow": 0.2})
        assert bus.servos[2].table[33] == 0 == bus.servos[2].kept[33] and bus.servos[2].table[55] == 1


def test_a_speed_below_a_coarse_step(nominal: Nominal, tmp_path: Path) -> None:
    with SimulatedBus(SimulatedServo(1, 1100.0, ZERO_IS_FREE), SimulatedServo(2, 2000.0)) as bus:
        file = tmp_path / "servos.toml"
        file.write_text(TOML.format(port=bus.port).replace("_s = 2.0", "_s = 0.05"))
        with pytest.raises(HardwareFaultError, match="below this servo's step"):
            FeetechRobot(nominal, file, blind)
        assert bus.all_off() and not bus.torque_on


@pytest.mark.parametrize("how", ["cut", "mute"])
def test_a_cut_line_ends_the_motion_without_a_watchdog(
    bus: SimulatedBus, config: ServoConfig, nominal: Nominal, how: str
) -> None:
    """Goals are never farther ahead than the lead."""
    robot = FeetechRobot(nominal, replace(config, speed_rad_per_s=0.5), blind)
    where: list[float] = []

    def cut() -> None:
        where.append(bus.positions()[1])
        if how == "cut":
            bus.cut()
        else:
            bus.mute = True

    timer = threading.Timer(0.5, cut)
    timer.start()
    with pytest.raises(LostRobotError):
        robot.command({"r_shoulder_roll": 1.5})
    timer.join()
    assert robot.standing.torque is Torque.UNKNOWN and "switch their power off" in robot.standing.why
    stopped = bus.positions()[1]
    assert bus.speeds()[1] == 0.0 and stopped - where[0] <= (LEAD_S + 0.1) * 0.5 * COUNTS
    robot.close()


def test_a_brown_out(bus: SimulatedBus, config: ServoConfig, nominal: Nominal) -> None:
    with FeetechRobot(nominal, replace(config, at_end="hold"), blind) as robot:
        bus.brown_out(2)
        time.sleep(2.0 * KEEP_S)
        assert robot.standing.state is State.STOPPED and bus.all_off()
        with pytest.raises(HardwareFaultError, match=r"goal speed is 0 instead of 1303.*dip of its power"):
            robot.command({"r_elbow": 0.5})


def test_an_overload_under_way(bus: SimulatedBus, config: ServoConfig, nominal: Nominal) -> None:
    with FeetechRobot(nominal, replace(config, speed_rad_per_s=0.5), blind) as robot:
        timer = threading.Timer(0.3, bus.fault, (1, 0x20))
        timer.start()
        with pytest.raises(HardwareFaultError, match=r"r_shoulder_roll \(servo 1\): overload"):
            robot.command({"r_shoulder_roll": 1.5, "r_elbow": 1.0})
        assert bus.all_off() and robot.standing.torque is Torque.OFF


def test_a_load_beyond_the_torque_limit_is_not_fought(
    bus: SimulatedBus, config: ServoConfig, nominal: Nominal
) -> None:
    bus.servos[1].needed_torque = 500
    with (
        FeetechRobot(nominal, config, blind) as robot,
        pytest.raises(NotSettledError, match="r_shoulder_roll"),
    ):
        robot.command({"r_shoulder_roll": 1.0})
    assert bus.all_off()


def test_two_servos_with_one_id(nominal: Nominal, tmp_path: Path) -> None:
    servos = (SimulatedServo(1, 1100.0), SimulatedServo(2, 2000.0), SimulatedServo(2, 2900.0))
    with SimulatedBus(*servos) as bus:
        file = tmp_path / "servos.toml"
        file.write_text(TOML.format(port=bus.port))
        with pytest.raises(LostRobotError, match="no two servos have the same id"):
            FeetechRobot(nominal, file, blind)
        assert bus.all_off()


def test_answers_that_are_lost_garbled_or_noisy(
    bus: SimulatedBus, config: ServoConfig, nominal: Nominal
) -> None:
    with FeetechRobot(nominal, config, blind) as robot:
        bus.drop = 2
        robot.command({"r_elbow": 0.3})
        bus.garble = 2
        assert robot.command({"r_elbow": 0.2}).measured["r_elbow"] == pytest.approx(0.2, abs=0.001)
        bus.noise = 0.2
        assert robot.command({"r_elbow": 0.3}).measured["r_elbow"] == pytest.approx(0.3, abs=0.001)


def test_held_at_the_end_where_the_file_says_so(
    bus: SimulatedBus, config: ServoConfig, nominal: Nominal
) -> None:
    with FeetechRobot(nominal, replace(config, at_end="hold", speed_rad_per_s=0.5), blind) as robot:
        timer = threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGHUP))
        timer.start()
        with pytest.raises(Interrupted, match="SIGHUP"):
            robot.command({"r_shoulder_roll": 1.5})
        assert robot.standing.torque is Torque.HELD and all(bus.torques())
        assert bus.comes_to_rest()
        assert bus.positions()[1] < 1024 + 1.0 * COUNTS


CHILD = """
import sys
from mirror_posture.robots import Nominal
from mirror_posture.robots.feetech import FeetechRobot
robot = FeetechRobot(Nominal.load(), sys.argv[1], lambda: None)
print("open", flush=True)
robot.command({"r_shoulder_roll": 1.5})
"""


def test_a_process_that_is_killed_in_a_motion(bus: SimulatedBus, tmp_path: Path) -> None:
    file = tmp_path / "servos.toml"
    file.write_text(TOML.format(port=bus.port).replace("_s = 2.0", "_s = 0.5"))
    child = subprocess.Popen([sys.executable, "-c", CHILD, str(file)], stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None and child.stdout.readline() == "open\n"
    time.sleep(0.5)
    here = bus.positions()[1]
    child.kill()
    child.wait(20.0)
    time.sleep(LEAD_S + 0.3)
    stopped = bus.positions()[1]
    assert here > 1105.0 and stopped - here <= (LEAD_S + 0.2) * 0.5 * COUNTS
    time.sleep(0.2)
    assert bus.positions()[1] == stopped


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("torque_share = 0.4", "current_a = 0.3", "current_a is no key"),
        ("torque_share = 0.4", "", "torque_share is missing"),
        ("torque_share = 0.4", "torque_share = 1.4", "share from 0 to 1"),
        ("id = 2", "id = 2\nhoming_offset = 1.5", "needed a whole number"),
        ("_s2 = 20.0", "_s2 = 0.1", "0 would mean no limit"),
    ],
)
def test_a_file_that_cannot_be_meant_is_refused(
    nominal: Nominal, tmp_path: Path, old: str, new: str, words: str
) -> None:
    file = tmp_path / "servos.toml"
    file.write_text(TOML.format(port="/dev/ttyACM0").replace(old, new, 1))
    with pytest.raises(mp.MirrorPostureError, match=words):
        load_config(file, nominal, "feetech")
