"""Faults of line, servos, process, user code and time, each done to a world of two simulated servos at a random moment."""

from __future__ import annotations

import math
import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import feetech_bus
from mirror_posture.robots import ImagePoints, RobotError, UnsafeCommandError
from mirror_posture.robots.servo_robot import ServoRobot
from servo_bus import SimulatedLine


@dataclass
class World:
    """What a fault may do something to."""

    make: str
    bus: SimulatedLine
    random: random.Random
    robot: ServoRobot | None = None
    child: subprocess.Popen[str] | None = None
    reachable: bool = True
    """Whether every servo could be asked when the robot ended."""
    killed: bool = False
    """Nobody was left who could have taken the torque off."""

    @property
    def id(self) -> int:
        return self.random.choice((1, 2))


class Mistake(Exception):
    """Somebody's own exception."""


def later(work: Callable[[], object], after_s: float) -> threading.Timer:
    timer = threading.Timer(after_s, work)
    timer.daemon = True
    timer.start()
    return timer


# The faults: each a function of the world, called at a random moment of a motion or of standing still.


def answers_lost(w: World) -> None:
    w.bus.drop = w.random.randint(1, 3)


def answers_garbled(w: World) -> None:
    w.bus.garble = w.random.randint(1, 3)


def packets_not_heard(w: World) -> None:
    w.bus.deaf = w.random.randint(1, 3)


def foreign_bytes(w: World) -> None:
    w.bus.noise = w.random.uniform(0.02, 0.3)


def answers_late(w: World) -> None:
    w.bus.late_s = w.random.uniform(0.05, 0.2)
    later(lambda: setattr(w.bus, "late_s", 0.0), 0.6)


def line_dead_for_a_moment(w: World) -> None:
    w.bus.mute = True
    later(lambda: setattr(w.bus, "mute", False), w.random.uniform(0.05, 1.0))


def line_dead(w: World) -> None:
    w.bus.mute, w.reachable = True, False


def line_cut(w: World) -> None:
    w.reachable = False
    w.bus.cut()


def overload(w: World) -> None:
    w.bus.fault(w.id, 0x20)


def overheating(w: World) -> None:
    w.bus.fault(w.id, 0x04)


def jammed(w: World) -> None:
    w.bus.servos[w.id].jammed = True


def too_heavy(w: World) -> None:
    servo = w.bus.servos[w.id]
    servo.needed_current = servo.needed_torque = 900  # type: ignore[attr-defined]


def power_dips(w: World) -> None:
    w.bus.brown_out(w.id, w.random.uniform(0.0, 0.4))


def power_dips_and_torque_comes_back(w: World) -> None:
    servo = w.bus.servos[w.id]
    if w.make == "dynamixel":
        servo.table[60] = 1
    w.bus.brown_out(servo.servo_id, w.random.uniform(0.0, 0.4))


def servo_dies(w: World) -> None:
    w.reachable = False
    w.bus.brown_out(w.id, 1e6)


def limits_written_over(w: World) -> None:
    """Another program on the same line: no speed limit any more, in the middle of a motion as well."""
    servo = w.bus.servos[w.id]
    servo.write(112, bytes(4)) if w.make == "dynamixel" else servo.write(46, bytes(2))


def mode_written_over(w: World) -> None:
    """As by another program while the torque was off; under torque servos refuse it."""
    servo = w.bus.servos[w.id]
    if w.make == "dynamixel":
        servo.table[10] = 4
    else:
        servo.table[18] ^= feetech_bus.FINE_SPEED


def own_watchdog_bites(w: World) -> None:
    if w.make == "dynamixel":
        w.bus.servos[w.id].table[98] = 255
    else:
        w.bus.deaf = 10  # they have none: as long without an answer


def signal_of(name: str) -> Callable[[World], None]:
    def send(w: World) -> None:
        os.kill(os.getpid(), getattr(signal, name))

    send.__name__ = name
    return send


def signals_one_after_another(w: World) -> None:
    for _ in range(3):
        os.kill(os.getpid(), w.random.choice((signal.SIGINT, signal.SIGTERM, signal.SIGHUP)))
        time.sleep(w.random.uniform(0.0, 0.03))


def parent_ends(w: World) -> None:
    assert w.robot is not None
    w.robot._parent = 1 << 30


def killed(w: World) -> None:
    assert w.child is not None
    w.killed = True
    w.child.kill()


def frozen_for_a_second(w: World) -> None:
    assert w.child is not None
    w.child.send_signal(signal.SIGSTOP)
    time.sleep(w.random.uniform(0.7, 1.5))
    w.child.send_signal(signal.SIGCONT)


def terminated(w: World) -> None:
    assert w.child is not None
    w.child.send_signal(w.random.choice((signal.SIGTERM, signal.SIGHUP, signal.SIGINT)))


def ends_without_closing(w: World) -> None:
    """The child ends by itself."""


def closed_by_another_thread(w: World) -> None:
    assert w.robot is not None
    try:
        w.robot.close()
    except RobotError:
        return


def commanded_by_another_thread(w: World) -> None:
    assert w.robot is not None
    try:
        w.robot.command({"r_elbow": w.random.uniform(0.0, 0.5)})
    except RobotError:
        return


def clock_is_set(w: World) -> None:
    real, off = time.time, w.random.choice((-3600.0, 3600.0, 86400.0))
    time.time = lambda: real() + off
    later(lambda: setattr(time, "time", real), 0.5)


def machine_is_busy(w: World) -> None:
    """The program does not get its turn for a while."""
    real, pause, count = time.sleep, w.random.uniform(0.3, 1.5), [1]

    def slow(seconds: float) -> None:
        if threading.current_thread() is threading.main_thread() and count and count.pop():
            real(pause)
        real(seconds)

    time.sleep = slow  # type: ignore[assignment]
    later(lambda: setattr(time, "sleep", real), 1.0)


# Mistakes in somebody's code: what it does in place of the next command or look.


def raises(robot: ServoRobot, rng: random.Random) -> None:
    raise Mistake("in the block")


def camera_raises(robot: ServoRobot, rng: random.Random) -> None:
    def broken() -> ImagePoints:
        raise Mistake("in the camera")

    robot._eye = broken
    robot.look()


def commands_nonsense(robot: ServoRobot, rng: random.Random) -> None:
    for position in (math.nan, math.inf, 9.0, -9.0):
        try:
            robot.command({rng.choice(robot.joint_names): position})
        except UnsafeCommandError:
            continue
        raise AssertionError(f"{position} was taken")


def exits(robot: ServoRobot, rng: random.Random) -> None:
    sys.exit(3)


def rests_and_goes_on(robot: ServoRobot, rng: random.Random) -> None:
    robot.rest()
    robot.command({"r_elbow": 0.3})


def closes_and_goes_on(robot: ServoRobot, rng: random.Random) -> None:
    robot.close()
    robot.command({"r_elbow": 0.3})


Fault = Callable[[World], None]
Code = Callable[[ServoRobot, random.Random], None]
INJECTED: dict[str, tuple[Fault, ...]] = {
    "line": (
        *(answers_lost, answers_garbled, packets_not_heard, foreign_bytes, answers_late),
        *(line_dead_for_a_moment, line_dead, line_cut),
    ),
    "servo": (
        *(overload, overheating, jammed, too_heavy, power_dips, power_dips_and_torque_comes_back),
        *(servo_dies, limits_written_over, mode_written_over, own_watchdog_bites),
    ),
    "process": (
        *(signal_of("SIGINT"), signal_of("SIGTERM"), signal_of("SIGHUP"), signals_one_after_another),
        parent_ends,
    ),
    "user code": (closed_by_another_thread, commanded_by_another_thread),
    "time": (clock_is_set, machine_is_busy),
}
IN_A_CHILD: dict[str, tuple[Fault, ...]] = {
    "process": (killed, terminated, ends_without_closing),
    "time": (frozen_for_a_second,),
}
MISTAKES: tuple[Code, ...] = (
    *(raises, camera_raises, commands_nonsense, exits, rests_and_goes_on, closes_and_goes_on),
)


def kinds() -> list[tuple[str, str, str]]:
    """Group, name and way of every fault."""
    found = [(group, f.__name__, "injected") for group, faults in INJECTED.items() for f in faults]
    found += [(group, f.__name__, "child") for group, faults in IN_A_CHILD.items() for f in faults]
    found += [("user code", c.__name__, "code") for c in MISTAKES]
    order = {"line": 0, "servo": 1, "process": 2, "user code": 3, "time": 4}
    return sorted(found, key=lambda kind: order[kind[0]])
