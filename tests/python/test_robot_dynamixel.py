"""Dynamixel servos on a simulated bus that speaks the real protocol: limits first, torque off on any failure."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mirror_posture as mp
from dynamixel_bus import SimulatedBus, SimulatedServo, crc16, packet, stuffed, unstuffed
from mirror_lab.robots import HiddenBody, HiddenEffect
from mirror_lab.robots.pixels import MirrorInRoot, exact_points, lens_of
from mirror_lab.robots.twin import view_normal
from mirror_posture.robots import (
    HardwareFaultError,
    ImagePoints,
    JointLimits,
    LostRobotError,
    NoLookError,
    Nominal,
    NotSettledError,
    UnsafeCommandError,
)
from mirror_posture.viewpoint import View

pytest.importorskip("dynamixel_sdk")

from mirror_posture.robots.dynamixel import WATCHDOG_S, DynamixelRobot
from mirror_posture.robots.dynamixel_bus import DynamixelBus, Register
from mirror_posture.robots.dynamixel_config import (
    SPEED_UNIT_RAD_PER_S,
    DynamixelConfig,
    Servo,
    load_config,
)

pytestmark = pytest.mark.realtime

TOML = """
[bus]
port = "{port}"
baudrate = 1000000
speed_rad_per_s = 2.0
acceleration_rad_per_s2 = 20.0
current_a = 0.3

[joints.r_shoulder_roll]
id = 1
zero_counts = 1024
direction = 1
upper_rad = 1.6

[joints.r_elbow]
id = 2
zero_counts = 2048
direction = -1
"""


@pytest.fixture(scope="module")
def nominal() -> Nominal:
    return Nominal.load()


@pytest.fixture
def bus() -> Iterator[SimulatedBus]:
    with SimulatedBus(SimulatedServo(1, 1100.0), SimulatedServo(2, 2000.0)) as bus:
        yield bus


@pytest.fixture
def config(bus: SimulatedBus, nominal: Nominal, tmp_path: Path) -> DynamixelConfig:
    file = tmp_path / "servos.toml"
    file.write_text(TOML.format(port=bus.port))
    return load_config(file, nominal)


def blind() -> ImagePoints:
    return ImagePoints(np.zeros((30, 2)), np.zeros(30, bool), np.zeros((6, 2)), np.zeros(6, bool))


def soon(work: Callable[[], object], after_s: float) -> threading.Timer:
    timer = threading.Timer(after_s, work)
    timer.start()
    return timer


# The protocol, against the e-Manual's own packets.


def test_the_simulated_bus_speaks_protocol_2() -> None:
    assert packet(1, b"\x01") == bytes.fromhex("FFFFFD00 01 0300 01 194E".replace(" ", ""))
    read = bytes([0x02, 0x84, 0x00, 0x04, 0x00])
    assert packet(1, read) == bytes.fromhex("FFFFFD00010700028400040 01D15".replace(" ", ""))
    assert crc16(b"") == 0
    assert stuffed(b"\x02\xff\xff\xfd\x01") == b"\x02\xff\xff\xfd\xfd\x01"
    assert unstuffed(stuffed(b"\xff\xff\xfd\xfd")) == b"\xff\xff\xfd\xfd"


def test_stuffed_answers_are_read_right(bus: SimulatedBus) -> None:
    bus.servos[1].set(224, 4, 0x01FDFFFF)
    line = DynamixelBus(bus.port, 1_000_000)
    assert line.read(1, Register("test", 224, 4)) == 0x01FDFFFF
    line.close()


# Opening.


def test_limits_are_in_force_before_torque_and_nothing_jumps(
    bus: SimulatedBus, config: DynamixelConfig, nominal: Nominal
) -> None:
    with DynamixelRobot(nominal, config, blind) as robot:
        assert robot.torque_is_on() and not bus.all_off()
        assert [on["id"] for on in bus.torque_on] == [1, 2]
        for on in bus.torque_on:
            assert on["mode"] == 5 and on["current"] == round(0.3 / 0.00269)
            assert on["speed"] == round(2.0 / SPEED_UNIT_RAD_PER_S) > 0 and on["acceleration"] > 0
            assert on["jump"] == 0
        assert bus.positions() == {1: 1100.0, 2: 2000.0}
        assert robot.commanded["r_elbow"] == pytest.approx(48 * 2 * math.pi / 4096)
    assert bus.all_off()


def test_without_current_control_the_pwm_is_limited(
    bus: SimulatedBus, config: DynamixelConfig, nominal: Nominal
) -> None:
    with DynamixelRobot(nominal, replace(config, current_a=None, pwm_share=0.4), blind):
        assert {(on["mode"], on["pwm"]) for on in bus.torque_on} == {(3, 354)}


def test_a_missing_servo_is_named_and_the_others_are_left_without_torque(
    bus: SimulatedBus, config: DynamixelConfig, nominal: Nominal
) -> None:
    bus.servos[1].table[64] = 1
    del bus.servos[2]
    with pytest.raises(LostRobotError, match="servo 2, ping"):
        DynamixelRobot(nominal, config, blind)
    assert bus.all_off() and not bus.torque_on


def test_a_current_beyond_the_servos_own_limit_is_refused_before_torque(
    bus: SimulatedBus, config: DynamixelConfig, nominal: Nominal
) -> None:
    bus.servos[2].set(38, 2, 50)
    with pytest.raises(HardwareFaultError, match="servo 2 refuses goal current"):
        DynamixelRobot(nominal, config, blind)
    assert bus.all_off() and not bus.torque_on


def test_no_line_at_all(config: DynamixelConfig, nominal: Nominal) -> None:
    with pytest.raises(LostRobotError, match="cannot be opened"):
        DynamixelRobot(nominal, replace(config, port="/dev/no-such-line"), blind)


# Moving.


def test_zero_and_direction_in_and_out(bus: SimulatedBus, config: DynamixelConfig, nominal: Nominal) -> None:
    with DynamixelRobot(nominal, config, blind) as robot:
        arrival = robot.command({"r_elbow": 0.5, "r_shoulder_roll": 1.0})
        assert bus.positions()[2] == pytest.approx(2048 - 0.5 * 4096 / (2 * math.pi), abs=0.6)
        assert bus.positions()[1] == pytest.approx(1024 + 1.0 * 4096 / (2 * math.pi), abs=0.6)
        assert arrival.measured["r_elbow"] == pytest.approx(0.5, abs=0.001)
        assert robot.look().measured["r_shoulder_roll"] == pytest.approx(1.0, abs=0.001)
        limit = 2.0 * 4096 / (2 * math.pi)
        assert 0.9 * limit < max(servo.fastest for servo in bus.servos.values()) < 1.02 * limit
        assert bus.servos[1].table[98] == 0, "the watchdog sleeps while the robot stands"


def test_nothing_is_sent_for_a_command_beyond_the_limits(
    bus: SimulatedBus, config: DynamixelConfig, nominal: Nominal
) -> None:
    with DynamixelRobot(nominal, config, blind) as robot:
        before = len(bus.instructions)
        for joint, position in (
            ("r_shoulder_roll", 1.7),
            ("r_elbow", 2.2),
            ("l_elbow", 0.1),
            ("r_elbow", math.nan),
        ):
            with pytest.raises(UnsafeCommandError):
                robot.command({joint: position})
        assert len(bus.instructions) == before
        assert robot.torque_is_on(), "a refused command is no failure"


def test_lost_and_garbled_answers_are_asked_for_again(
    bus: SimulatedBus, config: DynamixelConfig, nominal: Nominal
) -> None:
    with DynamixelRobot(nominal, config, blind) as robot:
        bus.drop = 2
        robot.command({"r_elbow": 0.3})
        bus.garble = 2
        assert robot.command({"r_elbow": 0.2}).measured["r_elbow"] == pytest.approx(0.2, abs=0.001)


# Failures.


def test_a_joint_that_does_not_move_is_named_and_torque_goes_off(
    bus: SimulatedBus, config: DynamixelConfig, nominal: Nominal
) -> None:
    with DynamixelRobot(nominal, config, blind) as robot:
        bus.servos[2].jammed = True
        with pytest.raises(NotSettledError, match=r"r_elbow at 0\.0736 rad instead of 0\.5000") as caught:
            robot.command({"r_elbow": 0.5, "r_shoulder_roll": 0.5})
        assert caught.value.joints == ("r_elbow",)
        assert bus.all_off() and not robot.torque_is_on()
        with pytest.raises(HardwareFaultError, match=r"torque is off .*r_elbow"):
            robot.command({"r_shoulder_roll": 0.6})


def test_a_load_beyond_the_torque_limit_is_not_fought(
    bus: SimulatedBus, config: DynamixelConfig, nominal: Nominal
) -> None:
    bus.servos[1].needed_current = 500
    with (
        DynamixelRobot(nominal, config, blind) as robot,
        pytest.raises(NotSettledError, match="r_shoulder_roll"),
    ):
        robot.command({"r_shoulder_roll": 1.0})
    assert bus.all_off()


def test_an_overload_under_way_takes_all_torque_off(
    bus: SimulatedBus, config: DynamixelConfig, nominal: Nominal
) -> None:
    with DynamixelRobot(nominal, config, blind) as robot:
        timer = soon(lambda: bus.fault(1, 0x20), 0.2)
        with pytest.raises(HardwareFaultError, match=r"r_shoulder_roll \(servo 1\): overload"):
            robot.command({"r_shoulder_roll": 1.5, "r_elbow": 1.5})
        timer.join()
        assert bus.all_off()
    assert bus.positions()[2] > 2048 - 1.4 * 4096 / (2 * math.pi), "the other joint stopped under way"


@pytest.mark.parametrize("how", ["cut", "mute"])
def test_a_line_cut_in_the_middle_ends_the_motion(
    bus: SimulatedBus, config: DynamixelConfig, nominal: Nominal, how: str
) -> None:
    slow = replace(config, speed_rad_per_s=0.5)

    def cut() -> None:
        if how == "cut":
            bus.cut()
        else:
            bus.mute = True

    robot = DynamixelRobot(nominal, slow, blind)
    timer = soon(cut, 0.3)
    with pytest.raises(LostRobotError) as caught:
        robot.command({"r_shoulder_roll": 1.5})
    timer.join()
    assert any(
        "torque could not be taken off" in note
        for note in getattr(caught.value, "__notes__", ["torque could not be taken off"])
    )
    time.sleep(WATCHDOG_S + 0.1)
    stopped = bus.positions()[1]
    time.sleep(0.2)
    assert bus.positions()[1] == stopped
    assert stopped < 1024 + 1.2 * 4096 / (2 * math.pi), "long before its goal"
    with pytest.raises(HardwareFaultError, match="torque"):
        robot.command({"r_shoulder_roll": 0.2})
    robot.rest()
    robot.close()


def test_after_a_cut_the_robot_opens_again(
    bus: SimulatedBus, config: DynamixelConfig, nominal: Nominal
) -> None:
    robot = DynamixelRobot(nominal, replace(config, speed_rad_per_s=0.5), blind)
    timer = soon(lambda: setattr(bus, "mute", True), 0.2)
    with pytest.raises(LostRobotError):
        robot.command({"r_shoulder_roll": 1.5})
    timer.join()
    robot.close()
    time.sleep(WATCHDOG_S)
    bus.mute = False
    assert bus.servos[1].table[98] == 255, "the watchdog has bitten"
    with DynamixelRobot(nominal, config, blind) as again:
        assert bus.torque_on[-1]["jump"] == 0
        again.command({"r_shoulder_roll": 0.3})


def test_ctrl_c_takes_torque_off(bus: SimulatedBus, config: DynamixelConfig, nominal: Nominal) -> None:
    slow = replace(config, speed_rad_per_s=0.5)
    with DynamixelRobot(nominal, slow, blind) as robot:
        timer = soon(lambda: os.kill(os.getpid(), signal.SIGINT), 0.3)
        with pytest.raises(KeyboardInterrupt):
            robot.command({"r_shoulder_roll": 1.5})
        timer.join()
        assert bus.all_off()
        assert bus.positions()[1] < 1024 + 1.0 * 4096 / (2 * math.pi)


def test_a_failing_camera_ends_in_rest(bus: SimulatedBus, config: DynamixelConfig, nominal: Nominal) -> None:
    def dark() -> ImagePoints:
        raise NoLookError("no picture")

    resting = replace(config, rest={"r_shoulder_roll": 0.1})
    with pytest.raises(NoLookError), DynamixelRobot(nominal, resting, dark) as robot:
        robot.command({"r_shoulder_roll": 0.6})
        robot.look()
    assert bus.all_off()
    assert bus.positions()[1] == pytest.approx(1024 + 0.1 * 4096 / (2 * math.pi), abs=1.0)


CHILD = """
import sys, time
from dataclasses import replace
from mirror_posture.robots import ImagePoints, Nominal
from mirror_posture.robots.dynamixel import DynamixelRobot
from mirror_posture.robots.dynamixel_config import load_config
nominal = Nominal.load()
robot = DynamixelRobot(nominal, load_config(sys.argv[1], nominal), lambda: None)
print("open", flush=True)
if sys.argv[2] == "move":
    robot.command({"r_shoulder_roll": 1.5})
sys.exit(3)
"""


@pytest.mark.parametrize("how", ["ends", "killed"])
def test_a_process_that_ends_or_is_killed(
    bus: SimulatedBus, nominal: Nominal, tmp_path: Path, how: str
) -> None:
    file = tmp_path / "child.toml"
    file.write_text(TOML.format(port=bus.port).replace("speed_rad_per_s = 2.0", "speed_rad_per_s = 0.5"))
    moves = "move" if how == "killed" else "stand"
    child = subprocess.Popen(
        [sys.executable, "-c", CHILD, str(file), moves], stdout=subprocess.PIPE, text=True
    )
    assert child.stdout is not None and child.stdout.readline() == "open\n"
    if how == "ends":
        assert child.wait(20.0) == 3
        assert bus.all_off()
        return
    time.sleep(0.3)
    child.kill()
    child.wait(20.0)
    time.sleep(WATCHDOG_S + 0.1)
    stopped = bus.positions()[1]
    assert 1110.0 < stopped < 1024 + 1.2 * 4096 / (2 * math.pi)
    time.sleep(0.2)
    assert bus.positions()[1] == stopped


# With a body behind it.


def test_it_sees_itself_through_its_servos(
    bus: SimulatedBus, config: DynamixelConfig, nominal: Nominal
) -> None:
    """Servos with a hidden body on them, before a mirror: commands go in, image points come out."""
    hidden = [HiddenEffect("joint_offset", "joint:r_elbow", {"offset_rad": 0.05})]
    body = HiddenBody(nominal.robot_file.read_text(), "base_link", nominal.metadata.gravity_m_per_s2, hidden)
    lens, rng, views = lens_of(nominal), np.random.default_rng(3), iter([View(), View(0.26)])
    board = body.link_poses()["chest_board"][:3, 3]

    def eye() -> ImagePoints:
        body.move({s.joint: s.position_rad(round(bus.positions()[s.servo_id])) for s in config.servos})
        view = next(views)
        normal = view_normal(view)
        mirror = MirrorInRoot(normal, float(normal @ board) + view.distance_m, 0.003, 1.52)
        return exact_points(nominal, lens, body.link_poses(), mirror, 0.05, rng)

    with DynamixelRobot(nominal, config, eye) as robot:
        robot.command({"r_shoulder_roll": 1.1, "r_elbow": 0.4})
        looks = [robot.look(), robot.look()]
    found = mp.measure(nominal.session(looks, [0, 0])).markers
    truth = body.link_poses()["r_hand_marker"][:3, 3]
    hand = int(np.flatnonzero(found.marker == 0)[0])
    assert found.measured[hand]
    assert np.linalg.norm(found.point_in_root_m[hand] - truth) < 1e-3
    assert np.linalg.norm(found.model_in_root_m[hand] - truth) > 2.5e-3


# The file.


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("current_a = 0.3", "curent_a = 0.3", "curent_a: is no key"),
        ("current_a = 0.3", "", "exactly one torque limit"),
        ("current_a = 0.3", "pwm_share = 2.0", "share from 0 to 1"),
        ("speed_rad_per_s = 2.0", "speed_rad_per_s = 0.005", "0 would mean no limit"),
        ("speed_rad_per_s = 2.0", "speed_rad_per_s = -1", "above 0"),
        ("id = 2", "id = 1", "each only once"),
        ("id = 2", "", "joints.r_elbow.id: got None"),
        ("direction = -1", "direction = 2", "needed 1 or -1"),
        ("zero_counts = 2048", "zero_counts = 20", "0 to 4095"),
        ("[joints.r_elbow]", "[joints.elbow]", "no such joint"),
        ("upper_rad = 1.6", "upper_rad = -0.5", "nothing is left"),
        ("[joints", "[rest]\nr_elbow = 3.0\n[joints", "rest.r_elbow: got 3.0"),
        ("[bus]", "[bus", "cannot be read"),
    ],
)
def test_a_file_that_cannot_be_meant_is_refused(
    nominal: Nominal, tmp_path: Path, old: str, new: str, words: str
) -> None:
    file = tmp_path / "servos.toml"
    file.write_text(TOML.format(port="/dev/ttyUSB0").replace(old, new, 1))
    with pytest.raises(mp.MirrorPostureError, match=words):
        load_config(file, nominal)


def test_counts_and_radians_are_each_others_inverse() -> None:
    for direction in (1, -1):
        servo = Servo("j", 1, 1500, direction, JointLimits(-1.0, 1.0))
        for position in np.linspace(-1.0, 1.0, 101):
            assert servo.position_rad(servo.counts(position)) == pytest.approx(
                position, abs=math.pi / 4096 + 1e-12
            )
