"""The common part of all commanded robots: checks of arguments, the last command, rest and close at the
end."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Mapping
from types import MappingProxyType, TracebackType
from typing import TypeVar

from .errors import ClosedRobotError, RobotError
from .interruption import handle_ending_signals, let_signals_end
from .nominal import Nominal
from .protocol import Arrival, JointLimits, Look, Positions, check_command

Self = TypeVar("Self", bound="RobotBase")


class RobotBase(ABC):
    """A `CommandedRobot` except for how it moves, looks and rests, which a subclass defines in `_move`,
    `_look`, `_rest`.

    `limits` narrows the URDF's; joints that it does not name cannot be commanded. None: all joints, the
    URDF's limits. `start` are the joint positions before the first command (0, or the nearest limit, by
    default).
    """

    def __init__(
        self,
        nominal: Nominal,
        *,
        name: str,
        limits: Mapping[str, JointLimits] | None = None,
        start: Positions | None = None,
    ) -> None:
        self._nominal, self._name = nominal, name
        self._limits = _checked_limits(nominal, limits, name)
        start = start or {}
        at_zero = {joint: min(max(0.0, x.lower), x.upper) for joint, x in self._limits.items()}
        self._commanded = at_zero | check_command(start, self._limits, name)
        self._opened_s = time.monotonic()
        self._closed = self._entered = False

    # The part that a new robot defines.

    @abstractmethod
    def _move(self, positions: dict[str, float]) -> Positions:
        """Brings every joint to its position (all of `joint_names`, checked) and returns at rest, with the encoders' readings.

        An empty mapping where there are no encoders.
        """

    @abstractmethod
    def _look(self) -> Look:
        """One look; `commanded` is `self.commanded`, `time_s` is `self._now_s()`."""

    @abstractmethod
    def _rest(self) -> None:
        """Brings the robot into its safe state."""

    def _close(self) -> None:
        """Releases its resources; nothing by default."""
        return

    # What the world sees: `CommandedRobot`.

    @property
    def name(self) -> str:
        """Its name for messages."""
        return self._name

    @property
    def nominal(self) -> Nominal:
        """The session that it belongs to."""
        return self._nominal

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints that can be commanded."""
        return tuple(self._limits)

    @property
    def limits(self) -> Mapping[str, JointLimits]:
        """The limits of each of `joint_names`."""
        return MappingProxyType(self._limits)

    @property
    def commanded(self) -> Positions:
        """The last command of each of `joint_names`."""
        return dict(self._commanded)

    def command(self, positions: Positions) -> Arrival:
        """Moves the named joints and returns at rest; see `CommandedRobot.command`."""
        self._check_open()
        goal = self._commanded | check_command(positions, self._limits, self._name)
        before_s = self._now_s()
        # Kept before it is sent: after a failure under way the joints are nearer to it than to the last command.
        self._commanded = goal
        measured = self._move(dict(goal))
        return Arrival(dict(goal), dict(measured), self._now_s() - before_s)

    def look(self) -> Look:
        """Looks into the mirror, without moving."""
        self._check_open()
        return self._look()

    def rest(self) -> None:
        """Goes to its safe state; nothing to do once closed."""
        if not self._closed:
            self._rest()

    def close(self) -> None:
        """Lets go of lines, windows and files."""
        if not self._closed:
            self._closed = True
            self._close()

    def __enter__(self: Self) -> Self:
        # A polite kill ends the block as Ctrl-C does: at rest.
        self._entered = handle_ending_signals()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        try:
            self.rest()
        except RobotError as failed:
            # The first error is raised; a failure to come to rest is added to it.
            if error is None:
                raise
            if hasattr(error, "add_note"):
                error.add_note(f"it could not be brought to rest either: {failed}")
        finally:
            self.close()
            if self._entered:
                self._entered = False
                let_signals_end()

    # Helpers of subclasses.

    def _now_s(self) -> float:
        """Seconds since it was opened; a simulated robot has its own time."""
        return time.monotonic() - self._opened_s

    def _check_open(self) -> None:
        if self._closed:
            raise ClosedRobotError(f"{self._name}: was closed; open it again")


def _checked_limits(
    nominal: Nominal, limits: Mapping[str, JointLimits] | None, name: str
) -> dict[str, JointLimits]:
    of_model = nominal.joint_limits
    if limits is None:
        return dict(of_model)
    checked = {}
    for joint, limit in limits.items():
        if joint not in of_model:
            raise RobotError(
                f"{name}: limits of {joint!r}, which is no joint of {nominal.robot_file.name}; its joints: {', '.join(of_model)}"
            )
        lower, upper = max(limit.lower, of_model[joint].lower), min(limit.upper, of_model[joint].upper)
        if not lower <= upper:
            raise RobotError(
                f"{name}: limits of joint {joint!r} are {limit.lower:.6g} to {limit.upper:.6g}, and the URDF's "
                f"{of_model[joint].lower:.6g} to {of_model[joint].upper:.6g}: nothing is left"
            )
        checked[joint] = JointLimits(lower, upper)
    return checked
