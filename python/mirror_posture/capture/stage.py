"""The stages of a capture, and when it takes a picture."""

from __future__ import annotations

import enum
from dataclasses import dataclass


class Stage(str, enum.Enum):
    """What the capture is doing."""

    WAITING = "waiting"
    """For the person to start it."""
    TURN_MIRROR = "turn_mirror"
    """For the person to turn the mirror and say so."""
    COMMANDING = "commanding"
    """A robot's driver moves the robot."""
    MOVING = "moving"
    STILL = "still"
    """All stands still; what is in the picture is not good enough yet."""
    PAUSED = "paused"
    FINISHED = "finished"
    FAILED = "failed"


@dataclass(frozen=True)
class CaptureOptions:
    """When a picture is taken."""

    still_s: float = 0.8
    """For how long all must have stood still."""
    least_markers: int = 1
    """How many balls must be found in it."""
    ask: bool = True
    """Whether somebody is there to be asked: to start, to turn the mirror. False: a folder or a film, without a page."""
