"""Errors of commanded robots; each says what was given, what was required and the fix."""

from __future__ import annotations

from .._core import MirrorPostureError
from ..error_pickling import PickledWhole


class RobotError(PickledWhole, MirrorPostureError):
    """A robot that did not do what was requested."""


class UnsafeCommandError(RobotError):
    """A command that was refused before anything moved: an unknown joint, a position beyond its limits, no number.

    `joint` and `position` name the first offender.
    """

    def __init__(self, message: str, *, joint: str, position: float | None = None) -> None:
        super().__init__(message)
        self.joint = joint
        self.position = position


class NotSettledError(RobotError):
    """The robot did not come to rest in time, or a joint's own encoder says that it did not go where it was sent."""

    def __init__(self, message: str, *, joints: tuple[str, ...] = ()) -> None:
        super().__init__(message)
        self.joints = joints


class NoLookError(RobotError):
    """No picture or measurement arrived; the robot still answers, and may be asked again."""


class HardwareFaultError(RobotError):
    """The robot reports a fault (overload, heat, voltage); torque has been switched off."""


class LostRobotError(RobotError):
    """The robot cannot be reached any more: a cut line, a window that was closed. The state of its joints
    is unknown."""


class ClosedRobotError(RobotError):
    """The robot was closed and cannot be used any more."""
