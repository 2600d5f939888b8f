"""A robot of servos, of whatever make: limits before torque, limits before every motion, and an end that says what it left.

`unpowered → holding ⇄ moving`, and `stopped` from everywhere (`servo_state`). What a make of servo is like says its
`ServoDrive`.
"""

from __future__ import annotations

import atexit
import logging
import os
import signal
import threading
import time
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from .base import RobotBase
from .errors import HardwareFaultError, LostRobotError, NotSettledError, RobotError
from .interruption import handle_ending_signals, let_signals_end, undisturbed
from .nominal import Nominal
from .protocol import ImagePoints, Look, Positions
from .servo_config import Servo, ServoConfig
from .servo_drive import Identity, Reading, ServoDrive
from .servo_state import Standing, State, StateMachine, Torque

log = logging.getLogger(__name__)

Eye = Callable[[], "npt.NDArray[np.uint8] | ImagePoints"]
"""Takes a picture (BGR) when called, or gives what was detected in one."""

WATCHDOG_S = 0.5
"""While the robot moves: servos that hear nothing for so long stop by themselves. A cut line then ends the motion."""
STANDING_WATCHDOG_S = 2.5
"""While it holds. A computer that is busy for a second is no fault of a robot that stands still."""
KEEP_S = 0.5
"""While it holds, all servos are asked so often how they are."""
LEAD_S = 0.3
"""Servos without a watchdog get goals so far ahead and no farther: a cut line ends their motion as well."""
POLL_S = 0.02
STILL_READS = 3
"""So many reads in a row at rest, near the goal, are rest."""
BLOCKED_READS = 25
"""So many reads at rest elsewhere: it does not get there."""
PATIENCE_S = 2.0
"""Beyond the time that the motion should take."""
TOO_FAST = 2.0
"""A joint that turns so many times faster than its limit is stopped; a servo's own reading may be a third too high."""
OFF_PATIENCE_S = 2.0
"""So long it is tried to take the torque off: a servo whose power dipped takes a moment to listen again."""


class ServoRobot(RobotBase):
    """A robot of servos. Use it as a context: at its end it rests, with the torque off, or held where the file says so.

    At opening every servo is asked for and verified, torque is taken off, the limits of torque and speed are written and
    read back, and only then is torque put on, at the place where each joint stands. Before every motion, and while it lasts,
    all of that is read again. Any failure under way, a signal, Ctrl-C, a lost parent process, ends the motion and the torque (or holds,
    as configured); `standing` says which, and the robot has to be opened again.
    """

    def __init__(
        self,
        nominal: Nominal,
        config: ServoConfig,
        drive: Callable[[ServoConfig], ServoDrive],
        eye: Eye,
        *,
        name: str,
    ) -> None:
        self.config = config
        self._eye = eye
        self._servos: dict[str, Servo] = {servo.joint: servo for servo in config.servos}
        super().__init__(nominal, name=name, limits={joint: s.limits for joint, s in self._servos.items()})
        self._machine = StateMachine(name)
        self._powered = False
        self._lock = threading.RLock()
        self._process, self._parent = os.getpid(), _parent(config)
        self._drive = drive(config)
        # A program that is ended, or that ends without closing, does not leave its robot with the torque on.
        self._signals = handle_ending_signals()
        atexit.register(self._at_exit)
        try:
            self._power()
        except BaseException as error:
            self._end(error)
            self._let_go()
            raise
        self._keeper = threading.Thread(target=self._keep, name=f"{name}: standing by", daemon=True)
        self._keeper.start()

    # What the world asks.

    @property
    def standing(self) -> Standing:
        """State, torque and the reason of the last change."""
        return self._machine.now

    @property
    def identities(self) -> dict[str, Identity]:
        """Model and firmware of each joint's servo."""
        return {joint: self._drive.identities[s.servo_id] for joint, s in self._servos.items()}

    def torque_is_on(self) -> bool:
        """Whether the robot holds itself, as far as is known here."""
        return self._machine.now.torque is Torque.HELD

    # From opening to torque.

    def _power(self) -> None:
        drive = self._drive
        drive.prepare()
        reading = drive.read()
        drive.check(reading, torque=False)
        self._powered = True
        for servo_id in drive.ids:
            # Where it stands: putting torque on moves nothing.
            drive.line.write(servo_id, drive.goal, reading.position[servo_id])
            drive.line.write(servo_id, drive.torque, 1)
        drive.watch(STANDING_WATCHDOG_S)
        drive.check(drive.read(), torque=True)
        self._machine.to(State.HOLDING, Torque.HELD, "opened, every limit read back")
        self._commanded = {
            j: min(max(q, self.limits[j].lower), self.limits[j].upper)
            for j, q in self._measured(reading).items()
        }

    def _measured(self, reading: Reading) -> dict[str, float]:
        return {j: s.position_rad(reading.position[s.servo_id]) for j, s in self._servos.items()}

    # What `RobotBase` asks for.

    def _move(self, positions: dict[str, float]) -> Positions:
        with self._lock:
            self._machine.check_holding()
            try:
                return self._go(positions)
            except BaseException as error:
                self._end(error)
                raise

    def _look(self) -> Look:
        seen = self._eye()
        measured: Positions = {}
        with self._lock:
            if self._machine.now.state is State.HOLDING:
                try:
                    reading = self._drive.read()
                    self._drive.check(reading, torque=True)
                    measured = self._measured(reading)
                except BaseException as error:
                    self._end(error)
                    raise
        if isinstance(seen, ImagePoints):
            return Look(self.commanded, self._now_s(), measured=measured, points=seen)
        return Look(self.commanded, self._now_s(), measured=measured, picture_bgr=seen)

    def _rest(self) -> None:
        with self._lock:
            if self._machine.now.state is State.HOLDING and self.config.rest:
                try:
                    self._go(self._commanded | dict(self.config.rest))
                    self._commanded |= dict(self.config.rest)
                except BaseException as error:
                    self._end(error)
                    raise
            if self._machine.now.state in (State.HOLDING, State.MOVING):
                self._end(None)
            elif self._machine.now.torque is Torque.UNKNOWN:
                self._try_again()

    def _close(self) -> None:
        if self._machine.now.state in (State.HOLDING, State.MOVING):
            self._end(None, "closed")
        self._let_go()

    def _let_go(self) -> None:
        atexit.unregister(self._at_exit)
        if self._signals:
            self._signals = False
            let_signals_end()
        with self._lock:
            self._drive.line.close()

    # Motion.

    def _go(self, positions: dict[str, float]) -> Positions:
        drive = self._drive
        drive.check_settings()
        reading = drive.read()
        drive.check(reading, torque=True)
        goal = {s.servo_id: s.counts(positions[joint]) for joint, s in self._servos.items()}
        farthest = max(abs(positions[j] - q) for j, q in self._measured(reading).items())
        # Out of a sleep, too: one that has bitten while the robot stood takes goals again only after 0.
        drive.watch(0.0)
        drive.watch(WATCHDOG_S)
        self._machine.to(State.MOVING, Torque.HELD, "a command")
        speed, ramp_s = (
            self.config.speed_rad_per_s,
            self.config.speed_rad_per_s / self.config.acceleration_rad_per_s2,
        )
        deadline = time.monotonic() + farthest / speed + ramp_s + PATIENCE_S
        sent = self._send(reading, goal)
        still = 0
        while True:
            time.sleep(POLL_S)
            self._check_parent()
            reading = drive.read()
            self._check_motion(reading)
            there = all(sent[i] == goal[i] == reading.goal[i] for i in goal)
            quiet = all(abs(v) <= drive.still_units for v in reading.speed.values())
            still = still + 1 if quiet else 0
            arrived = there and not self._astray(reading, positions)
            if still >= (STILL_READS if arrived else BLOCKED_READS):
                break
            if time.monotonic() > deadline:
                moving = tuple(
                    j for j, s in self._servos.items() if abs(reading.speed[s.servo_id]) > drive.still_units
                )
                raise NotSettledError(
                    f"{self.name}: {', '.join(moving) or 'a joint'} still moved long after it should have arrived",
                    joints=moving,
                )
            if not there:
                # On the way, or a write that nobody answers to was lost.
                sent = self._send(reading, goal)
        drive.watch(STANDING_WATCHDOG_S)
        self._machine.to(State.HOLDING, Torque.HELD, "arrived")
        measured = self._measured(reading)
        if off := self._astray(reading, positions):
            told = ", ".join(f"{j} at {measured[j]:.4f} rad instead of {positions[j]:.4f}" for j in off)
            raise NotSettledError(
                f"{self.name}: {told}: blocked, too weak for its torque limit, or the goal was lost",
                joints=off,
            )
        return measured

    def _send(self, reading: Reading, goal: dict[int, int]) -> dict[int, int]:
        """Sends goals: the last ones to servos that would stop by themselves, to others a little ahead of where they are."""
        sent = dict(goal)
        if self._drive.watchdog is None:
            speed = self.config.speed_rad_per_s
            lead_rad = speed * (LEAD_S + 0.5 * speed / self.config.acceleration_rad_per_s2)
            for servo in self.config.servos:
                here, lead = reading.position[servo.servo_id], abs(servo.counts(lead_rad) - servo.counts(0.0))
                sent[servo.servo_id] = min(max(goal[servo.servo_id], here - lead), here + lead)
        self._drive.line.write_all(self._drive.goal, sent)
        return sent

    def _astray(self, reading: Reading, positions: dict[str, float]) -> tuple[str, ...]:
        tolerance = self.config.tolerance_rad
        return tuple(j for j, q in self._measured(reading).items() if abs(q - positions[j]) > tolerance)

    def _check_motion(self, reading: Reading) -> None:
        self._drive.check(reading, torque=True)
        for joint, servo in self._servos.items():
            i = servo.servo_id
            if reading.watchdog.get(i) == self._drive.watchdog_bitten:
                raise LostRobotError(
                    f"{self.name}: {joint} (servo {i}) heard nothing for {WATCHDOG_S:g} s and stopped by itself"
                )
            speed = abs(reading.speed[i]) * self._drive.speed_unit_of(i)
            if speed > TOO_FAST * self.config.speed_rad_per_s + 4.0 * self._drive.speed_unit_of(i):
                raise HardwareFaultError(
                    f"{self.name}: {joint} (servo {i}) turns at {speed:.2f} rad/s, and its limit is "
                    f"{self.config.speed_rad_per_s:g} rad/s"
                )

    # While it stands.

    def _keep(self) -> None:
        """Asks the servos how they are while the robot holds: that keeps their watchdogs awake, and finds what fails."""
        while not self._closed and self._machine.now.state in (State.HOLDING, State.MOVING):
            time.sleep(KEEP_S)
            with self._lock:
                if self._closed or self._machine.now.state is not State.HOLDING:
                    continue
                try:
                    self._check_parent()
                    self._drive.check(self._drive.read(), torque=True)
                except RobotError as error:
                    self._end(error)

    def _check_parent(self) -> None:
        if self._parent is not None and os.getppid() != self._parent:
            raise LostRobotError(f"{self.name}: the process that started this one has ended")

    # The end.

    def _at_exit(self) -> None:
        # A forked child that ends has no say in its parent's robot.
        if os.getpid() != self._process:
            return
        if self._machine.now.state in (State.HOLDING, State.MOVING):
            self._end(None, "the program ended without closing the robot")
            log.warning("%s: %s", self.name, self._machine.now.sentence)
        self._drive.line.close()

    def _end(self, why: BaseException | None, reason: str = "at rest") -> None:
        """Ends motion, and torque where it is not to be held, and makes sure of it; `standing` and the log say which.

        Raises `LostRobotError` where nobody answers any more; says so beside `why`, which is what is then told.
        """
        if os.getpid() != self._process:
            return
        with undisturbed(), self._lock:
            if self._machine.now.state is State.STOPPED:
                return
            cause = reason if why is None else f"{type(why).__name__}: {why}".rstrip(": ")
            torque, note = self._take_off()
            after = State.UNPOWERED if why is None and torque is Torque.OFF else State.STOPPED
            if self._machine.now.state is State.MOVING:
                after = State.STOPPED
            if self._machine.now.state is State.UNPOWERED and after is State.UNPOWERED:
                return
            standing = self._machine.to(after, torque, cause + (f"; {note}" if note else ""))
        if why is not None:
            log.warning("%s: %s", self.name, standing.sentence)
            if hasattr(why, "add_note"):
                why.add_note(f"{self.name}: {note or 'torque ' + torque.value}")
        elif torque is Torque.UNKNOWN:
            raise LostRobotError(f"{self.name}: {note}")

    def _try_again(self) -> None:
        """Once more for a line that may be back; that it is not was said already."""
        with undisturbed():
            torque, _ = self._take_off(0.0)
        if torque is not Torque.UNKNOWN:
            self._machine.to(State.STOPPED, torque, f"{self._machine.now.why}; since then the line came back")
            log.warning("%s: %s", self.name, self._machine.now.sentence)

    def _take_off(self, patience_s: float = OFF_PATIENCE_S) -> tuple[Torque, str]:
        """Holds where that is wanted and safe, else takes the torque off; a note where it is otherwise than configured."""
        refused = ""
        if self.config.at_end == "hold" and self._machine.now.state in (State.HOLDING, State.MOVING):
            try:
                self._hold()
                return Torque.HELD, ""
            except RobotError as error:
                refused = f"not held, as configured, since {error}"
        drive, tried_until = self._drive, time.monotonic() + patience_s
        failed: RobotError
        while True:
            try:
                drive.line.write_everywhere(drive.torque, 0)
                on = [i for i, value in drive.line.read_all(drive.torque, drive.ids).items() if value]
                if not on:
                    return Torque.OFF, refused
                failed = HardwareFaultError(f"servos {on} keep their torque")
            except RobotError as error:
                failed = error
            if not self._powered or time.monotonic() > tried_until:
                break
            time.sleep(POLL_S)
        if not self._powered:
            return Torque.UNKNOWN, f"torque was never put on from here ({failed})"
        stops = (
            f"stop by themselves after {WATCHDOG_S:g} s"
            if drive.watchdog is not None
            else f"go on for at most {LEAD_S + self.config.speed_rad_per_s / self.config.acceleration_rad_per_s2:.2g} s"
        )
        silent = self._silent()
        others = "; the others are without torque" if len(silent) < len(drive.ids) else ""
        return Torque.UNKNOWN, (
            f"torque could not be taken off ({failed}). No answer from {', '.join(silent) or 'some'}{others}. Servos under way {stops} "
            "and hold with limited torque: switch their power off"
        )

    def _silent(self) -> list[str]:
        """Joints whose servo does not say that its torque is off."""
        silent, until = [], time.monotonic() + OFF_PATIENCE_S
        for joint, servo in self._servos.items():
            try:
                # A dead line is not waited for servo by servo.
                late = time.monotonic() > until
                if late or self._drive.line.read(servo.servo_id, self._drive.torque):
                    silent.append(f"{joint} (servo {servo.servo_id})")
            except RobotError:
                silent.append(f"{joint} (servo {servo.servo_id})")
        return silent

    def _hold(self) -> None:
        """Every goal where its joint stands, within limits that are in force. Raises `RobotError` where that is not so."""
        drive, until = self._drive, time.monotonic() + OFF_PATIENCE_S
        reading = drive.read()
        drive.check(reading, torque=True)
        if self._machine.now.state is State.MOVING:
            drive.watch(0.0)
            drive.line.write_all(drive.goal, reading.position)
            while True:
                reading = drive.read()
                drive.check(reading, torque=True)
                if all(abs(v) <= drive.still_units for v in reading.speed.values()):
                    break
                if time.monotonic() > until:
                    raise NotSettledError(f"{self.name}: does not come to a halt")
                # To where it is by now: no way back at the end of a stop.
                drive.line.write_all(drive.goal, reading.position)
                time.sleep(POLL_S)
        drive.watch(0.0)


def _parent(config: ServoConfig) -> int | None:
    """The process whose end ends this one's motion; None: nobody's, or a program that was meant to outlive it (nohup)."""
    hang_up = getattr(signal, "SIGHUP", None)
    if not config.end_with_parent or hang_up is None or signal.getsignal(hang_up) is signal.SIG_IGN:
        return None
    parent = os.getppid()
    return parent if parent > 1 else None
