"""A moving session as arrays: the joints' log, and the moment at which each marker was seen in each picture.

A picture's `time_s` is when the exposure of its first row begins. Row v of H is exposed `readout_s · v / H` later, and what it
shows is, to second order, the body in the middle of the exposure:

    t(v) = time_s + exposure_s / 2 + readout_s · v / H
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mirror_posture import MirrorPostureError
from mirror_posture.arrays import Floats
from mirror_posture.session import Session
from mirror_posture.session.types import States
from mirror_posture.short_repr import ShortRepr

LEAST_FRAMES, LEAST_SECONDS = 60, 3.0
"""Fewer than these give no information on a motion."""


@dataclass(frozen=True, eq=False, repr=False)
class Recording(ShortRepr):
    """A moving session; times are the log's, s."""

    session: Session
    states: States
    marker_time_s: Floats
    """(F, markers): the moment at which each marker was seen in the picture; of one that was not seen, that
    of the middle row."""
    board_time_s: Floats
    """(F,)."""

    def commands(self, joints: tuple[str, ...], time_s: Floats) -> Floats:
        """Commanded positions (T, joints) at times (T,): straight between two rows of the log, 0 without a column."""
        out = np.zeros((len(time_s), len(joints)))
        for column, name in enumerate(joints):
            if name in self.states.joint_names:
                values = self.states.commanded[:, self.states.joint_names.index(name)]
                out[:, column] = np.interp(time_s, self.states.time_s, values)
        return out


def recording_of(session: Session) -> Recording:
    """The session in motion as arrays.

    Raises:
        MirrorPostureError: no log, no times, no camera and board, or too short.
    """
    states, time_s = session.states, session.frames.time_s
    if states is None or time_s is None:
        raise MirrorPostureError(
            f"{session.folder}: is no moving session; needed a log of the joints (states.csv) and time_s in frames.csv"
        )
    if session.camera is None or session.board is None or session.camera_link is None:
        raise MirrorPostureError(f"{session.folder}: has no camera and board; a motion is seen in the mirror")
    seen = session.mirror_view.board_seen.all(axis=1) & session.mirror_view.marker_seen.any(axis=1)
    length_s = float(time_s.max() - time_s.min()) if len(time_s) else 0.0
    if int(seen.sum()) < LEAST_FRAMES or length_s < LEAST_SECONDS:
        raise MirrorPostureError(
            f"{session.folder}: got {int(seen.sum())} pictures with board and marker in {length_s:.1f} s, needed at least "
            f"{LEAST_FRAMES} in {LEAST_SECONDS:g} s of motion"
        )
    exposure_s, readout_s = shutter(session.metadata)
    height = session.camera.height_px
    view = session.mirror_view
    row = np.where(view.marker_seen, view.marker_px[:, :, 1], height / 2.0)
    weight = view.board_seen.sum(axis=1)
    board_row = np.where(view.board_seen, view.board_px[:, :, 1], 0.0).sum(axis=1) / np.maximum(weight, 1)
    start = np.asarray(time_s, float) + 0.5 * exposure_s
    return Recording(
        session, states, start[:, None] + readout_s * row / height, start + readout_s * board_row / height
    )


def shutter(metadata: Mapping[str, Any]) -> tuple[float, float]:
    """`exposure_s` and `readout_s` (first to last row) of `[shutter]` in session.toml; 0 where it is silent.

    Raises:
        MirrorPostureError: an invalid number.
    """
    section = metadata.get("shutter", {})
    told = []
    for name in ("exposure_s", "readout_s"):
        value = section.get(name, 0.0) if isinstance(section, Mapping) else None
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0.0 <= float(value) < 0.5:
            raise MirrorPostureError(
                f"session.toml: [shutter] {name}: got {value!r}, needed seconds from 0 to 0.5"
            )
        told.append(float(value))
    return told[0], told[1]
