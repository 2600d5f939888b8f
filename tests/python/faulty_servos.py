"""Faults of line, servos, process, user code and time, injected at random into robots of servos; the table of docs/faults.md.

`python tests/python/faulty_servos.py --runs 300 --seed 0`. Each run opens a robot of two simulated servos (Dynamixel or Feetech,
torque off or held at the end), moves it, injects one fault at a random moment, and then asks the simulated servos, not the
robot, how they are.
"""

from __future__ import annotations

import argparse
import math
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

import dynamixel_bus
import feetech_bus
from mirror_posture import MirrorPostureError
from mirror_posture.robots import ImagePoints, Interrupted, Nominal, ending_signals
from mirror_posture.robots.dynamixel import DynamixelRobot
from mirror_posture.robots.feetech import FeetechRobot
from servo_bus import SimulatedLine
from servo_fault_kinds import IN_A_CHILD, INJECTED, MISTAKES, Mistake, World, kinds, later
from two_servos import JOINTS

COUNTS = 4096 / (2.0 * math.pi)
TOML = (
    """
[bus]
port = "{port}"
speed_rad_per_s = {speed}
acceleration_rad_per_s2 = 20.0
at_end = "{at_end}"
{torque}
"""
    + JOINTS
)
AFTER_S = 1.2
"""By then whatever moves by itself has come to rest: a watchdog's 0.5 s, a lead of 0.3 s, a deceleration."""


@lru_cache
def nominal() -> Nominal:
    return Nominal.load()


@dataclass(frozen=True)
class Trial:
    """One run, as the simulated servos saw it."""

    group: str
    fault: str
    make: str
    at_end: str
    torque: str
    """`off`, `held`, or `left on` of the servos' own memory."""
    said: str
    """What the robot says: off, held, not known; refused, where it was not opened; or nothing, where it was killed."""
    ended: str
    """The exception that ended it; "went on" where none did."""
    promise_kept: bool
    commanded_share: float
    """The fastest that any servo was told to turn, of its limit."""
    fastest_share: float
    """The fastest that any servo turned, of its limit."""
    still: bool
    """Nothing moved any more after `AFTER_S`."""
    why: str


@contextmanager
def simulated(make: str) -> Iterator[SimulatedLine]:
    kind = dynamixel_bus if make == "dynamixel" else feetech_bus
    with kind.SimulatedBus(kind.SimulatedServo(1, 1100.0), kind.SimulatedServo(2, 2000.0)) as bus:  # type: ignore[attr-defined]
        yield bus


def blind() -> ImagePoints:
    return ImagePoints(np.zeros((30, 2)), np.zeros(30, bool), np.zeros((6, 2)), np.zeros(6, bool))


def trial(kind: tuple[str, str, str], seed: int) -> Trial:
    """One run; `seed` decides make, end, moment and everything else."""
    group, name, way = kind
    # Programs that are started in the background ignore Ctrl-C; what is tried here is a program in the foreground.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    rng = random.Random(f"{name} {seed}")
    make, at_end = rng.choice(("dynamixel", "feetech")), rng.choice(("off", "hold"))
    speed = rng.uniform(0.4, 1.0)
    torque = "current_a = 0.3" if make == "dynamixel" else "torque_share = 0.4"
    with simulated(make) as bus, tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "servos.toml"
        file.write_text(TOML.format(port=bus.port, speed=speed, at_end=at_end, torque=torque))
        world = World(make, bus, rng)
        if way == "child":
            ended, said, why = _in_a_child(world, name, file)
        else:
            # A signal that comes when the robot is closed already is the program's own affair.
            with ending_signals():
                ended, said, why = _here(world, group, name, way, file)
        time.sleep(AFTER_S)
        return _judge(world, (group, name, make, at_end), speed, ended, said, why)


def _here(world: World, group: str, name: str, way: str, file: Path) -> tuple[str, str, str]:
    rng, ended = world.random, "went on"
    make = DynamixelRobot if world.make == "dynamixel" else FeetechRobot
    timers = []
    robot: Any = None
    try:
        robot = make(nominal(), file, blind)
        world.robot = robot
        with robot:
            robot.command(_target(rng))
            if way == "code":
                code = next(c for c in MISTAKES if c.__name__ == name)
                code(robot, rng)
            else:
                fault = next(f for faults in INJECTED.values() for f in faults if f.__name__ == name)
                moment_s = rng.uniform(0.0, 0.8)
                standing = name == "mode_written_over" or (group != "process" and rng.random() < 0.3)
                if not standing:
                    timers.append(later(lambda: fault(world), moment_s))
                else:
                    fault(world)
            for _ in range(2):
                robot.command(_target(rng))
                robot.look()
                time.sleep(rng.uniform(0.0, 0.4))
            for timer in timers:
                timer.join()
            time.sleep(0.05)
    except (MirrorPostureError, Mistake, KeyboardInterrupt, SystemExit) as error:
        ended = type(error).__name__
    for timer in timers:
        quiet = 0
        while timer.is_alive() or quiet < 5:
            try:
                # Signals of a run that has ended are heard here.
                quiet = 0 if timer.is_alive() else quiet + 1
                time.sleep(0.01)
            except (KeyboardInterrupt, Interrupted):
                continue
    if robot is None:
        # It was not even opened: the simulated servos answer too late where the machine is very busy.
        return ended, "refused", ended
    standing = robot.standing
    return ended, standing.torque.value, standing.why


CHILD = """
import random, signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)
from mirror_posture.robots import Nominal
from mirror_posture.robots.{make} import {robot}
robot = {robot}(Nominal.load(), sys.argv[1], lambda: None)
print("open", flush=True)
rng = random.Random(sys.argv[2])
for _ in range(int(sys.argv[3])):
    robot.command({{"r_shoulder_roll": rng.uniform(0.2, 1.4), "r_elbow": rng.uniform(0.0, 1.4)}})
"""


def _in_a_child(world: World, name: str, file: Path) -> tuple[str, str, str]:
    rng = world.random
    program = CHILD.format(
        make=world.make, robot="DynamixelRobot" if world.make == "dynamixel" else "FeetechRobot"
    )
    moves = "1" if name == "ends_without_closing" else "50"
    child = subprocess.Popen(
        [sys.executable, "-c", program, str(file), str(rng.random()), moves],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    world.child = child
    assert child.stdout is not None and child.stdout.readline() == "open\n"
    time.sleep(rng.uniform(0.1, 1.2))
    fault = next(f for faults in IN_A_CHILD.values() for f in faults if f.__name__ == name)
    fault(world)
    if name == "frozen_for_a_second" and world.make == "feetech":
        # Nothing in these servos notices, and nothing has to: it goes on, and is ended as anybody would.
        time.sleep(0.3)
        child.send_signal(signal.SIGTERM)
    _, heard = child.communicate(timeout=30.0)
    ended = f"exit {child.returncode}"
    if world.killed:
        return ended, "", "killed"
    said = next(
        (w for w in ("held", "off", "not known") if f"torque is {w}" in heard), "nothing: " + heard[-300:]
    )
    return ended, said, heard.strip().splitlines()[-1] if heard.strip() else ""


def _target(rng: random.Random) -> dict[str, float]:
    return {"r_shoulder_roll": rng.uniform(0.1, 0.7), "r_elbow": rng.uniform(0.0, 0.7)}


def _judge(
    world: World, named: tuple[str, str, str, str], speed: float, ended: str, said: str, why: str
) -> Trial:
    group, name, make, at_end = named
    bus = world.bus
    on = bus.torques()
    still = not any(bus.speeds().values())
    limited = all(servo.in_force()["speed"] > 0 for servo in bus.all if servo.torque)
    torque = "off" if not any(on) else "held" if all(on) and limited else "left on"
    if said == "off":
        kept = torque == "off" and (at_end == "off" or ended == "went on" or "not held, as configured" in why)
    elif said == "held":
        kept = torque == "held" and at_end == "hold"
    elif said == "refused":
        kept = torque == "off"
    elif said == "not known":
        # A servo that died takes no other one with it.
        kept = not world.reachable and (torque == "off" or name != "servo_dies")
    else:
        kept = world.killed and torque == "held"
    share = bus.fastest() / (speed * COUNTS)
    # A servo that lost its power comes back as it likes; every other torque goes on with its limits, where it stands.
    if "power" not in name and name != "servo_dies":
        kept &= all(abs(on["jump"]) <= 1 and on["speed"] > 0 for on in bus.torque_on)
    commanded = _commanded_rad_per_s(world) / speed
    return Trial(group, name, make, at_end, torque, said, ended, kept, commanded, share, still, why)


def _commanded_rad_per_s(world: World) -> float:
    """The fastest that any servo was ever told to turn, read off the line; infinite for 0, which means no limit."""
    address, size = (112, 4) if world.make == "dynamixel" else (46, 2)
    told = []
    for servo_id, instruction, given in world.bus.instructions:
        at = int.from_bytes(given[:2], "little") if world.make == "dynamixel" else given[0] if given else -1
        data = given[2:] if world.make == "dynamixel" else given[1:]
        if instruction == dynamixel_bus.WRITE and at == address and len(data) == size:
            unit = dynamixel_bus.UNIT_COUNTS_PER_S
            if world.make == "feetech":
                phase = world.bus.servos[servo_id].kept[18]  # type: ignore[attr-defined]
                unit = 1.0 if phase & feetech_bus.FINE_SPEED else 50.0
            told.append(int.from_bytes(data, "little") * unit / COUNTS or math.inf)
        elif instruction == dynamixel_bus.SYNC_WRITE and at == address:
            told.append(math.inf)
    return max(told, default=0.0)


def row(trials: list[Trial]) -> str:
    """A line of the table of docs/faults.md."""
    one = trials[0]
    went_on = sum(t.ended == "went on" for t in trials)
    count = {said: sum(t.said == said for t in trials) for said in ("off", "held", "not known", "")}
    # What was refused at its opening has no torque.
    count["off"] += sum(t.said == "refused" for t in trials)
    broken = sum(not t.promise_kept for t in trials)
    moving = sum(not t.still for t in trials)
    told, fastest = max(t.commanded_share for t in trials), max(t.fastest_share for t in trials)
    name = one.fault if one.fault.startswith("SIG") else one.fault.replace("_", " ")
    return (
        f"| {one.group} | {name} | {len(trials)} | {went_on} | {count['off']} | {count['held']} | {count['not known'] + count['']} "
        f"| {broken} | {moving} | {told:.2f} | {fastest:.2f} |"
    )


HEAD = """| | fault | runs | went on | torque off | held | could not be queried | other than promised | still moving | fastest commanded, of the limit | fastest turned |
| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--only", default="", help="part of a fault's name")
    given = parser.parse_args()
    chosen = [kind for kind in kinds() if given.only in kind[1]]
    found: dict[tuple[str, str, str], list[Trial]] = defaultdict(list)
    asked = [(chosen[i % len(chosen)], 1000 * given.seed + i // len(chosen)) for i in range(given.runs)]
    with ProcessPoolExecutor(given.jobs) as pool:
        for one, (kind, seed) in zip(pool.map(trial, *zip(*asked, strict=True)), asked, strict=True):
            found[kind].append(one)
            if not one.promise_kept or not one.still or max(one.fastest_share, one.commanded_share) > 1.0:
                print(f"seed {seed}: {one}", file=sys.stderr, flush=True)
    print(HEAD)
    for kind in chosen:
        if found[kind]:
            print(row(found[kind]))
    every = [one for trials in found.values() for one in trials]
    print(
        f"\n{len(every)} runs: torque other than promised in {sum(not t.promise_kept for t in every)}, still moving in "
        f"{sum(not t.still for t in every)}, fastest commanded {max(t.commanded_share for t in every):.3f} of the limit, turned "
        f"{max(t.fastest_share for t in every):.3f}"
    )


if __name__ == "__main__":
    main()
