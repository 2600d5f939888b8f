"""One motion of servos on a drive without a line, by a clock of its own: what is sent, what is waited for, what is stopped."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from mirror_posture.robots import (
    HardwareFaultError,
    JointLimits,
    NotSettledError,
    UnsafeCommandError,
    check_command,
)
from mirror_posture.robots import servo_motion as module
from mirror_posture.robots.servo_config import Servo, ServoConfig
from mirror_posture.robots.servo_drive import Reading
from mirror_posture.robots.servo_motion import PATIENCE_S, POLL_S, STILL_READS, ServoMotion

SPEED, ACCELERATION, UNIT_RAD_PER_S = 0.5, 2.0, 0.01
COUNTS_PER_TURN = 100_000
SERVO = Servo("elbow", 1, 0, 1, JointLimits(-3.0, 3.0), counts_per_turn=COUNTS_PER_TURN)
CONFIG = ServoConfig("line", (SERVO,), speed_rad_per_s=SPEED, acceleration_rad_per_s2=ACCELERATION)


class Drive:
    """Says of each read what a script says: position in rad and the speed's number; keeps what it is told."""

    goal, watchdog_bitten, still_units, make = "goal", 255, 1, "scripted"

    def __init__(self, script: Callable[[int], tuple[float, int]], watchdog: str | None) -> None:
        self.script, self.watchdog = script, watchdog
        self.reads, self.sent = 0, []
        self.line = SimpleNamespace(write_all=lambda register, values: self.sent.append(values[1]))

    def read(self) -> Reading:
        self.reads += 1
        position, speed = self.script(self.reads)
        goal = self.sent[-1] if self.sent else 0
        return Reading({1: SERVO.counts(position)}, {1: speed}, {1: goal}, {1: True}, {1: 0}, {1: {}}, {})

    def check(self, reading: Reading, *, torque: bool) -> None:
        pass

    def speed_unit_of(self, servo_id: int) -> float:
        return UNIT_RAD_PER_S


@pytest.fixture(autouse=True)
def clock(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """Time passes by sleeping only."""
    clock = SimpleNamespace(now_s=0.0)

    def sleep(seconds: float) -> None:
        clock.now_s += seconds

    monkeypatch.setattr(module, "time", SimpleNamespace(sleep=sleep, monotonic=lambda: clock.now_s))
    return clock


def moved(drive: Drive, to: float) -> Reading:
    motion = ServoMotion(drive, CONFIG, "arm")  # type: ignore[arg-type]
    return motion.run(motion.goal({"elbow": to}), {"elbow": to}, drive.read(), lambda: None)


def there(to: float) -> Callable[[int], tuple[float, int]]:
    return lambda read: (0.0 if read == 1 else to, 0)


def test_without_a_watchdog_a_goal_is_no_farther_ahead_than_the_joint_gets_until_the_next_ones() -> None:
    """At full speed for the time that a goal is ahead, and then to a halt."""
    for here in (0.0, -1.0):
        drive = Drive(lambda read, here=here: (here if read < 3 else 2.0, 0), None)  # type: ignore[misc]
        moved(drive, 2.0)
        ahead = SPEED * module.LEAD_S + SPEED**2 / (2.0 * ACCELERATION)
        assert drive.sent[0] == pytest.approx(SERVO.counts(here) + SERVO.counts(ahead), abs=1.0)
        assert drive.sent[-1] == SERVO.counts(2.0)
    # A servo that stops by itself where it hears nothing gets the goal at once.
    drive = Drive(there(2.0), "watchdog")
    moved(drive, 2.0)
    assert drive.sent == [SERVO.counts(2.0)]


def test_rest_is_several_reads_in_a_row(clock: SimpleNamespace) -> None:
    """A joint that pauses now and then has not arrived: its reads at rest are not added up."""
    drive = Drive(there(1.0), "watchdog")
    moved(drive, 1.0)
    assert drive.reads == 1 + STILL_READS
    # Half of its reads are at rest, never two in a row, and it is far from its goal.
    clock.now_s = 0.0
    drive = Drive(lambda read: (0.1, 5 * (read % 2)), "watchdog")
    with pytest.raises(NotSettledError, match="still moved"):
        moved(drive, 1.0)
    needed_s = (1.0 - 0.1) / SPEED + SPEED / ACCELERATION + PATIENCE_S
    assert clock.now_s == pytest.approx(needed_s, abs=2.0 * POLL_S)


@pytest.mark.parametrize(("times_the_limit", "stopped"), [(2.0, False), (2.2, True), (-2.2, True)])
def test_a_joint_of_twice_its_speed_is_stopped(times_the_limit: float, stopped: bool) -> None:
    speed = round(times_the_limit * SPEED / UNIT_RAD_PER_S)
    positions = itertools.chain([0.0, 0.5], itertools.repeat(1.0))
    drive = Drive(lambda read: (next(positions), speed if read == 2 else 0), "watchdog")
    if stopped:
        with pytest.raises(HardwareFaultError, match=r"elbow \(servo 1\) turns at 1.10 rad/s"):
            moved(drive, 1.0)
    else:
        moved(drive, 1.0)


def test_nothing_follows_a_stop() -> None:
    """Of all changes of state these are made, and no other: after a failure the robot has to be opened again."""
    from mirror_posture.robots.errors import RobotError
    from mirror_posture.robots.servo_state import State, StateMachine, Torque

    ways = {
        "unpowered": {"holding", "stopped"},
        "holding": {"moving", "unpowered", "stopped"},
        "moving": {"holding", "stopped"},
        "stopped": {"stopped"},
    }
    paths: dict[str, list[str]] = {"unpowered": [], "holding": ["holding"], "moving": ["holding", "moving"], "stopped": ["stopped"]}  # fmt: skip
    for state, after in ways.items():
        for wanted in State:
            machine: Any = StateMachine("arm")
            for step in paths[state]:
                machine.to(State(step), Torque.HELD, "so it is")
            if wanted.value in after:
                assert machine.to(wanted, Torque.OFF, "why").state is wanted
            else:
                with pytest.raises(RobotError, match=f"{wanted.value} cannot follow {state}"):
                    machine.to(wanted, Torque.OFF, "why")
                assert machine.now.state is State(state)


def test_a_command_a_rounding_error_beyond_a_limit_is_the_limit() -> None:
    limits = {"elbow": JointLimits(-1.0, 0.5)}
    assert check_command({"elbow": 0.5 + 5e-10}, limits, "arm") == {"elbow": 0.5}
    assert check_command({"elbow": -1.0 - 5e-10}, limits, "arm") == {"elbow": -1.0}
    for beyond in (0.5 + 2e-9, -1.0 - 2e-9, float("nan")):
        with pytest.raises(UnsafeCommandError, match=r"needed a number from -1 to 0\.5"):
            check_command({"elbow": beyond}, limits, "arm")
