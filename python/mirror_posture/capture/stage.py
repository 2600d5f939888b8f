"""The stages of a capture, and when it takes a picture."""

from __future__ import annotations

import enum
from dataclasses import dataclass


class Stage(str, enum.Enum):
    """What the capture is doing."""

    WAITING = "waiting"
    """For the person to start it."""
    TURN_MIRROR = "turn_mirror"
    """Waits until the person has turned the mirror and confirms it."""
    COMMANDING = "commanding"
    """A robot's driver moves the robot."""
    MOVING = "moving"
    STILL = "still"
    """Everything is still; the picture is not good enough yet."""
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
    """Whether a person is present: to start, to turn the mirror. False: a folder or a film, without a page."""
