"""Robots that can be commanded, with one small protocol: command joint positions, look, rest, close.

`CommandedRobot` is the protocol, `RobotBase` the base class of a new robot; `TurnsView` is for robots that
can turn in front of their mirror. `Nominal` is the session of a robot.
"""

from .base import RobotBase
from .errors import (
    ClosedRobotError,
    HardwareFaultError,
    LostRobotError,
    NoLookError,
    NotSettledError,
    RobotError,
    UnsafeCommandError,
)
from .interruption import Interrupted, ending_signals
from .nominal import Nominal, detect_look
from .protocol import (
    Arrival,
    CommandedRobot,
    ImagePoints,
    JointLimits,
    Look,
    MarkerPoints,
    Positions,
    TurnsView,
    check_command,
)

__all__ = [
    "Arrival",
    "ClosedRobotError",
    "CommandedRobot",
    "HardwareFaultError",
    "ImagePoints",
    "Interrupted",
    "JointLimits",
    "Look",
    "LostRobotError",
    "MarkerPoints",
    "NoLookError",
    "Nominal",
    "NotSettledError",
    "Positions",
    "RobotBase",
    "RobotError",
    "TurnsView",
    "UnsafeCommandError",
    "check_command",
    "detect_look",
    "ending_signals",
]
