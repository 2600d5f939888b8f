"""A session in memory: frozen dataclasses around NumPy arrays, one row a frame.

Arrays are dense. A value that was not observed has a mask that is False and holds 0.0: never read a value
without its mask.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Floats, Integers, Mask
from ..board import Board
from ..camera import Camera
from ..marker import Marker
from ..mirror import Mirror
from ..robot import Robot
from ..short_repr import ShortRepr

UNKNOWN_FRAME = "unknown"
"""The `[points] frame` of a fixed frame whose pose is estimated along with the rest."""


@dataclass(frozen=True)
class Noise:
    """What is known of the measurement's noise, one axis, standard deviation; None where nothing is known."""

    pixel_std_px: float | None = None
    point_std_m: float | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Frames(ShortRepr):
    """The frames table: one row a captured picture, in the order in which the robot executed them."""

    frame: Integers
    """(F,), unique, rising."""
    posture: Integers
    """(F,): frames that share it have the same commanded body posture, seen from another viewpoint."""
    joint_names: tuple[str, ...]
    """The joints with a column, in the table's order; every other joint stays at 0."""
    commanded: Floats
    """(F, joints), rad (m for a prismatic joint)."""
    measured_names: tuple[str, ...] = ()
    """The joints with an encoder column `measured:<joint>`."""
    measured: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    """(F, measured joints), rad (m for a prismatic joint)."""
    time_s: Floats | None = None
    """(F,) seconds since the session's start, or None."""
    image: tuple[str | None, ...] | None = None
    """Paths of the pictures relative to the folder; None for the whole table or for a frame without one."""
    ordered: bool = True
    """False: the rows are not in the order of execution, so no direction of arrival is known."""
    accelerometer_links: tuple[str, ...] = ()
    """The links with columns `accelerometer:<link>:x`, `:y`, `:z`."""
    accelerometer_m_per_s2: Floats = field(default_factory=lambda: np.zeros((0, 0, 3)))
    """(F, accelerometer links, 3): specific force at rest in the link's frame (it points up), m/s²."""
    accelerometer_read: Mask = field(default_factory=lambda: np.zeros((0, 0), dtype=bool))
    """(F, accelerometer links): whether there is a reading."""

    def __len__(self) -> int:
        return len(self.frame)


@dataclass(frozen=True, eq=False, repr=False)
class Views(ShortRepr):
    """Image points of one way of seeing (in the mirror, or directly), px; pixel (0, 0) is the top-left pixel's centre."""

    board_px: Floats
    """(F, corners, 2)."""
    board_seen: Mask
    """(F, corners)."""
    marker_px: Floats
    """(F, markers, 2), in the order of `Session.markers`."""
    marker_seen: Mask
    """(F, markers)."""
    board_std_px: Floats | None = None
    """(F, corners): standard deviations, one axis, where the detector gave them."""
    marker_std_px: Floats | None = None
    """(F, markers)."""

    @classmethod
    def empty(cls, frames: int, corners: int, markers: int) -> Views:
        """Views in which nothing is seen."""
        return cls(
            np.zeros((frames, corners, 2)),
            np.zeros((frames, corners), dtype=bool),
            np.zeros((frames, markers, 2)),
            np.zeros((frames, markers), dtype=bool),
        )

    @property
    def claimed_board_px(self) -> float | None:
        """The median of the corners' standard deviations; None where the detector gave none."""
        return _claimed_px(self.board_std_px)

    @property
    def claimed_marker_px(self) -> float | None:
        """The same of the markers'."""
        return _claimed_px(self.marker_std_px)

    @property
    def any_seen(self) -> bool:
        """Whether there is a point at all."""
        return bool(self.board_seen.any() or self.marker_seen.any())


def _claimed_px(std_px: Floats | None) -> float | None:
    given = np.zeros(0) if std_px is None else std_px[std_px > 0.0]
    return float(np.median(given)) if len(given) else None


@dataclass(frozen=True, eq=False, repr=False)
class Points(ShortRepr):
    """Marker positions that something else measured."""

    frame_link: str
    """Link in whose frame the positions are given, or `"unknown"`."""
    point_m: Floats
    """(F, markers, 3)."""
    seen: Mask
    """(F, markers)."""


@dataclass(frozen=True, eq=False, repr=False)
class States(ShortRepr):
    """A denser log of the joints than the pictures (states.csv)."""

    time_s: Floats
    """(S,), rising."""
    joint_names: tuple[str, ...]
    commanded: Floats
    """(S, joints), rad (m for a prismatic joint)."""
    measured_names: tuple[str, ...] = ()
    measured: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    """(S, measured joints), rad (m for a prismatic joint)."""


@dataclass(frozen=True, eq=False, repr=False)
class Session(ShortRepr):
    """A robot model, a camera, and the observations while the robot held a sequence of postures."""

    folder: Path
    robot_file: Path
    """The file of the nominal model, a URDF."""
    robot: Robot
    """The nominal model, read from `robot_file`."""
    root_link: str
    gravity_m_per_s2: Floats
    """(3,), in the root link's frame."""
    frames: Frames
    markers: tuple[Marker, ...]
    mirror_view: Views
    """What was seen in the mirror."""
    direct_view: Views
    """What was seen without it."""
    camera: Camera | None = None
    camera_link: str | None = None
    board: Board | None = None
    mirror: Mirror | None = None
    noise: Noise = Noise()
    points: Points | None = None
    states: States | None = None
    camera_tolerance_m: float | None = None
    """One standard deviation by which the camera's real place may differ from the URDF's; 0: exact; None:
    not stated."""
    camera_tolerance_rad: float | None = None
    detected: bool = True
    """False: there is no detections table yet, only pictures."""
    metadata: Mapping[str, Any] = field(default_factory=dict)
    """session.toml as it was read, keys that the format does not know included."""
    warnings: tuple[str, ...] = ()
    """What is odd and was kept: unknown keys and columns, times that fall."""

    @property
    def marker_names(self) -> tuple[str, ...]:
        """Names of the markers, in the order of the arrays' marker axis."""
        return tuple(marker.name for marker in self.markers)

    @cached_property
    def positions(self) -> Floats:
        """The commanded postures as the robot takes them: (F, nq) in the order of `robot.position_names`, rad (m).

        Joints without a column stay at 0; those that follow another joint (mimic) are left to it.
        """
        frames = self.frames
        by_joint = {
            name: frames.commanded[:, index]
            for index, name in enumerate(frames.joint_names)
            if name in self.robot.position_names
        }
        q = self.robot.positions(by_joint)
        return np.broadcast_to(q, (len(frames), q.shape[1])) if len(q) != len(frames) else q

    @property
    def image_files(self) -> tuple[Path | None, ...]:
        """The picture of each frame, or None."""
        if self.frames.image is None:
            return (None,) * len(self.frames)
        return tuple(None if name is None else self.folder / name for name in self.frames.image)
