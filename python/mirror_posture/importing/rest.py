"""Moments of rest, and the offset between the joints' clock and the pictures'."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from .. import _core
from ..arrays import Floats
from .recording import JointLog, Picture

SMALL_WIDTH_PX = 160
"""Width to which pictures are shrunk to see whether anything moves: averages away the sensor's noise."""


@dataclass(frozen=True)
class Rest:
    """A moment in which no joint moved: from and to, s of the joints' clock."""

    start_s: float
    end_s: float


@dataclass(frozen=True)
class ClockMatch:
    """Picture time = joint time + `offset_s`; `match` is the correlation of both movements (1: the same)."""

    offset_s: float
    match: float
    trusted: bool
    """Whether the pictures' movement determines the offset."""


def find_rests(log: JointLog, *, tolerance: float = 0.003, least_s: float = 0.5) -> list[Rest]:
    """The moments of at least `least_s` in which every joint stays within `tolerance` (rad or m), none twice.

    A rest is grown from its first row on while the range of every joint, over the rest so far, stays within the tolerance:
    a slow creep ends it as a quick move does.

    Raises:
        MirrorPostureError: a tolerance or a duration that is not positive.
    """
    positions = log.position if log.measured is None else np.hstack([log.position, log.measured])
    ends_s = _core.find_rests(log.time_s, positions, tolerance, least_s)
    return [Rest(start, end) for start, end in ends_s.tolist()]


def picture_motion(pictures: Iterable[tuple[float, Picture]]) -> tuple[Floats, Floats]:
    """Times (N,) and how much each picture differs from the one before (N,), grey levels, RMS of a small copy."""
    times, motion, before = [], [], None
    for time, picture in pictures:
        height = max(1, round(SMALL_WIDTH_PX * picture.shape[0] / picture.shape[1]))
        small = cv2.resize(picture, (SMALL_WIDTH_PX, height), interpolation=cv2.INTER_AREA).astype(np.float32)
        motion.append(0.0 if before is None else float(np.sqrt(np.mean((small - before) ** 2))))
        times.append(time)
        before = small
    return np.array(times), np.array(motion)


def match_clocks(
    log: JointLog, picture_s: npt.ArrayLike, motion: npt.ArrayLike, *, most_s: float = 5.0
) -> ClockMatch:
    """The offset at which the pictures move when the joints do.

    What changes between two pictures is correlated with how far the joints go between the same two moments, for offsets
    up to `most_s` either way. Both are cut off at the size of a usual move: a joint near the camera changes a picture
    more than one far away. An interval in which a move begins or ends shows a part of it, and so the offset is found to
    a third of the time between two pictures at worst (of 19 in 20 recordings to an eighth), where several moves are seen.

    Raises:
        MirrorPostureError: numbers that are not finite, or of which there is not one a picture.
    """
    return ClockMatch(*_core.match_clocks(log.time_s, log.position, picture_s, motion, most_s))
