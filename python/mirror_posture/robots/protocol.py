"""The interface of every robot that can be commanded: command, look, rest, close; some can turn in front of
the mirror.

Joint positions are rad (m for a prismatic joint), by joint name, always positive in the URDF's sense.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import TracebackType
from typing import TYPE_CHECKING, Protocol, TypeVar, runtime_checkable

import numpy as np
import numpy.typing as npt

from ..arrays import Floats, Mask
from ..short_repr import ShortRepr
from ..viewpoint import View
from .errors import UnsafeCommandError

if TYPE_CHECKING:
    from .nominal import Nominal

Positions = Mapping[str, float]
"""Joint positions by joint name, rad (m for a prismatic joint)."""

Self = TypeVar("Self", bound="CommandedRobot")

LIMIT_SLACK = 1e-9
"""rad (m): a command this far beyond a limit is the limit, rounded."""


@dataclass(frozen=True)
class JointLimits:
    """Between which positions a joint may be commanded, rad (m); infinite where there is no limit."""

    lower: float
    upper: float

    def holds(self, position: float) -> bool:
        """Whether the position is a number within the limits."""
        return math.isfinite(position) and self.lower - LIMIT_SLACK <= position <= self.upper + LIMIT_SLACK


@dataclass(frozen=True, eq=False, repr=False)
class ImagePoints(ShortRepr):
    """What one picture showed in the mirror, px; pixel (0, 0) is the centre of the top-left pixel.

    Masked rows hold 0. A marker's pixel is the centroid of its ball's whole outline, as detection gives it.
    """

    board_px: Floats
    """(corners, 2), in the session format's order."""
    board_seen: Mask
    """(corners,)."""
    marker_px: Floats
    """(markers, 2), in the order of the nominal session's markers."""
    marker_seen: Mask
    """(markers,)."""
    board_std_px: Floats | None = None
    """(corners,): standard deviations, one axis, where they are known."""
    marker_std_px: Floats | None = None
    """(markers,)."""
    reasons: tuple[str, ...] = ()
    """The reasons for missing observations: one line for the board or a marker each."""


@dataclass(frozen=True, eq=False, repr=False)
class MarkerPoints(ShortRepr):
    """Marker positions that something else than the mirror measured: motion capture, a probe, a simulator."""

    frame_link: str
    """The link in whose frame they are."""
    point_m: Floats
    """(markers, 3), in the order of the nominal session's markers; masked rows hold 0."""
    seen: Mask
    """(markers,)."""
    covariance_m2: Floats | None = None
    """(markers, 3, 3), in the same frame; None where it is not known."""


@dataclass(frozen=True, eq=False, repr=False)
class Look(ShortRepr):
    """One look of the robot at itself: a picture, or its detections, or marker points."""

    commanded: Positions
    """Where every joint had been commanded when the look was taken."""
    time_s: float
    """Seconds since the robot was opened."""
    measured: Positions = field(default_factory=dict)
    """What the joints' own encoders read, of those that have one."""
    view: View | None = None
    """The approximate pose of the mirror, if known. A hint: the mirror is measured in each look."""
    picture_bgr: npt.NDArray[np.uint8] | None = None
    """(height, width, 3)."""
    points: ImagePoints | None = None
    marker_points: MarkerPoints | None = None


@dataclass(frozen=True)
class Arrival:
    """Where a command ended."""

    commanded: Positions
    """All joints."""
    measured: Positions
    """What the joints' own encoders read at rest; empty without encoders."""
    duration_s: float
    """How long it took, in the robot's own time."""


class CommandedRobot(Protocol):
    """A robot that can be commanded.

    Use it as a context: at its end, however it comes, `rest` and `close` are called. All errors are
    `RobotError`s. `RobotBase` implements all of this for a robot that defines how it moves, looks and
    rests.
    """

    @property
    def name(self) -> str:
        """Its name for messages."""
        ...

    @property
    def nominal(self) -> Nominal:
        """The session that it belongs to: the model of robot, camera, board, markers and mirror."""
        ...

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints that can be commanded: joints of the nominal URDF that move by themselves."""
        ...

    @property
    def limits(self) -> Mapping[str, JointLimits]:
        """The limits of each of `joint_names`: the URDF's, or narrower ones."""
        ...

    @property
    def commanded(self) -> Positions:
        """The last command of each of `joint_names`."""
        ...

    def command(self, positions: Positions) -> Arrival:
        """Moves the named joints and returns when the robot rests; the other joints keep their command.

        Raises `UnsafeCommandError` before anything moves, `NotSettledError`, `HardwareFaultError`, `LostRobotError`.
        """
        ...

    def look(self) -> Look:
        """Looks into the mirror, without moving. Raises `NoLookError`, `LostRobotError`."""
        ...

    def rest(self) -> None:
        """Goes to its safe state: a safe posture, torque off. Safe to call again, at any time and after any error."""
        ...

    def close(self) -> None:
        """Lets go of lines, windows and files; safe to call again. Does not move: call `rest` before."""
        ...

    def __enter__(self: Self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None: ...


@runtime_checkable
class TurnsView(Protocol):
    """A robot whose mirror, stand or person can change the viewpoint; test with `isinstance(robot,
    TurnsView)`."""

    @property
    def view(self) -> View:
        """The approximate present pose of the mirror."""
        ...

    def turn(self, view: View) -> None:
        """Moves the mirror there, approximately, and returns when it is there; no joint moves. Raises
        `RobotError`."""
        ...


def check_command(positions: Positions, limits: Mapping[str, JointLimits], name: str) -> dict[str, float]:
    """The command as plain floats within the limits. Raises `UnsafeCommandError` that names joint, limit and fix."""
    checked = {}
    for joint, value in positions.items():
        if joint not in limits:
            raise UnsafeCommandError(
                f"{name}: has no joint {joint!r} to command; its joints: {', '.join(limits)}", joint=joint
            )
        try:
            position, limit = float(value), limits[joint]
        except (TypeError, ValueError):
            raise UnsafeCommandError(
                f"{name}: joint {joint!r} was sent to {value!r}, needed a number (rad, m); nothing was moved",
                joint=joint,
            ) from None
        if not limit.holds(position):
            raise UnsafeCommandError(
                f"{name}: joint {joint!r} was sent to {position:.6g}, needed a number from {limit.lower:.6g} to {limit.upper:.6g}; "
                "nothing was moved",
                joint=joint,
                position=position,
            )
        checked[joint] = min(max(position, limit.lower), limit.upper)
    return checked
