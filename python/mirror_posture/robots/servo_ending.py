"""The end of servos' torque: held within limits where that is wanted and safe, otherwise off; and the
resulting state."""

from __future__ import annotations

import time

from .errors import HardwareFaultError, NotSettledError, RobotError
from .servo_config import ServoConfig
from .servo_drive import ServoDrive
from .servo_motion import LEAD_S, POLL_S, WATCHDOG_S
from .servo_state import State, Torque

OFF_PATIENCE_S = 2.0
"""So long it is tried to take the torque off: a servo whose power dipped takes a moment to listen again."""


class ServoEnding:
    """Ends a drive's torque; it changes no state."""

    def __init__(self, drive: ServoDrive, config: ServoConfig, name: str) -> None:
        self._drive, self._config, self._name = drive, config, name

    def take_off(self, state: State, powered: bool, patience_s: float = OFF_PATIENCE_S) -> tuple[Torque, str]:
        """Holds where that is wanted and safe, else takes the torque off; a note where it is otherwise than configured."""
        refused = ""
        if self._config.at_end == "hold" and state in (State.HOLDING, State.MOVING):
            try:
                self._hold(state)
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
            if not powered or time.monotonic() > tried_until:
                break
            time.sleep(POLL_S)
        if not powered:
            return Torque.UNKNOWN, f"torque was never put on from here ({failed})"
        stops = (
            f"stop by themselves after {WATCHDOG_S:g} s"
            if drive.watchdog is not None
            else f"go on for at most {LEAD_S + self._config.speed_rad_per_s / self._config.acceleration_rad_per_s2:.2g} s"
        )
        silent = self._silent()
        others = "; the others are without torque" if len(silent) < len(drive.ids) else ""
        return Torque.UNKNOWN, (
            f"torque could not be taken off ({failed}). No answer from {', '.join(silent) or 'some'}{others}. Servos under way {stops} "
            "and hold with limited torque: switch their power off"
        )

    def _silent(self) -> list[str]:
        """Joints whose servo does not confirm that its torque is off."""
        silent, until = [], time.monotonic() + OFF_PATIENCE_S
        for servo in self._config.servos:
            try:
                # A dead line is not waited for servo by servo.
                late = time.monotonic() > until
                if late or self._drive.line.read(servo.servo_id, self._drive.torque):
                    silent.append(f"{servo.joint} (servo {servo.servo_id})")
            except RobotError:
                silent.append(f"{servo.joint} (servo {servo.servo_id})")
        return silent

    def _hold(self, state: State) -> None:
        """Every goal is where its joint stands, within limits that are in force. Raises `RobotError`
        otherwise."""
        drive, until = self._drive, time.monotonic() + OFF_PATIENCE_S
        reading = drive.read()
        drive.check(reading, torque=True)
        if state is State.MOVING:
            drive.watch(0.0)
            drive.line.write_all(drive.goal, reading.position)
            while True:
                reading = drive.read()
                drive.check(reading, torque=True)
                if all(abs(v) <= drive.still_units for v in reading.speed.values()):
                    break
                if time.monotonic() > until:
                    raise NotSettledError(f"{self._name}: does not come to a halt")
                # To where it is by now: no way back at the end of a stop.
                drive.line.write_all(drive.goal, reading.position)
                time.sleep(POLL_S)
        drive.watch(0.0)
