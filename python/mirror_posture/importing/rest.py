"""Moments of rest, and the offset between the joints' clock and the pictures'."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from .._core import MirrorPostureError
from ..arrays import Floats
from .recording import JointLog, Picture

SMALL_WIDTH_PX = 160
"""Width to which pictures are shrunk to see whether anything moves: averages away the sensor's noise."""
STEP_S = 0.02
"""Step of the offsets that are tried."""
LEAST_MATCH = 0.5
"""Correlation of the two clocks' movement below which they do not determine the offset."""
RIVAL_MATCH, NEAR = 0.08, 15
"""Offsets whose correlation is lower by less may be right as well; a peak is the highest within this many
steps either way."""
ABOVE_NOISE = 1.5
"""What a picture changes by up to this times the noise is no movement."""
FINE_S = 0.001
"""Step of the offsets that are tried around the best of the coarse ones."""


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

    @property
    def trusted(self) -> bool:
        """Whether the pictures' movement determines the offset."""
        return self.match >= LEAST_MATCH


def find_rests(log: JointLog, *, tolerance: float = 0.003, least_s: float = 0.5) -> list[Rest]:
    """The moments of at least `least_s` in which every joint stays within `tolerance` (rad or m), none twice.

    A rest is grown from its first row on while the range of every joint, over the rest so far, stays within the tolerance:
    a slow creep ends it as a quick move does.

    Raises:
        MirrorPostureError: a tolerance or a duration that is not positive.
    """
    if not (np.isfinite(tolerance) and tolerance > 0.0 and np.isfinite(least_s) and least_s > 0.0):
        raise MirrorPostureError(
            f"rest: got tolerance {tolerance!r} and {least_s!r} s, needed numbers above 0"
        )
    positions = log.position if log.measured is None else np.hstack([log.position, log.measured])
    rests = []
    start = 0
    lowest, highest = positions[0].copy(), positions[0].copy()
    for row in range(1, len(positions) + 1):
        if row < len(positions):
            low, high = np.minimum(lowest, positions[row]), np.maximum(highest, positions[row])
            if ((high - low) <= tolerance).all():
                lowest, highest = low, high
                continue
        if log.time_s[row - 1] - log.time_s[start] >= least_s:
            rests.append(Rest(float(log.time_s[start]), float(log.time_s[row - 1])))
            start = min(row, len(positions) - 1)
        else:
            # The move's own rows: the rest may begin at any of them.
            start += 1
            while start < row and not _within(positions[start : row + 1], tolerance):
                start += 1
        if row < len(positions):
            span = positions[start : row + 1]
            lowest, highest = span.min(axis=0), span.max(axis=0)
    return rests


def _within(span: Floats, tolerance: float) -> bool:
    return bool((np.ptp(span, axis=0) <= tolerance).all())


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
    """
    times, seen = np.asarray(picture_s, dtype=float), np.asarray(motion, dtype=float)
    if len(times) < 10 or seen.max(initial=0.0) <= 0.0:
        return ClockMatch(0.0, 0.0)
    # The noise of a still picture is the level of the lower half; its square adds to that of the movement.
    level = np.median(np.sort(seen[1:])[: max(1, len(seen) // 4)])
    changed = np.sqrt(np.maximum(seen[1:] ** 2 - (ABOVE_NOISE * level) ** 2, 0.0))
    usual_s = float(np.median(np.diff(times)))
    # Between two moments as far apart as two pictures mostly are, from each at which the joints' speed may change.
    started = np.unique(np.concatenate([log.time_s, log.time_s - usual_s]))
    started = started[(started >= log.time_s[0]) & (started <= log.time_s[-1] - usual_s)]
    if usual_s <= 0.0 or not len(started):
        return ClockMatch(0.0, 0.0)
    gone = _farthest(_positions(log, started + usual_s) - _positions(log, started))
    most_changed, most_gone = _usual_size(changed, 1), _usual_size(gone, 2)
    if most_changed <= 0.0 or most_gone <= 0.0:
        return ClockMatch(0.0, 0.0)
    moves, gone = np.minimum(changed, most_changed), np.minimum(gone, most_gone)

    def score(offset: float, exact: bool) -> float:
        at = times - offset
        inside = (at[:-1] >= log.time_s[0]) & (at[1:] <= log.time_s[-1])
        if inside.sum() < max(10, len(at) // 2):
            return -1.0
        if exact:
            joints = np.minimum(_farthest(np.diff(_positions(log, at), axis=0)), most_gone)[inside]
        else:
            joints = np.interp(at[:-1][inside], started, gone)
        here = moves[inside]
        if joints.std() <= 0.0 or here.std() <= 0.0:
            return -1.0
        return float(np.corrcoef(joints, here)[0, 1])

    offsets = np.arange(-round(most_s / STEP_S), round(most_s / STEP_S) + 1) * STEP_S
    scores = np.array([score(offset, False) for offset in offsets])
    best = float(scores.max())
    if best <= 0.0:
        return ClockMatch(0.0, 0.0)
    # Moves in an even beat match at every whole beat: of offsets that match about as well the nearest to 0 is meant.
    peaks = [
        index
        for index in range(len(offsets))
        if scores[index] >= best - RIVAL_MATCH
        and scores[index] >= scores[max(0, index - NEAR) : index + NEAR + 1].max() - 1e-9
    ]
    chosen = float(offsets[min(peaks, key=lambda index: abs(float(offsets[index])))])
    count = round(STEP_S / FINE_S)
    near = chosen + np.arange(-count, count + 1) * FINE_S
    exact = np.array([score(offset, True) for offset in near])
    good = near[exact >= exact.max() - 1e-6]
    return ClockMatch(float(0.5 * (good[0] + good[-1])), float(exact.max()))


def _positions(log: JointLog, at: Floats) -> Floats:
    return np.stack([np.interp(at, log.time_s, column) for column in log.position.T], axis=1)


def _farthest(moved: Floats) -> Floats:
    distance: Floats = np.abs(moved).max(axis=1)
    return distance


def _usual_size(moved: Floats, power: int) -> float:
    """The median of what moved, each weighted by a power of itself: rests, however many, hardly count, and by a low power nor does a lamp
    that is switched."""
    ordered = np.sort(moved)
    share = np.cumsum(ordered**power)
    return float(ordered[np.searchsorted(share, 0.5 * share[-1])]) if share[-1] > 0.0 else 0.0
