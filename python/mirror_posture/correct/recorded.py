"""Reads a recorded correction: its settings, its looks, and their measurements."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from .._core import MirrorPostureError
from ..input_files import LARGEST_TABLE, given_text, read_text, reason
from ..robots.nominal import Nominal, detect_look
from ..robots.protocol import ImagePoints, Look, MarkerPoints
from ..session.types import Session
from ..viewpoint import View
from .observation import Readings
from .turned import without_turned

HEADER, READINGS = "correction.json", "readings.jsonl"
PROPOSED, TURNING = "proposed", "turning"
"""The header's keys of the proposed views, and of the joints that turn the robot before its mirror."""


@dataclass(frozen=True)
class PastReading:
    """What one look of an earlier run measured."""

    posture: int
    readings: Readings


@dataclass(frozen=True)
class Past:
    """What an earlier run recorded."""

    looks: tuple[Look, ...] = ()
    postures: tuple[int, ...] = ()
    readings: tuple[PastReading, ...] = ()


@dataclass(frozen=True)
class Proposed:
    """The views that were proposed. A correction that is gone on with keeps them: they rest on all that was known of the robot when it began."""

    count: int
    """How many were wanted."""
    views: tuple[View, ...]

    def answers(self, count: int, kept: Sequence[View]) -> bool:
        """Whether the same was asked: as many views, after these."""
        return self.count == count and self.views[: len(kept)] == tuple(kept)


def read_proposed(header: Mapping[str, Any], file: Path) -> Proposed | None:
    """The proposed views of a header; None where it has none. Raises `MirrorPostureError` for what are no views."""
    tree = header.get(PROPOSED)
    if tree is None:
        return None
    try:
        views = tuple(View(*(float(number) for number in one)) for one in tree["views"])
        if not np.isfinite([(view.yaw_rad, view.pitch_rad, view.distance_m) for view in views]).all():
            raise ValueError("got a number that is not finite")
        return Proposed(int(tree["count"]), views)
    except (ValueError, LookupError, TypeError, OverflowError) as error:
        raise MirrorPostureError(
            f"{file}: {PROPOSED}: got what are no views ({' '.join(str(error).split())}); take the key away to have them proposed again"
        ) from None


def read_header(folder: Path) -> dict[str, Any]:
    """What a recording was started with. Raises `MirrorPostureError` for a folder without one."""
    try:
        header = json.loads(read_text(folder / HEADER))
    except (OSError, ValueError, RecursionError) as error:
        raise MirrorPostureError(
            f"{folder}: holds no correction that could be gone on with ({reason(error)}); start it without --resume"
        ) from None
    joints = header.get("joints") if isinstance(header, dict) else None
    if not isinstance(joints, list) or not all(isinstance(name, str) for name in joints):
        raise MirrorPostureError(f"{folder / HEADER}: joints: got {joints!r:.80}, needed a list of names")
    turning = header.get(TURNING, [])
    if not isinstance(turning, list) or not all(isinstance(name, str) for name in turning):
        raise MirrorPostureError(f"{folder / HEADER}: {TURNING}: got {turning!r:.80}, needed a list of names")
    return dict(header)


def recorded_looks(session: Session, nominal: Nominal, turning: Collection[str] = ()) -> list[Look]:
    """The recorded looks; those with a picture and no image points are detected (again). `turning` are the joints that turn the robot."""
    frames, view = session.frames, session.mirror_view
    looks = []
    for row in range(len(frames)):
        look = Look(
            commanded=dict(zip(frames.joint_names, frames.commanded[row].tolist(), strict=True)),
            time_s=0.0 if frames.time_s is None else float(frames.time_s[row]),
            measured=dict(zip(frames.measured_names, frames.measured[row].tolist(), strict=True))
            if frames.measured_names
            else {},
        )
        picture = session.image_files[row]
        seen = bool(view.board_seen[row].any() or view.marker_seen[row].any())
        # The last frame's points may be incomplete: they are detected again from its picture.
        if picture is not None and (not seen or row == len(frames) - 1):
            from ..detect import read_picture

            look = replace(
                detect_look(nominal, replace(look, picture_bgr=read_picture(picture))), picture_bgr=None
            )
        elif session.points is not None and session.points.seen[row].any():
            given = session.points
            look = replace(
                look, marker_points=MarkerPoints(given.frame_link, given.point_m[row], given.seen[row])
            )
        else:
            points = ImagePoints(
                view.board_px[row],
                view.board_seen[row],
                view.marker_px[row],
                view.marker_seen[row],
                None if view.board_std_px is None else view.board_std_px[row],
                None if view.marker_std_px is None else view.marker_std_px[row],
            )
            look = replace(look, points=points)
        # What is detected again is recorded as it was at first.
        looks.append(without_turned(nominal, turning, look))
    return looks


def read_readings(file: Path) -> list[PastReading]:
    """What each look measured; empty where none did. Raises `MirrorPostureError` with the line that is no reading."""
    if not file.is_file():
        return []
    lines = given_text(file, "the readings of a correction", LARGEST_TABLE).splitlines()
    return [_reading(file, number, line) for number, line in enumerate(lines, start=1)]


def _reading(file: Path, number: int, line: str) -> PastReading:
    try:
        tree = json.loads(line)
        readings = Readings(
            np.array(tree["measured"], dtype=bool),
            np.array(tree["point_in_board_m"], dtype=float).reshape(-1, 3),
            np.array(tree["covariance_m2"], dtype=float).reshape(-1, 3, 3),
            np.array(tree["chi_squared"], dtype=float),
            np.array(tree["degrees_of_freedom"], dtype=np.int64),
            tuple(tree["reasons"]),
        )
        columns = (
            readings.measured, readings.point_in_board_m, readings.covariance_m2, readings.chi_squared,
            readings.degrees_of_freedom, readings.reasons,
        )  # fmt: skip
        if len({len(column) for column in columns}) != 1 or readings.measured.ndim != 1:
            raise ValueError("its lists are of different lengths")
        if not all(np.isfinite(column).all() for column in columns[1:4]):
            raise ValueError("got a number that is not finite")
        return PastReading(int(tree["posture"]), readings)
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError, OverflowError) as error:
        raise MirrorPostureError(
            f"{file}, line {number}: is no reading ({' '.join(str(error).split())}); take the file away to measure again"
        ) from None
