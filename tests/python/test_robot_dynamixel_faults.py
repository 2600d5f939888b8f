"""Dynamixel servos that fail, with their line and their program: torque off on any failure."""

from __future__ import annotations

import math
import os
import signal
import time
from dataclasses import replace

import pytest

from dynamixel_arm import blind, bus, config, nominal, soon  # noqa: F401
from dynamixel_bus import SimulatedBus
from mirror_posture.robots import (
    HardwareFaultError,
    ImagePoints,
    LostRobotError,
    NoLookError,
    Nominal,
    NotSettledError,
)

pytest.importorskip("dynamixel_sdk")

from mirror_posture.robots.dynamixel import DynamixelRobot
from mirror_posture.robots.interruption import Interrupted
from mirror_posture.robots.servo_config import (
    ServoConfig,
)
from mirror_posture.robots.servo_line import Register
from mirror_posture.robots.servo_motion import WATCHDOG_S
from mirror_posture.robots.servo_robot import KEEP_S
from mirror_posture.robots.servo_state import State, Torque

pytestmark = pytest.mark.realtime


# Failures.


@pytest.mark.parametrize("startup", [0, 1])
def test_a_brown_out_between_two_motions_is_found_before_the_next(
    bus: SimulatedBus, config: ServoConfig, nominal: Nominal, startup: int
) -> None:
    """A servo whose power dipped has no limits any more, and with start-up torque it holds as if nothing had happened."""
    with DynamixelRobot(nominal, replace(config, speed_rad_per_s=0.5), blind) as robot:
        robot._keeper.join(0.0)
        bus.servos[2].table[60] = startup
        bus.brown_out(2)
        with pytest.raises(HardwareFaultError, match="a dip of its power"):
            robot.command({"r_elbow": 1.0})
        assert bus.all_off() and robot.standing.torque is Torque.OFF
        assert bus.fastest() <= 0.5 * 4096 / (2 * math.pi)


def test_a_brown_out_while_it_stands_is_found_by_itself(
    bus: SimulatedBus, config: ServoConfig, nominal: Nominal
) -> None:
    with DynamixelRobot(nominal, replace(config, at_end="hold"), blind) as robot:
        bus.servos[2].table[60] = 1
        bus.brown_out(2)
        time.sleep(2.0 * KEEP_S)
        assert robot.standing.state is State.STOPPED
        assert bus.all_off(), "without its limits nothing is held"
        with pytest.raises(HardwareFaultError, match="not held, as configured"):
            robot.command({"r_elbow": 0.5})


def test_a_brown_out_in_a_motion(bus: SimulatedBus, config: ServoConfig, nominal: Nominal) -> None:
    with DynamixelRobot(nominal, replace(config, speed_rad_per_s=0.5), blind) as robot:
        timer = soon(lambda: bus.brown_out(2, 0.3), 0.3)
        with pytest.raises((HardwareFaultError, LostRobotError)):
            robot.command({"r_elbow": 1.0, "r_shoulder_roll": 1.0})
        timer.join()
        assert bus.all_off() and robot.standing.torque is Torque.OFF


def test_held_at_the_end_where_the_file_says_so(
    bus: SimulatedBus, config: ServoConfig, nominal: Nominal
) -> None:
    slow = replace(config, at_end="hold", speed_rad_per_s=0.5)
    with DynamixelRobot(nominal, slow, blind) as robot:
        timer = soon(lambda: os.kill(os.getpid(), signal.SIGTERM), 0.3)
        with pytest.raises(Interrupted, match="SIGTERM"):
            robot.command({"r_shoulder_roll": 1.5})
        timer.join()
        assert robot.standing.sentence == "stopped, torque is held: Interrupted: SIGTERM"
        assert all(bus.torques()) and bus.comes_to_rest()
        here = bus.positions()
        assert 1110.0 < here[1] < 1024 + 1.0 * 4096 / (2 * math.pi)
    time.sleep(0.1)
    assert all(bus.torques()) and bus.positions() == here
    assert bus.servos[1].table[98] == 0, "nobody is there to keep a watchdog awake"


def test_a_dead_parent_ends_the_motion(bus: SimulatedBus, config: ServoConfig, nominal: Nominal) -> None:
    with DynamixelRobot(nominal, replace(config, speed_rad_per_s=0.5), blind) as robot:

        def orphaned() -> None:
            robot._parent = 1 << 30  # nobody's number: as if this process had been handed on

        timer = soon(orphaned, 0.3)
        with pytest.raises(LostRobotError, match="process that started this one has ended"):
            robot.command({"r_shoulder_roll": 1.5})
        timer.join()
        assert bus.all_off() and robot.standing.torque is Torque.OFF


def test_a_servo_that_dies_is_named_and_the_others_lose_their_torque(
    bus: SimulatedBus, config: ServoConfig, nominal: Nominal
) -> None:
    with DynamixelRobot(nominal, config, blind) as robot:
        bus.brown_out(2, 1e6)
        with pytest.raises(LostRobotError):
            robot.command({"r_elbow": 1.0})
        assert bus.all_off() and robot.standing.torque is Torque.UNKNOWN
        assert "No answer from r_elbow (servo 2); the others are without torque" in robot.standing.why


def test_a_line_that_is_back_later_ends_with_the_torque_off(
    bus: SimulatedBus, config: ServoConfig, nominal: Nominal
) -> None:
    with DynamixelRobot(nominal, config, blind) as robot:
        bus.mute = True
        with pytest.raises(LostRobotError):
            robot.command({"r_elbow": 1.0})
        assert robot.standing.torque is Torque.UNKNOWN and not bus.all_off()
        bus.mute = False
    assert bus.all_off() and robot.standing.torque is Torque.OFF
    assert robot.standing.why.endswith("since then the line came back")


def test_a_setting_that_another_program_changed(
    bus: SimulatedBus, config: ServoConfig, nominal: Nominal
) -> None:
    with DynamixelRobot(nominal, config, blind) as robot:
        bus.servos[1].table[10] = 4
        with pytest.raises(HardwareFaultError, match="drive mode is 4 and was 0"):
            robot.command({"r_shoulder_roll": 0.5})
        assert bus.all_off()


def test_a_goal_that_was_not_heard_is_sent_again(
    bus: SimulatedBus, config: ServoConfig, nominal: Nominal
) -> None:
    with DynamixelRobot(nominal, config, blind) as robot:
        write_all, lost = robot._drive.line.write_all, []

        def deaf(register: Register, values: dict[int, int]) -> None:
            if register.address == 116 and not lost:
                lost.append(values)
            else:
                write_all(register, values)

        robot._drive.line.write_all = deaf  # type: ignore[method-assign]
        assert robot.command({"r_elbow": 0.4}).measured["r_elbow"] == pytest.approx(0.4, abs=0.001)
        assert lost


def test_a_joint_that_does_not_move_is_named_and_torque_goes_off(
    bus: SimulatedBus, config: ServoConfig, nominal: Nominal
) -> None:
    with DynamixelRobot(nominal, config, blind) as robot:
        bus.servos[2].jammed = True
        with pytest.raises(NotSettledError, match=r"r_elbow at 0\.0736 rad instead of 0\.5000") as caught:
            robot.command({"r_elbow": 0.5, "r_shoulder_roll": 0.5})
        assert caught.value.joints == ("r_elbow",)
        assert bus.all_off() and robot.standing.torque is not Torque.HELD
        with pytest.raises(HardwareFaultError, match=r"torque is off: .*r_elbow"):
            robot.command({"r_shoulder_roll": 0.6})


def test_a_load_beyond_the_torque_limit_is_not_fought(
    bus: SimulatedBus, config: ServoConfig, nominal: Nominal
) -> None:
    bus.servos[1].needed_current = 500
    with (
        DynamixelRobot(nominal, config, blind) as robot,
        pytest.raises(NotSettledError, match="r_shoulder_roll"),
    ):
        robot.command({"r_shoulder_roll": 1.0})
    assert bus.all_off()


def test_an_overload_under_way_takes_all_torque_off(
    bus: SimulatedBus, config: ServoConfig, nominal: Nominal
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
    bus: SimulatedBus, config: ServoConfig, nominal: Nominal, how: str
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


def test_after_a_cut_the_robot_opens_again(bus: SimulatedBus, config: ServoConfig, nominal: Nominal) -> None:
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


def test_ctrl_c_takes_torque_off(bus: SimulatedBus, config: ServoConfig, nominal: Nominal) -> None:
    slow = replace(config, speed_rad_per_s=0.5)
    with DynamixelRobot(nominal, slow, blind) as robot:
        timer = soon(lambda: os.kill(os.getpid(), signal.SIGINT), 0.3)
        with pytest.raises(KeyboardInterrupt):
            robot.command({"r_shoulder_roll": 1.5})
        timer.join()
        assert bus.all_off()
        assert bus.positions()[1] < 1024 + 1.0 * 4096 / (2 * math.pi)


def test_a_failing_camera_ends_in_rest(bus: SimulatedBus, config: ServoConfig, nominal: Nominal) -> None:
    def dark() -> ImagePoints:
        raise NoLookError("no picture")

    resting = replace(config, rest={"r_shoulder_roll": 0.1})
    with pytest.raises(NoLookError), DynamixelRobot(nominal, resting, dark) as robot:
        robot.command({"r_shoulder_roll": 0.6})
        robot.look()
    assert bus.all_off()
    assert bus.positions()[1] == pytest.approx(1024 + 0.1 * 4096 / (2 * math.pi), abs=1.0)
