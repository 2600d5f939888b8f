"""One motion of servos: goals are sent, everything is monitored while it lasts, until all joints rest."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

from .errors import HardwareFaultError, LostRobotError, NotSettledError
from .servo_config import Servo, ServoConfig
from .servo_drive import Reading, ServoDrive

WATCHDOG_S = 0.5
"""While the robot moves: servos that hear nothing for so long stop by themselves. A cut line then ends the motion."""
LEAD_S = 0.3
"""Servos without a watchdog get goals so far ahead and no farther: a cut line ends their motion as well."""
POLL_S = 0.02
STILL_READS = 3
"""So many reads in a row at rest, near the goal, are rest."""
BLOCKED_READS = 25
"""After this many reads at rest elsewhere the joint does not arrive."""
PATIENCE_S = 2.0
"""Beyond the time that the motion should take."""
TOO_FAST = 2.0
"""A joint that turns faster than its limit by this factor is stopped; a servo's own reading may be a third
too high."""


class ServoMotion:
    """Moves a drive's servos, which must have torque within their limits; torque and state are `ServoRobot`'s to decide."""

    def __init__(self, drive: ServoDrive, config: ServoConfig, name: str) -> None:
        self._drive, self._config, self._name = drive, config, name
        self._servos: dict[str, Servo] = {servo.joint: servo for servo in config.servos}

    def measured_rad(self, reading: Reading) -> dict[str, float]:
        """Where each joint is."""
        return {j: s.position_rad(reading.position[s.servo_id]) for j, s in self._servos.items()}

    def goal(self, positions: Mapping[str, float]) -> dict[int, int]:
        """Counts by servo."""
        return {s.servo_id: s.counts(positions[joint]) for joint, s in self._servos.items()}

    def run(
        self,
        goal: dict[int, int],
        positions: Mapping[str, float],
        reading: Reading,
        go_on: Callable[[], None],
    ) -> Reading:
        """Sends the goal and waits until all joints rest, there or elsewhere; `go_on` raises to abort it.

        Raises:
            NotSettledError: a joint that still moves long after it should have arrived.
            RobotError: a servo that fails, does not answer or is too fast.
        """
        drive, speed = self._drive, self._config.speed_rad_per_s
        farthest = max(abs(positions[j] - q) for j, q in self.measured_rad(reading).items())
        ramp_s = speed / self._config.acceleration_rad_per_s2
        deadline = time.monotonic() + farthest / speed + ramp_s + PATIENCE_S
        sent = self._send(reading, goal)
        still = 0
        while True:
            time.sleep(POLL_S)
            go_on()
            reading = drive.read()
            self._check(reading)
            there = all(sent[i] == goal[i] == reading.goal[i] for i in goal)
            quiet = all(abs(v) <= drive.still_units for v in reading.speed.values())
            still = still + 1 if quiet else 0
            arrived = there and not self._astray(reading, positions)
            if still >= (STILL_READS if arrived else BLOCKED_READS):
                return reading
            if time.monotonic() > deadline:
                moving = tuple(
                    j for j, s in self._servos.items() if abs(reading.speed[s.servo_id]) > drive.still_units
                )
                raise NotSettledError(
                    f"{self._name}: {', '.join(moving) or 'a joint'} still moved long after it should have arrived",
                    joints=moving,
                )
            if not there:
                # On the way, or an unacknowledged write was lost.
                sent = self._send(reading, goal)

    def check_arrived(self, reading: Reading, positions: Mapping[str, float]) -> None:
        """Raises `NotSettledError` for joints that rest elsewhere."""
        measured = self.measured_rad(reading)
        if off := self._astray(reading, positions):
            told = ", ".join(f"{j} at {measured[j]:.4f} rad instead of {positions[j]:.4f}" for j in off)
            raise NotSettledError(
                f"{self._name}: {told}: blocked, too weak for its torque limit, or the goal was lost",
                joints=off,
            )

    def _send(self, reading: Reading, goal: dict[int, int]) -> dict[int, int]:
        """Sends goals: the last ones to servos that would stop by themselves, to others a little ahead of where they are."""
        sent = dict(goal)
        if self._drive.watchdog is None:
            speed = self._config.speed_rad_per_s
            lead_rad = speed * (LEAD_S + 0.5 * speed / self._config.acceleration_rad_per_s2)
            for servo in self._config.servos:
                here, lead = reading.position[servo.servo_id], abs(servo.counts(lead_rad) - servo.counts(0.0))
                sent[servo.servo_id] = min(max(goal[servo.servo_id], here - lead), here + lead)
        self._drive.line.write_all(self._drive.goal, sent)
        return sent

    def _astray(self, reading: Reading, positions: Mapping[str, float]) -> tuple[str, ...]:
        tolerance = self._config.tolerance_rad
        return tuple(j for j, q in self.measured_rad(reading).items() if abs(q - positions[j]) > tolerance)

    def _check(self, reading: Reading) -> None:
        self._drive.check(reading, torque=True)
        for joint, servo in self._servos.items():
            i = servo.servo_id
            if reading.watchdog.get(i) == self._drive.watchdog_bitten:
                raise LostRobotError(
                    f"{self._name}: {joint} (servo {i}) heard nothing for {WATCHDOG_S:g} s and stopped by itself"
                )
            speed = abs(reading.speed[i]) * self._drive.speed_unit_of(i)
            if speed > TOO_FAST * self._config.speed_rad_per_s + 4.0 * self._drive.speed_unit_of(i):
                raise HardwareFaultError(
                    f"{self._name}: {joint} (servo {i}) turns at {speed:.2f} rad/s, and its limit is "
                    f"{self._config.speed_rad_per_s:g} rad/s"
                )
