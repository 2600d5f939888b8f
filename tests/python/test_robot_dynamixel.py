"""Dynamixel servos on a simulated bus that speaks the real protocol: their file, opening, limits first, moving."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mirror_posture as mp
from dynamixel_arm import TOML, blind, bus, config, nominal  # noqa: F401
from dynamixel_bus import SimulatedBus, SimulatedServo, crc16, packet, stuffed, unstuffed
from mirror_lab.robots import HiddenBody, HiddenEffect
from mirror_lab.robots.pixels import MirrorInRoot, exact_points, lens_of
from mirror_posture.robots import (
    HardwareFaultError,
    ImagePoints,
    JointLimits,
    LostRobotError,
    Nominal,
    UnsafeCommandError,
)
from mirror_posture.viewpoint import View

pytest.importorskip("dynamixel_sdk")

from mirror_posture.robots.dynamixel import DynamixelDrive, DynamixelRobot
from mirror_posture.robots.servo_config import (
    SPEED_UNIT_RAD_PER_S,
    Servo,
    ServoConfig,
    load_config,
)
from mirror_posture.robots.servo_line import Register
from mirror_posture.robots.servo_state import Torque

pytestmark = pytest.mark.realtime


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
    servos = (Servo("r_elbow", 1, 2048, 1, JointLimits(-1.0, 1.0)),)
    line = DynamixelDrive(ServoConfig(bus.port, servos)).line
    assert line.read(1, Register("test", 224, 4)) == 0x01FDFFFF
    line.close()


# Opening.


def test_limits_are_in_force_before_torque_and_nothing_jumps(
    bus: SimulatedBus, config: ServoConfig, nominal: Nominal
) -> None:
    with DynamixelRobot(nominal, config, blind) as robot:
        assert robot.standing.torque is Torque.HELD and not bus.all_off()
        assert [on["id"] for on in bus.torque_on] == [1, 2]
        for on in bus.torque_on:
            assert on["mode"] == 5 and on["current"] == math.floor(0.3 / 0.00269)
            assert on["speed"] == math.floor(2.0 / SPEED_UNIT_RAD_PER_S) > 0 and on["acceleration"] > 0
            assert on["jump"] == 0
        assert bus.positions() == {1: 1100.0, 2: 2000.0}
        assert robot.commanded["r_elbow"] == pytest.approx(48 * 2 * math.pi / 4096)
    assert bus.all_off()


def test_without_current_control_the_pwm_is_limited(
    bus: SimulatedBus, config: ServoConfig, nominal: Nominal
) -> None:
    with DynamixelRobot(nominal, replace(config, current_a=None, pwm_share=0.4), blind):
        assert {(on["mode"], on["pwm"]) for on in bus.torque_on} == {(3, 354)}


def test_a_missing_servo_is_named_and_the_others_are_left_without_torque(
    bus: SimulatedBus, config: ServoConfig, nominal: Nominal
) -> None:
    bus.servos[1].table[64] = 1
    bus.remove(2)
    with pytest.raises(LostRobotError, match="servo 2, ping"):
        DynamixelRobot(nominal, config, blind)
    assert bus.all_off() and not bus.torque_on


def test_a_current_beyond_the_servos_own_limit_is_refused_before_torque(
    bus: SimulatedBus, config: ServoConfig, nominal: Nominal
) -> None:
    bus.servos[2].set(38, 2, 50)
    with pytest.raises(HardwareFaultError, match="servo 2 refuses goal current"):
        DynamixelRobot(nominal, config, blind)
    assert bus.all_off() and not bus.torque_on


def test_no_line_at_all(config: ServoConfig, nominal: Nominal) -> None:
    with pytest.raises(LostRobotError, match="cannot be opened"):
        DynamixelRobot(nominal, replace(config, port="/dev/no-such-line"), blind)


def test_a_time_based_profile_becomes_one_of_speed(
    bus: SimulatedBus, config: ServoConfig, nominal: Nominal
) -> None:
    """Under a time-based profile the same number is milliseconds: 21 of them for any way."""
    for servo in bus.servos.values():
        servo.table[10] = 4 | 8
    with DynamixelRobot(nominal, replace(config, speed_rad_per_s=0.5), blind) as robot:
        assert {on["drive_mode"] for on in bus.torque_on} == {0}
        robot.command({"r_elbow": 0.3})
        assert 0 < bus.fastest() <= 0.5 * 4096 / (2 * math.pi)


@pytest.mark.parametrize(
    ("address", "value", "words"),
    [
        (0, b"\xff\xff", "model number 65535 is not known"),
        (0, b"\x24\x04", "XL430-W250 cannot limit its current"),
        (0, b"\xb0\x04", None),
        (6, b"\x25", "firmware 37, needed 38"),
        (10, b"\x01", "would go the wrong way"),
        (10, b"\x02", "slave of a dual joint"),
        (12, b"\x01", "also obeys to id 1"),
        (48, b"\xb8\x0b\x00\x00", None),
        (48, b"\xb8\x06\x00\x00", "own position limits are 0 to 1720"),
    ],
)
def test_what_a_servo_is_is_known_before_it_gets_torque(
    bus: SimulatedBus, config: ServoConfig, nominal: Nominal, address: int, value: bytes, words: str | None
) -> None:
    bus.servos[2].table[address : address + len(value)] = value
    if words is None:
        with DynamixelRobot(nominal, config, blind) as robot:
            assert robot.identities["r_shoulder_roll"].model == "XM430-W350"
            if address == 0:
                assert bus.torque_on[-1]["current"] == 300, "an XL330 counts milliamperes"
        return
    with pytest.raises(HardwareFaultError, match=rf"r_elbow \(servo 2\): .*{words}"):
        DynamixelRobot(nominal, config, blind)
    assert bus.all_off() and not bus.torque_on


def test_the_file_may_say_which_servo_is_meant(
    bus: SimulatedBus, config: ServoConfig, nominal: Nominal
) -> None:
    first, second = config.servos
    told = replace(config, servos=(replace(first, model="xm430-w350", firmware="45"), second))
    DynamixelRobot(nominal, told, blind).close()
    told = replace(config, servos=(first, replace(second, firmware="46")))
    with pytest.raises(HardwareFaultError, match="firmware is 45, and the file says 46"):
        DynamixelRobot(nominal, told, blind)
    assert bus.all_off()


def test_two_servos_with_one_id(nominal: Nominal, tmp_path: Path) -> None:
    """Their answers overlay each other, and no check sum is right."""
    servos = (SimulatedServo(1, 1100.0), SimulatedServo(2, 2000.0), SimulatedServo(2, 2900.0))
    with SimulatedBus(*servos) as bus:
        file = tmp_path / "servos.toml"
        file.write_text(TOML.format(port=bus.port))
        with pytest.raises(LostRobotError, match="no two servos have the same id"):
            DynamixelRobot(nominal, file, blind)
        assert bus.all_off() and not bus.torque_on


# Moving.


def test_zero_and_direction_in_and_out(bus: SimulatedBus, config: ServoConfig, nominal: Nominal) -> None:
    with DynamixelRobot(nominal, config, blind) as robot:
        arrival = robot.command({"r_elbow": 0.5, "r_shoulder_roll": 1.0})
        assert bus.positions()[2] == pytest.approx(2048 - 0.5 * 4096 / (2 * math.pi), abs=0.6)
        assert bus.positions()[1] == pytest.approx(1024 + 1.0 * 4096 / (2 * math.pi), abs=0.6)
        assert arrival.measured["r_elbow"] == pytest.approx(0.5, abs=0.001)
        assert robot.look().measured["r_shoulder_roll"] == pytest.approx(1.0, abs=0.001)
        limit = 2.0 * 4096 / (2 * math.pi)
        assert 0.9 * limit < max(servo.fastest for servo in bus.servos.values()) < 1.02 * limit
        assert bus.servos[1].table[98] == 125, "the watchdog is patient while the robot stands"


def test_nothing_is_sent_for_a_command_beyond_the_limits(
    bus: SimulatedBus, config: ServoConfig, nominal: Nominal
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
        assert robot.standing.torque is Torque.HELD, "a refused command is no failure"


def test_lost_and_garbled_answers_are_asked_for_again(
    bus: SimulatedBus, config: ServoConfig, nominal: Nominal
) -> None:
    with DynamixelRobot(nominal, config, blind) as robot:
        bus.drop = 2
        robot.command({"r_elbow": 0.3})
        bus.garble = 2
        assert robot.command({"r_elbow": 0.2}).measured["r_elbow"] == pytest.approx(0.2, abs=0.001)


# The file.


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("current_a = 0.3", "curent_a = 0.3", "curent_a is no key"),
        ("current_a = 0.3", "", "exactly one torque limit"),
        ("current_a = 0.3", "pwm_share = 2.0", "share from 0 to 1"),
        ("speed_rad_per_s = 2.0", "speed_rad_per_s = 0.005", "0 would mean no limit"),
        ("speed_rad_per_s = 2.0", "speed_rad_per_s = -1", "above 0"),
        ("current_a = 0.3", 'current_a = 0.3\nat_end = "on"', 'needed "off" or "hold"'),
        ("current_a = 0.3", "torque_share = 0.3", "torque_share is no key"),
        ("id = 2", "id = 2\nfirmware = 45", "needed a text"),
        ("id = 2", "id = 2\nhoming_offset = 45", "is no key"),
        ("[joints", "rest = 3\n[joints", "rest is no key"),
        ("id = 2", "id = 1", "each only once"),
        ("id = 2", "", "joints.r_elbow.id is missing"),
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


# With a body behind it.


def test_it_sees_itself_through_its_servos(bus: SimulatedBus, config: ServoConfig, nominal: Nominal) -> None:
    """Servos with a hidden body on them, before a mirror: commands go in, image points come out."""
    hidden = [HiddenEffect("joint_offset", "joint:r_elbow", {"offset_rad": 0.05})]
    body = HiddenBody(nominal.robot_file.read_text(), "base_link", nominal.metadata.gravity_m_per_s2, hidden)
    lens, rng, views = lens_of(nominal), np.random.default_rng(3), iter([View(), View(0.26)])
    board = body.link_poses()["chest_board"][:3, 3]

    def eye() -> ImagePoints:
        body.move({s.joint: s.position_rad(round(bus.positions()[s.servo_id])) for s in config.servos})
        view = next(views)
        normal = view.normal_in_root
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
