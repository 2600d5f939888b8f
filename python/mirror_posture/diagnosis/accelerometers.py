"""Accelerometers that the fit never saw, as witnesses: which way is up on a link, against what the causes predict there.

At rest an accelerometer reads `−g` in its own frame. The nominal model says where that points at the commanded posture; the
model with the named causes says where it points in the posture in which the links really stand:

    u = −R_linkᵀ R_root g / |g|,   R = (∏ A_k E_k A_kᵀ) A,   over the joints k from the root to the link

with `A_k` the rotation of what joint k carries, by the URDF at the commanded posture, and `E_k = Rot(axis, δ_k) Exp(ω_k)` its
named error in this frame: δ the error of its position, ω the bending of the link that it carries. Tilted axes and wrong
zeros are written into the URDF first. Figures: RMS of the angle between reading and prediction, once as read, and once
with the sensor's own mounting rotation taken out (Wahba's problem over all frames, by SVD; G. Wahba, "A least squares
estimate of satellite attitude", SIAM Review 7, 1965).

What no accelerometer sees: a turn about the vertical, lengths and shifts, camera, board and mirror. A link that bends is
taken as bent in its middle, and the sensor as beyond it. What no cause explains (the free-form errors) is left out, on
purpose: the witness judges what was named.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..robot import Robot
from ..rotations import rotation_of_vector
from ..session import Session
from .applied.apply import parts_of
from .applied.urdf import Urdf
from .applied.xml_text import read_xml
from .result import Diagnosis

Floats = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

IN_URDF = ("axis_tilt", "joint_offset")
"""Effects that a URDF can say and that turn links. In this order: an offset turns about the real axis."""
LENGTH_OFF = 0.05
"""A median length that differs from |g| by this share is more than a sensor's scale: a wrong unit, most likely."""
FEWEST_FOR_MOUNT = 4
"""Frames: with fewer, the mounting's three angles can take up most of what two directions each say."""
POINTS_DOWN = 0.5
"""Readings that fit turned over so many times better than as they are point down."""


@dataclass(frozen=True)
class AccelerometerWitnesses:
    """One entry for each accelerometer, as `accelerometer_witness` of diagnosis.json has it, and what is odd."""

    entries: tuple[dict[str, Any], ...]
    warnings: tuple[str, ...]


def accelerometer_witness(session: Session, found: Diagnosis) -> AccelerometerWitnesses:
    """What each accelerometer of a session says of a diagnosis that did not see it.

    An entry has `link`, `named` (whether a named cause turns the link against the root), `frames`, `before_rad`,
    `after_rad`, `before_mount_free_rad`, `after_mount_free_rad` (None with fewer than 4 frames), and
    `median_m_per_s2`, the readings' median length. Frames in which a cause's error is not known, since no marker
    beyond it was seen, count neither before nor after.
    """
    frames = session.frames
    gravity = session.gravity_m_per_s2
    strength = float(np.linalg.norm(gravity))
    entries: list[dict[str, Any]] = []
    warnings: list[str] = []
    if not frames.accelerometer_links:
        return AccelerometerWitnesses((), ())
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
            warnings.append(f"accelerometer on {link}: {why}; it is no witness")
            continue
        force = frames.accelerometer_m_per_s2[rows, k]
        length = np.linalg.norm(force, axis=1)
        up = force / length[:, None]
        before = _up(session.robot, session, link, rows, None)
        after = _up(errors.robot, session, link, rows, errors)
        median = float(np.median(length))
        if abs(median / strength - 1.0) > LENGTH_OFF:
            warnings.append(
                f"accelerometer on {link}: reads {median:.4g} m/s² at rest (median), and gravity is {strength:.4g} m/s²: "
                "is it in another unit (g instead of m/s²)?"
            )
        enough = len(rows) >= FEWEST_FOR_MOUNT
        mount_free = _rms_angle(_mounted(before, up), up)
        if enough and _rms_angle(_mounted(before, -up), -up) < POINTS_DOWN * mount_free:
            warnings.append(
                f"accelerometer on {link}: its readings fit when turned over; needed the specific force, "
                "which points up at rest: turn the sign of all three columns"
            )
        entries.append(
            {
                "link": link,
                "named": named,
                "frames": len(rows),
                "before_rad": _rms_angle(before, up),
                "after_rad": _rms_angle(after, up),
                "before_mount_free_rad": mount_free if enough else None,
                "after_mount_free_rad": _rms_angle(_mounted(after, up), up) if enough else None,
                "median_m_per_s2": median,
            }
        )
    return AccelerometerWitnesses(tuple(entries), tuple(warnings))


@dataclass(frozen=True)
class _Errors:
    """What the named causes say of the joints: in the URDF, and frame by frame (NaN where a frame does not show it)."""

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
            # What the URDF says already does not count twice; what no cause explains does not count.
            if signature.cause is None or found.causes[signature.cause].effect in IN_URDF:
                continue
            if joint in turning:
                by_frame = _by_frame(session, signature.frame, signature.fitted)
                turn[joint] = turn.get(joint, 0.0) + by_frame
        for track in found.tracks:
            link = track.at.removeprefix("link:")
            if track.cause is not None and track.what == "turn" and link in joint_of_link:
                by_frame = _by_frame(session, track.frame, track.fitted)
                bend[joint_of_link[link]] = bend.get(joint_of_link[link], 0.0) + by_frame
        robot = Robot.from_urdf_text(urdf.text()) if corrected else session.robot
        return cls(robot, frozenset(corrected), turn, bend)

    def on_the_way(self, root_link: str, link: str) -> tuple[Mask, bool]:
        """(F,) whether each error between two links is known; and whether there is one at all."""
        path = {step.joint for step in self.robot.chain(root_link, link)}
        values = [v for joint, v in self.turn_rad.items() if joint in path]
        values += [v.sum(axis=1) for joint, v in self.bend_rad.items() if joint in path]
        known: Mask = np.logical_and.reduce([np.isfinite(v) for v in values]) if values else np.array(True)
        return known, bool(values) or bool(self.in_urdf & path)

    def rotation(self, joint: str, axis: Floats, rows: npt.NDArray[np.int64]) -> Floats | None:
        """`E`: (N, 3, 3), or None for a joint without an error."""
        turn, bend = self.turn_rad.get(joint), self.bend_rad.get(joint)
        if turn is None and bend is None:
            return None
        out = np.broadcast_to(np.eye(3), (len(rows), 3, 3))
        if turn is not None:
            out = out @ rotation_of_vector(turn[rows, None] * axis)
        return out if bend is None else out @ rotation_of_vector(bend[rows])


def _by_frame(session: Session, frame: npt.NDArray[np.int64], values: Floats) -> Floats:
    """Values of some frames for all frames: those of a posture share what one of them has; NaN where none has."""
    row_of = {int(number): row for row, number in enumerate(session.frames.frame)}
    rows = np.array([row_of[int(number)] for number in frame], dtype=int)
    postures, index = np.unique(session.frames.posture, return_inverse=True)
    by_posture = np.full((len(postures), *values.shape[1:]), np.nan)
    by_posture[index[rows]] = values
    return by_posture[index]


def _up(
    robot: Robot, session: Session, link: str, rows: npt.NDArray[np.int64], errors: _Errors | None
) -> Floats:
    """(N, 3): the direction of −g in a link's frame."""
    steps = robot.chain(session.root_link, link)
    ways = {
        session.root_link: [step.joint for step in steps if step.sign < 0][::-1],
        link: [step.joint for step in steps if step.sign > 0],
    }
    joints = {joint.name: joint for joint in robot.joints}
    q = session.positions[rows]

    def base_from(of: str) -> Floats:
        rotation = robot.link_poses(q, [of])[:, 0, :3, :3]
        for name in reversed(ways[of] if errors is not None else []):
            turn = errors.rotation(name, joints[name].axis, rows) if errors is not None else None
            if turn is not None:
                carried = robot.link_poses(q, [joints[name].child_link])[:, 0, :3, :3]
                rotation = carried @ turn @ carried.transpose(0, 2, 1) @ rotation
        return rotation

    gravity = session.gravity_m_per_s2 / np.linalg.norm(session.gravity_m_per_s2)
    down = base_from(session.root_link) @ gravity
    result: Floats = -np.einsum("nji,nj->ni", base_from(link), down)
    return result


def _mounted(predicted: Floats, read: Floats) -> Floats:
    """The predictions turned by the one rotation that brings them closest to the readings."""
    left, _, right = np.linalg.svd(read.T @ predicted)
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(left) * np.linalg.det(right))])
    turned: Floats = predicted @ ((left * sign) @ right).T
    return turned


def _rms_angle(a: Floats, b: Floats) -> float:
    """RMS angle between unit vectors, rad."""
    angle = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.einsum("ni,ni->n", a, b))
    return float(np.sqrt(np.mean(angle**2)))
