"""Dynamixel servos over a serial line: limits of speed and torque first, torque off on any failure.

Needs the extra `dynamixel` (the vendor's SDK). Servos of the X series, protocol 2.0; which servo is which joint says a TOML
file, see docs/robots.md.
"""

from __future__ import annotations

import atexit
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import numpy.typing as npt

from .base import RobotBase
from .dynamixel_bus import (
    BUS_WATCHDOG,
    CURRENT_BASED_POSITION_CONTROL,
    GOAL_CURRENT,
    GOAL_POSITION,
    GOAL_PWM,
    HARDWARE_ERROR,
    OPERATING_MODE,
    POSITION_CONTROL,
    PRESENT_POSITION,
    PRESENT_VELOCITY,
    PROFILE_ACCELERATION,
    PROFILE_VELOCITY,
    TORQUE_ENABLE,
    WATCHDOG_UNIT_S,
    DynamixelBus,
    fault_words,
)
from .dynamixel_config import PWM_COUNTS, DynamixelConfig, Servo, load_config
from .errors import HardwareFaultError, LostRobotError, NotSettledError, RobotError
from .nominal import Nominal
from .protocol import ImagePoints, Look, Positions

Eye = Callable[[], "npt.NDArray[np.uint8] | ImagePoints"]
"""Takes a picture (BGR) when called, or gives what was detected in one."""

WATCHDOG_S = 0.5
"""While the robot moves: servos that hear nothing for so long stop by themselves. A cut line then ends the motion."""
POLL_S = 0.02
STILL_READS = 3
"""So many reads in a row at rest are rest."""
STILL_UNITS = 1
"""Of present velocity, 0.229 turns a minute: a servo's own noise."""
PATIENCE_S = 2.0
"""Beyond the time that the motion should take."""
OFF_TRIES = 3


@contextmanager
def _deaf_to_ctrl_c() -> Iterator[None]:
    """An impatient second Ctrl-C does not end what makes the robot safe."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


class DynamixelRobot(RobotBase):
    """A robot of Dynamixel servos. Use it as a context: at its end it rests, with torque off.

    At opening every servo is asked for, torque is taken off, the torque and speed limits are written and read back, and
    only then is torque put on, at the place where each joint stands. Any failure under way, Ctrl-C included, takes torque
    off at once; then the robot has to be opened again.
    """

    def __init__(
        self,
        nominal: Nominal,
        config: DynamixelConfig | str | os.PathLike[str],
        eye: Eye,
        *,
        name: str = "dynamixel",
    ) -> None:
        self.config = config if isinstance(config, DynamixelConfig) else load_config(config, nominal)
        self._eye = eye
        self._servos: dict[str, Servo] = {servo.joint: servo for servo in self.config.servos}
        self._ids = [servo.servo_id for servo in self.config.servos]
        self._torque = False
        self._why_off = "it was never put on"
        super().__init__(nominal, name=name, limits={joint: s.limits for joint, s in self._servos.items()})
        self._bus = DynamixelBus(self.config.port, self.config.baudrate)
        # For a program that ends without closing.
        atexit.register(self._at_exit)
        try:
            self._prepare()
        except BaseException as error:
            self._off(error)
            self._bus.close()
            atexit.unregister(self._at_exit)
            raise

    def torque_is_on(self) -> bool:
        """Whether the robot holds itself, as far as is known here."""
        return self._torque

    # From opening to torque.

    def _prepare(self) -> None:
        bus, config = self._bus, self.config
        for servo_id in self._ids:
            bus.ping(servo_id)
        self._check_faults()
        bus.write_everywhere(TORQUE_ENABLE, 0)
        by_current = config.current_a is not None
        mode = CURRENT_BASED_POSITION_CONTROL if by_current else POSITION_CONTROL
        for servo_id in self._ids:
            # Torque off first: the operating mode cannot be written under torque, and no limit is in force yet.
            bus.write(servo_id, TORQUE_ENABLE, 0)
            bus.write(servo_id, BUS_WATCHDOG, 0)
            if bus.read(servo_id, OPERATING_MODE) != mode:
                bus.write(servo_id, OPERATING_MODE, mode)
            bus.write(servo_id, PROFILE_ACCELERATION, config.acceleration_units)
            bus.write(servo_id, PROFILE_VELOCITY, config.speed_units)
            if config.current_a is not None:
                bus.write(servo_id, GOAL_CURRENT, max(1, round(config.current_a / config.current_unit_a)))
            elif config.pwm_share is not None:
                bus.write(servo_id, GOAL_PWM, max(1, round(config.pwm_share * PWM_COUNTS)))
        here = bus.read_all(PRESENT_POSITION, self._ids)
        for servo_id in self._ids:
            # Where it stands: putting torque on moves nothing.
            bus.write(servo_id, GOAL_POSITION, here[servo_id])
            bus.write(servo_id, TORQUE_ENABLE, 1)
        self._torque, self._why_off = True, ""
        measured = self._measured(here)
        self._commanded = {
            j: min(max(q, self.limits[j].lower), self.limits[j].upper) for j, q in measured.items()
        }

    def _measured(self, counts: dict[int, int]) -> dict[str, float]:
        return {joint: servo.position_rad(counts[servo.servo_id]) for joint, servo in self._servos.items()}

    # What `RobotBase` asks for.

    def _move(self, positions: dict[str, float]) -> Positions:
        if not self._torque:
            raise HardwareFaultError(
                f"{self.name}: torque is off ({self._why_off}); see to the robot and open it again"
            )
        try:
            return self._go(positions)
        except BaseException as error:
            self._off(error)
            raise

    def _go(self, positions: dict[str, float]) -> Positions:
        bus = self._bus
        here = bus.read_all(PRESENT_POSITION, self._ids)
        goal = {s.servo_id: s.counts(positions[joint]) for joint, s in self._servos.items()}
        farthest = max(abs(positions[j] - q) for j, q in self._measured(here).items())
        watchdog = round(WATCHDOG_S / WATCHDOG_UNIT_S)
        bus.write_all(BUS_WATCHDOG, dict.fromkeys(self._ids, watchdog))
        bus.write_all(GOAL_POSITION, goal)
        ramp = self.config.speed_rad_per_s / self.config.acceleration_rad_per_s2
        deadline = time.monotonic() + farthest / self.config.speed_rad_per_s + ramp + PATIENCE_S
        still = 0
        while still < STILL_READS:
            time.sleep(POLL_S)
            self._check_faults()
            speed = bus.read_all(PRESENT_VELOCITY, self._ids)
            still = still + 1 if max(abs(v) for v in speed.values()) <= STILL_UNITS else 0
            if time.monotonic() > deadline:
                moving = tuple(j for j, s in self._servos.items() if abs(speed[s.servo_id]) > STILL_UNITS)
                raise NotSettledError(
                    f"{self.name}: {', '.join(moving) or 'a joint'} still moved long after it should have arrived",
                    joints=moving,
                )
        bus.write_all(BUS_WATCHDOG, dict.fromkeys(self._ids, 0))
        # A sync write is not answered: what arrived is asked for.
        kept = bus.read_all(GOAL_POSITION, self._ids)
        measured = self._measured(bus.read_all(PRESENT_POSITION, self._ids))
        off = tuple(
            joint
            for joint, servo in self._servos.items()
            if kept[servo.servo_id] != goal[servo.servo_id]
            or abs(measured[joint] - positions[joint]) > self.config.tolerance_rad
        )
        if off:
            told = ", ".join(f"{j} at {measured[j]:.4f} rad instead of {positions[j]:.4f}" for j in off)
            raise NotSettledError(
                f"{self.name}: {told}: blocked, too weak for its torque limit, or the goal was lost",
                joints=off,
            )
        return measured

    def _look(self) -> Look:
        seen = self._eye()
        measured: Positions = {}
        if self._torque:
            try:
                self._check_faults()
                measured = self._measured(self._bus.read_all(PRESENT_POSITION, self._ids))
            except BaseException as error:
                self._off(error)
                raise
        if isinstance(seen, ImagePoints):
            return Look(self.commanded, self._now_s(), measured=measured, points=seen)
        return Look(self.commanded, self._now_s(), measured=measured, picture_bgr=seen)

    def _rest(self) -> None:
        if self._torque and self.config.rest:
            try:
                self._go(self._commanded | dict(self.config.rest))
                self._commanded |= dict(self.config.rest)
            except BaseException as error:
                self._off(error)
                raise
        self._off(None)

    def _close(self) -> None:
        atexit.unregister(self._at_exit)
        self._bus.close()

    def _at_exit(self) -> None:
        if self._torque:
            self._off(None)
        self._bus.close()

    # Failures.

    def _check_faults(self) -> None:
        faults = {i: status for i, status in self._bus.read_all(HARDWARE_ERROR, self._ids).items() if status}
        if faults:
            told = "; ".join(
                f"{joint} (servo {s.servo_id}): {fault_words(faults[s.servo_id])}"
                for joint, s in self._servos.items()
                if s.servo_id in faults
            )
            raise HardwareFaultError(
                f"{self.name}: {told}; torque is taken off. Let it cool, free it, and reboot it"
            )

    def _off(self, why: BaseException | None) -> None:
        """Takes torque off every servo on the line and makes sure of it.

        Raises `LostRobotError` where nobody answers any more; says so beside `why`, which is what is then told.
        """
        failed: RobotError | None = None
        with _deaf_to_ctrl_c():
            for _ in range(OFF_TRIES):
                try:
                    self._bus.write_everywhere(TORQUE_ENABLE, 0)
                    on = [i for i, value in self._bus.read_all(TORQUE_ENABLE, self._ids).items() if value]
                    failed = HardwareFaultError(f"{self.name}: servos {on} keep their torque") if on else None
                    if not on:
                        break
                except RobotError as error:
                    failed = error
        self._why_off = "it rests" if why is None else f"{type(why).__name__}: {why}"
        was_on, self._torque = self._torque, False
        if failed is None or not was_on:
            return
        note = (
            f"{self.name}: torque could not be taken off ({failed}). Servos under way stop by themselves after {WATCHDOG_S:g} s "
            "and hold with limited torque: switch their power off"
        )
        self._why_off = note
        if why is None:
            raise LostRobotError(note)
        if hasattr(why, "add_note"):
            why.add_note(note)
