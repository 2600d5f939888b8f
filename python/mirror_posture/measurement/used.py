"""The data of a measurement: how much was given, how much was used, what was left out and why."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ..session import Session
    from .types import Measurement


@dataclass(frozen=True)
class LeftOut:
    """An observation that was not used; names as in diagnosis.json."""

    frame: int
    """Its number in frames.csv."""
    target: str
    """`board`, or a marker's name."""
    why: str


@dataclass(frozen=True)
class Used:
    """Counts of a measurement; what is given and not used stands in `left_out`, one entry each."""

    frames_given: int
    frames_used: int
    """Whose mirror is measured."""
    postures_given: int
    postures_used: int
    """In which any marker is measured."""
    points_given: int
    points_used: int
    """Images of markers, all frames."""
    markers_given: int
    markers_used: int
    """Positions: a marker of a posture each."""
    left_out: tuple[LeftOut, ...]

    @property
    def sentence(self) -> str:
        """The counts in words."""
        return (
            f"used: {self.frames_used} of {self.frames_given} frames, {self.postures_used} of {self.postures_given} postures, "
            f"{self.points_used} of {self.points_given} images of markers, for {self.markers_used} of {self.markers_given} positions"
        )


def used(session: Session, measurement: Measurement) -> Used:
    """The counts of a session's measurement."""
    frames, markers, mirrors = session.frames, measurement.markers, measurement.mirrors
    names = session.marker_names
    left_out = [
        LeftOut(int(frames.frame[row]), "board", reason)
        for row, reason in enumerate(mirrors.reason)
        if reason is not None
    ]
    reasons = {
        (int(posture), int(marker)): reason
        for posture, marker, reason in zip(markers.posture, markers.marker, markers.reason, strict=True)
    }
    given, taken = 0, 0
    for view, direct in ((session.mirror_view, False), (session.direct_view, True)):
        for row, marker in np.argwhere(view.marker_seen):
            given += 1
            if direct and measurement.estimator != "joint":
                why: str | None = "seen without the mirror: only the estimator joint uses it"
            elif mirrors.reason[row] is not None:
                why = "its frame has no mirror"
            else:
                why = reasons.get((int(frames.posture[row]), int(marker)), "not seen in two views")
            if why is None:
                taken += 1
            else:
                left_out.append(LeftOut(int(frames.frame[row]), names[marker], why))
    good = markers.measured
    return Used(
        len(frames),
        int(mirrors.measured.sum()),
        len(np.unique(frames.posture)),
        len(np.unique(markers.posture[good])),
        given,
        taken,
        len(markers),
        int(good.sum()),
        tuple(left_out),
    )
