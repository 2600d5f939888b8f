"""Accelerometers as independent sensors: the upward direction on a link that they read, compared with the
diagnosis' prediction. No fit uses them.

The nominal model predicts that direction at the commanded posture. The model with the named causes predicts
it at the posture in which the links really are (`Robot::up_in_link` of the core); tilted axes and wrong
zeros are written into the URDF first. Figures: RMS of the angle between reading and prediction, once as
read, and once with the sensor's mounting rotation estimated (Wahba's problem over all frames).

An accelerometer cannot see a turn about the vertical, lengths and shifts, camera, board or mirror. A link
that bends is taken as bent in its middle, with the sensor beyond it. Free-form errors are left out on
purpose: the sensor tests the named causes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .._core import rms_angles
from ..arrays import Floats, Integers, Mask
from ..robot import Robot
from ..rotations import tilt_directions
from ..session import Session
from .applied.apply import parts_of
from .applied.urdf import Urdf
from .applied.xml_text import read_xml
from .result import Diagnosis

IN_URDF = ("link_twist", "axis_tilt", "joint_offset")
"""Effects that a URDF can represent and that turn links. In this order, because an offset turns about the
real axis."""
LENGTH_OFF = 0.05
"""A median length that differs from |g| by this share is more than a sensor's scale: a wrong unit, most likely."""
ACROSS = 2
"""Components of a turn that is told about the two directions across a joint's axis; others are in the link's frame."""
FEWEST_FOR_MOUNT = 4
"""Frames: with fewer, the mounting's three angles can absorb most of the two directions of each."""
POINTS_DOWN = 0.5
"""Readings that fit this many times better when inverted point down."""


@dataclass(frozen=True)
class AccelerometerWitnesses:
    """One entry for each accelerometer, as `accelerometer_witness` of diagnosis.json, and unusual findings."""

    entries: tuple[dict[str, Any], ...]
    warnings: tuple[str, ...]


def accelerometer_witness(session: Session, found: Diagnosis) -> AccelerometerWitnesses:
    """Compares each accelerometer of a session with a diagnosis that did not use it.

    An entry has `link`, `named` (whether a named cause turns the link relative to the root), `frames`,
    `before_rad`, `after_rad`, `before_mount_free_rad`, `after_mount_free_rad` (None with fewer than 4
    frames), and `median_m_per_s2`, the readings' median length. Frames in which a cause's error is unknown,
    because no marker beyond it was seen, are excluded from both.
    """
    frames = session.frames
    gravity = session.gravity_m_per_s2
    strength = float(np.linalg.norm(gravity))
    entries: list[dict[str, Any]] = []
    warnings: list[str] = []
    if strength == 0.0:
        told = "session.toml: gravity is zero; no accelerometer can be predicted"
        return AccelerometerWitnesses((), (told,))
    errors = _Errors.of(session, found)
    for k, link in enumerate(frames.accelerometer_links):
        read = frames.accelerometer_read[:, k]
        known, named = errors.on_the_way(session.root_link, link)
        rows = np.flatnonzero(read & known)
        if not len(rows):
            why = "no frame has a reading" if not read.any() else "no frame with a reading shows its causes"
            warnings.append(f"accelerometer on {link}: {why}; it is not used")
            continue
        force = frames.accelerometer_m_per_s2[rows, k]
        length = np.linalg.norm(force, axis=1)
        up = force / length[:, None]
        positions, where = session.positions[rows], (link, gravity, session.root_link)
        before = session.robot.core.up_in_link(positions, *where, [])
        after = errors.robot.core.up_in_link(positions, *where, errors.in_rows(rows))
        (before_rad, before_free_rad), (after_rad, after_free_rad) = (
            rms_angles(before, up),
            rms_angles(after, up),
        )
        median = float(np.median(length))
        if abs(median / strength - 1.0) > LENGTH_OFF:
            warnings.append(
                f"accelerometer on {link}: reads {median:.4g} m/s² at rest (median), and gravity is {strength:.4g} m/s²: "
                "is it in another unit (g instead of m/s²)?"
            )
        enough = len(rows) >= FEWEST_FOR_MOUNT
        if enough and rms_angles(before, -up)[1] < POINTS_DOWN * before_free_rad:
            warnings.append(
                f"accelerometer on {link}: its readings fit when turned over; needed the specific force, "
                "which points up at rest: turn the sign of all three columns"
            )
        entries.append(
            {
                "link": link,
                "named": named,
                "frames": len(rows),
                "before_rad": before_rad,
                "after_rad": after_rad,
                "before_mount_free_rad": before_free_rad if enough else None,
                "after_mount_free_rad": after_free_rad if enough else None,
                "median_m_per_s2": median,
            }
        )
    return AccelerometerWitnesses(tuple(entries), tuple(warnings))


@dataclass(frozen=True)
class _Errors:
    """The named causes' errors of the joints: in the URDF, and frame by frame (NaN where a frame does not
    show it)."""

    robot: Robot
    """With tilted axes and wrong zeros in it."""
    in_urdf: frozenset[str]
    """Joints that differ in it."""
    turn_rad: dict[str, Floats]
    """(F,) by joint: the error of its position."""
    bend_rad: dict[str, Floats]
    """(F, 3) by joint: the bending of the link that it carries, a rotation vector in its frame."""

    @classmethod
    def of(cls, session: Session, found: Diagnosis) -> _Errors:
        joint_of_link = {joint.child_link: joint.name for joint in session.robot.joints}
        turning = {joint.name for joint in session.robot.joints if joint.kind in ("revolute", "continuous")}
        urdf = Urdf(read_xml(session.robot_file))
        constant = [p for cause in found.causes for p in parts_of(cause) if p.effect in IN_URDF]
        corrected = set()
        for part in sorted(constant, key=lambda p: IN_URDF.index(p.effect)):
            joint = part.at.partition(":")[2]
            value = {name: estimate.value for name, estimate in part.parameters.items()}
            if part.effect == "link_twist":
                turned = urdf.turn_carried(
                    joint, value.get("twist_1_rad", 0.0), value.get("twist_2_rad", 0.0)
                )
                if turned is not None:
                    corrected.add(turned)
                continue
            if joint not in turning and joint in urdf.joints:
                continue
            if part.effect == "axis_tilt":
                urdf.tilt_axis(joint, value.get("tilt_1_rad", 0.0), value.get("tilt_2_rad", 0.0))
            else:
                urdf.add_offset(joint, value.get("offset_rad", 0.0))
            corrected.add(joint)
        turn: dict[str, Floats] = {}
        bend: dict[str, Floats] = {}
        for signature in found.signatures:
            joint = signature.at.split("<-")[0].removeprefix("joint:")
            # What is in the URDF already does not count twice; free-form errors do not count.
            if signature.cause is None or found.causes[signature.cause].effect in IN_URDF:
                continue
            if joint in turning:
                by_frame = _by_frame(session, signature.frame, signature.fitted)
                turn[joint] = turn.get(joint, 0.0) + by_frame
        for track in found.tracks:
            link = track.at.removeprefix("link:")
            if track.cause is None or found.causes[track.cause].effect in IN_URDF:
                continue
            if track.what == "turn" and link in joint_of_link:
                joint = joint_of_link[link]
                by_frame = _by_frame(session, track.frame, track.fitted)
                if len(track.components) == ACROSS:
                    by_frame = by_frame @ np.array(tilt_directions(urdf.axis(joint)))
                bend[joint] = bend.get(joint, 0.0) + by_frame
        robot = Robot.from_urdf_text(urdf.text()) if corrected else session.robot
        return cls(robot, frozenset(corrected), turn, bend)

    def on_the_way(self, root_link: str, link: str) -> tuple[Mask, bool]:
        """(F,) whether each error between two links is known; and whether there is one at all."""
        path = {step.joint for step in self.robot.chain(root_link, link)}
        values = [v for joint, v in self.turn_rad.items() if joint in path]
        values += [v.sum(axis=1) for joint, v in self.bend_rad.items() if joint in path]
        known: Mask = np.logical_and.reduce([np.isfinite(v) for v in values]) if values else np.array(True)
        return known, bool(values) or bool(self.in_urdf & path)

    def in_rows(self, rows: Integers) -> list[tuple[str, Floats, Floats]]:
        """Joint, error of its position (N,) and bending of its link (N, 3), of the joints that have one."""
        turn, bend = np.zeros(len(rows)), np.zeros((len(rows), 3))
        return [
            (
                joint,
                self.turn_rad[joint][rows] if joint in self.turn_rad else turn,
                self.bend_rad[joint][rows] if joint in self.bend_rad else bend,
            )
            for joint in self.turn_rad.keys() | self.bend_rad.keys()
        ]


def _by_frame(session: Session, frame: Integers, values: Floats) -> Floats:
    """Values of some frames for all frames: those of a posture share what one of them has; NaN where none has."""
    row_of = {int(number): row for row, number in enumerate(session.frames.frame)}
    rows = np.array([row_of[int(number)] for number in frame], dtype=int)
    postures, index = np.unique(session.frames.posture, return_inverse=True)
    by_posture = np.full((len(postures), *values.shape[1:]), np.nan)
    by_posture[index[rows]] = values
    return by_posture[index]
