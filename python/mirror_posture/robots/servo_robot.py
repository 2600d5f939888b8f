"""A robot of servos, of any make: limits before torque, limits before every motion, and an end that reports
its state.

`unpowered → holding ⇄ moving`, and `stopped` from everywhere (`servo_state`). The properties of a make are
in its `ServoDrive`.
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

from ..formats.servo_keys import Make
from .base import RobotBase
from .errors import LostRobotError, RobotError
from .interruption import handle_ending_signals, let_signals_end, undisturbed
from .nominal import Nominal
from .protocol import ImagePoints, Look, Positions
from .servo_config import Servo, ServoConfig, load_config
from .servo_drive import Identity, ServoDrive
from .servo_ending import ServoEnding
from .servo_motion import WATCHDOG_S, ServoMotion
from .servo_state import Standing, State, StateMachine, Torque

log = logging.getLogger(__name__)

Eye = Callable[[], "npt.NDArray[np.uint8] | ImagePoints"]
"""Takes a picture (BGR) when called, or returns its detections."""

STANDING_WATCHDOG_S = 2.5
"""While holding. A computer that is busy for a second is no fault of a robot that stands still."""
KEEP_S = 0.5
"""While holding, the state of all servos is requested this often."""


class ServoRobot(RobotBase):
    """A robot of servos. Use it as a context: at its end it rests, with the torque off, or held if the file
    says so.

    At opening every servo is queried and verified, torque is switched off, the limits of torque and speed
    are written and read back, and only then is torque switched on, at the place where each joint stands.
    Before every motion, and while it lasts, all of that is read again. Any failure during a motion, a
    signal, Ctrl-C, or a lost parent process ends the motion and the torque (or holds, as configured);
    `standing` says which, and the robot has to be opened again.
    """

    make: Make
    drive: Callable[[ServoConfig], ServoDrive]
    """What its make of servos is like."""

    def __init__(
        self,
        nominal: Nominal,
        config: ServoConfig | str | os.PathLike[str],
        eye: Eye,
        *,
        name: str | None = None,
    ) -> None:
        name = name or self.make
        if not isinstance(config, ServoConfig):
            config = load_config(config, nominal, self.make)
        self.config = config
        self._eye = eye
        self._servos: dict[str, Servo] = {servo.joint: servo for servo in config.servos}
        super().__init__(nominal, name=name, limits={joint: s.limits for joint, s in self._servos.items()})
        self._machine = StateMachine(name)
        self._powered = False
        self._lock = threading.RLock()
        self._process, self._parent = os.getpid(), _parent(config)
        self._drive = self.drive(config)
        self._motion = ServoMotion(self._drive, config, name)
        self._ending = ServoEnding(self._drive, config, name)
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

    # The public interface.

    @property
    def standing(self) -> Standing:
        """State, torque and the reason of the last change."""
        return self._machine.now

    @property
    def identities(self) -> dict[str, Identity]:
        """Model and firmware of each joint's servo."""
        return {joint: self._drive.identities[s.servo_id] for joint, s in self._servos.items()}

    # From opening to torque.

    def _power(self) -> None:
        drive = self._drive
        drive.prepare()
        reading = drive.read()
        drive.check(reading, torque=False)
        self._powered = True
        for servo_id in drive.ids:
            # At the present position, so that switching torque on moves nothing.
            drive.line.write(servo_id, drive.goal, reading.position[servo_id])
            drive.line.write(servo_id, drive.torque, 1)
        drive.watch(STANDING_WATCHDOG_S)
        drive.check(drive.read(), torque=True)
        self._machine.to(State.HOLDING, Torque.HELD, "opened, every limit read back")
        self._commanded = {
            j: min(max(q, self.limits[j].lower), self.limits[j].upper)
            for j, q in self._motion.measured_rad(reading).items()
        }

    # The methods that `RobotBase` requires.

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
                    measured = self._motion.measured_rad(reading)
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
        goal = self._motion.goal(positions)
        # Out of a sleep, too: one that has bitten while the robot stood takes goals again only after 0.
        drive.watch(0.0)
        drive.watch(WATCHDOG_S)
        self._machine.to(State.MOVING, Torque.HELD, "a command")
        reading = self._motion.run(goal, positions, reading, self._check_parent)
        drive.watch(STANDING_WATCHDOG_S)
        self._machine.to(State.HOLDING, Torque.HELD, "arrived")
        self._motion.check_arrived(reading, positions)
        return self._motion.measured_rad(reading)

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
        # A forked child that ends must not act on its parent's robot.
        if os.getpid() != self._process:
            return
        if self._machine.now.state in (State.HOLDING, State.MOVING):
            self._end(None, "the program ended without closing the robot")
            log.warning("%s: %s", self.name, self._machine.now.sentence)
        self._drive.line.close()

    def _end(self, why: BaseException | None, reason: str = "at rest") -> None:
        """Ends motion, and torque unless it is to be held, and verifies it; `standing` and the log say
        which.

        Raises `LostRobotError` if there is no answer any more; it is added to `why`, which is then raised.
        """
        if os.getpid() != self._process:
            return
        with undisturbed(), self._lock:
            if self._machine.now.state is State.STOPPED:
                return
            cause = reason if why is None else f"{type(why).__name__}: {why}".rstrip(": ")
            torque, note = self._ending.take_off(self._machine.now.state, self._powered)
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
        """Once more for a line that may be back; that it was lost was reported already."""
        with undisturbed():
            torque, _ = self._ending.take_off(self._machine.now.state, self._powered, 0.0)
        if torque is not Torque.UNKNOWN:
            self._machine.to(State.STOPPED, torque, f"{self._machine.now.why}; since then the line came back")
            log.warning("%s: %s", self.name, self._machine.now.sentence)


def _parent(config: ServoConfig) -> int | None:
    """The process whose end ends this one's motion; None: there is none, or a program that was meant to
    outlive it (nohup)."""
    hang_up = getattr(signal, "SIGHUP", None)
    if not config.end_with_parent or hang_up is None or signal.getsignal(hang_up) is signal.SIG_IGN:
        return None
    parent = os.getppid()
    return parent if parent > 1 else None
