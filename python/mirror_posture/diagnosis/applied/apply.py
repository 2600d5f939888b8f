"""Writes the causes back: a corrected session folder, and a table of what was written where."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..._core import MirrorPostureError
from ...rotations import pose_of
from ...session import Session
from ...session.write import replace_folder, write_session_files
from .. import formatting
from ..fingerprint import require_same
from ..parts import Cause, Estimate
from ..result import Diagnosis
from .mistakes import undo_mistake
from .mjcf import MECHANICAL, NOT_WRITTEN, write_mjcf
from .urdf import TURNING, Urdf
from .xml_text import read_xml

ROBOT, MJCF = "robot.urdf", "robot.mjcf.xml"
NOT_IN_A_MODEL = {
    "gear_eccentricity": "neither URDF nor MJCF has a periodic transmission error; add s sin q + c (cos q - 1) to the reading",
    "transmission_error": "no file of a model has a joint's error along its turn; add it to the reading (`members` in diagnosis.json)",
    "joint_coupling": "neither a URDF nor an actuator of MJCF adds a share of another command; mend the wiring of the command",
    "drift": "an error that grows with time belongs into no model; home the joint, or warm up before use",
    "column_bending": "no file has a beam that grows as it slides out; stiffen the column's guides, or model it as flexible",
    "tilt_play_1": "no file has play across a sliding joint; preload or shim the guide",
    "tilt_play_2": "no file has play across a sliding joint; preload or shim the guide",
    "transverse_compliance": "no file format has a guide that yields across its axis; stiffen it, or the ground on which the robot stands",
    "marker_image": "an error of the detector, not of a model; detect the markers again, or subtract du_px + du_by_u (u - cx) + du_by_v (v - cy) from their u, and the same for v",
    "mirror_curvature": "the session format knows flat mirrors only; use a flatter mirror",
    "geometry": "this diagnosis contains the spread of the small errors, not each of them; diagnose again",
    "pairing": "a fault of the data: correct the rows of the frames table",
}
"""Why an effect cannot be written, and what to do instead."""
FIRST = {"axis_sign": 0, "link_twist": 1, "axis_tilt": 2, "board_mount": 2}
"""Effects on whose places others depend, in the order in which they are written."""


@dataclass(frozen=True)
class Written:
    """A cause and where it was written; `file` is None where it could not be written, and `what` then says
    why."""

    cause: Cause
    file: str | None
    what: str


@dataclass(frozen=True)
class Applied:
    """The corrected session's folder, and what was written where."""

    folder: Path
    written: tuple[Written, ...]


def apply_diagnosis(
    session: Session,
    found: Diagnosis,
    folder: str | os.PathLike[str],
    *,
    overwrite: bool = False,
    also: Callable[[Path], object] | None = None,
) -> Applied:
    """Writes a session whose model contains the causes of a diagnosis.

    The robot's origins and axes, the camera's intrinsics, the board's squares and the mirror's glass are
    corrected. For play, friction, springs and gear ratios, which a URDF cannot represent, an MJCF is
    written as well (it needs the extra `mujoco`). The observations are not changed, so that the folder can
    be diagnosed again. `also` is called with the folder before it takes its place, to write further files
    into it; if it raises an error nothing is written at all.

    Raises:
        MirrorPostureError: a diagnosis of another session, a place that the session does not have, an existing folder.
    """
    require_same(session, dict(found.document))
    if found.interrupted:
        raise MirrorPostureError(
            "got a diagnosis that was interrupted, needed a complete one: alternatives were not compared; diagnose again"
        )
    urdf = Urdf(read_xml(session.robot_file), str(session.robot_file))
    better = session
    # Of a group's small errors each is written like a separate cause. An offset turns about the real axis, so
    # tilts are written first, and before them twists, which are across the modelled axis; so is the board, relative to
    # which the camera is given.
    parts = [(index, part) for index, cause in enumerate(found.causes) for part in parts_of(cause)]
    entries: dict[int, list[Written]] = {index: [] for index in range(len(found.causes))}
    for index, part in sorted(parts, key=lambda entry: FIRST.get(entry[1].effect, 3)):
        better, entry = _apply(better, urdf, part)
        entries[index].append(entry)
    mechanical = together(
        entry.cause for parts_written in entries.values() for entry in parts_written if entry.file == MJCF
    )
    told: dict[tuple[str, str], str] = {}

    def fill(part: Path) -> None:
        write_session_files(better, part)
        # As bytes: line ends stay as they were.
        (part / ROBOT).write_bytes(urdf.text().encode("utf-8"))
        if mechanical:
            told.update(write_mjcf(better, urdf.text(), mechanical, part / MJCF))
        if also is not None:
            also(part)

    target = Path(folder)
    replace_folder(target, fill, overwrite, session.folder)

    def settled(entry: Written) -> Written:
        if entry.file != MJCF:
            return entry
        done = told.get((entry.cause.effect, entry.cause.at))
        missing = (
            "a URDF cannot represent it, and MuJoCo is not installed: pip install 'mirror-posture[mujoco]'"
        )
        is_there = done is not None and not done.startswith(NOT_WRITTEN)
        return replace(entry, file=MJCF if is_there else None, what=done or missing)

    written = []
    for index, cause in enumerate(found.causes):
        its = [settled(entry) for entry in entries[index]]
        written.append(_group_written(cause, its) if cause.members else its[0])
    return Applied(target, tuple(written))


def together(causes: Iterable[Cause]) -> list[Cause]:
    """Causes without duplicates: a spring that is a separate cause and one of the small errors at its joint
    are added."""
    sums: dict[tuple[str, str], Cause] = {}
    for cause in causes:
        first = sums.setdefault((cause.effect, cause.at), cause)
        if first is not cause:
            added = {
                name: replace(told, value=told.value + cause.parameters[name].value)
                for name, told in first.parameters.items()
            }
            sums[cause.effect, cause.at] = replace(first, parameters=added)
    return list(sums.values())


def parts_of(cause: Cause) -> list[Cause]:
    """The small errors of a group as causes, one a place and effect; any other cause is its own part."""
    if not cause.members:
        return [cause]
    values: dict[tuple[str, str], dict[str, Estimate]] = {}
    for member in cause.members:
        # A joint that was found stiff is left as it is.
        if member.effect in MECHANICAL and member.value <= 0.0:
            continue
        values.setdefault((member.effect, member.at), {})[member.parameter] = Estimate(
            member.value, member.std, member.slides
        )
    return [Cause(effect, at, cause.probability, told) for (effect, at), told in values.items()]


def _group_written(cause: Cause, parts: list[Written]) -> Written:
    """What became of a group, in one line."""
    counts: dict[str, int] = {}
    elsewhere: dict[str, str] = {}
    for part in parts:
        if part.file is not None:
            counts[part.cause.effect] = counts.get(part.cause.effect, 0) + 1
            if part.file != ROBOT:
                elsewhere[part.cause.effect] = f" in {part.file}"
    reasons: dict[str, list[str]] = {}
    for part in parts:
        if part.file is None:
            reasons.setdefault(part.what, []).append(formatting.place_in_words(part.cause.at))
    missing = [f"{', '.join(places)}: {why}" for why, places in reasons.items()]
    if not counts:
        return Written(cause, None, "; ".join(missing))
    told = ", ".join(
        f"{count} × {formatting.effect_in_words(effect)}{elsewhere.get(effect, '')}"
        for effect, count in counts.items()
    )
    return Written(cause, ROBOT, told + (f"; not written: {'; '.join(missing)}" if missing else ""))


def _apply(session: Session, urdf: Urdf, cause: Cause) -> tuple[Session, Written]:
    value = {name: estimate.value for name, estimate in cause.parameters.items()}
    kind, _, name = cause.at.partition(":")
    used = _used_links(session)

    def in_robot(what: str) -> tuple[Session, Written]:
        return session, Written(cause, ROBOT, what)

    def refused(why: str) -> tuple[Session, Written]:
        return session, Written(cause, None, why)

    def vector(stem: str, unit: str, letters: str = "xyz") -> np.ndarray:
        return np.array([value.get(f"{stem}{letter}_{unit}", 0.0) for letter in letters])

    undone = undo_mistake(session, urdf, cause)
    if undone is not None:
        mended, file, what = undone
        return mended, Written(cause, file, what)
    if cause.effect == "joint_offset":
        changed = urdf.add_offset(name, value["offset_rad"])
        done = "turned about" if urdf.kind(name) in TURNING else "moved along"
        return in_robot(f"origin of joint {', '.join(changed)}, {done} its axis")
    if cause.effect == "axis_tilt":
        urdf.tilt_axis(name, value["tilt_1_rad"], value["tilt_2_rad"])
        return in_robot(f"axis of joint {name}")
    if cause.effect == "link_length":
        moved = urdf.shift_carried(name, vector("d", "m"))
        if not moved:
            return refused(f"link {name} carries no moving joint")
        return in_robot(f"origin of joint {', '.join(moved)}")
    if cause.effect == "link_twist":
        turned = urdf.turn_carried(name, value["twist_1_rad"], value["twist_2_rad"])
        return (
            in_robot(f"origin (rpy) of joint {turned}")
            if turned
            else refused(f"link {name} carries no single moving joint")
        )
    if cause.effect == "joint_origin":
        urdf.shift_origin(name, vector("d", "m"))
        return in_robot(f"origin of joint {name}")
    if cause.effect == "marker_mount":
        link = next((marker.link for marker in session.markers if marker.name == name), name)
        mounts = urdf.shift_mount(link, vector("d", "m"), used)
        if mounts is None:
            return refused(f"link {link} has no fixed mount")
        return in_robot(_origins(mounts))
    motion = pose_of(vector("r", "rad"), vector("d", "m"))
    camera = session.camera_link
    if cause.effect == "board_mount" and session.board is not None:
        link = session.board.link
        motions = {link: motion}
        # A camera on the board's own body moves along: the camera against the board is another cause.
        link_from_camera = urdf.fixed_pose(link, camera) if camera and camera != link else None
        if camera and link_from_camera is not None:
            motions[camera] = np.linalg.inv(link_from_camera) @ motion @ link_from_camera
        mounts = urdf.move_mounts(motions, used)
        if mounts is None:
            return refused(f"link {link} or its camera has no fixed mount")
        return in_robot(_origins(mounts))
    if cause.effect == "camera_mount" and camera:
        mounts = urdf.move_mounts({camera: motion}, used)
        if mounts is None:
            return refused(f"link {camera} has no fixed mount")
        return in_robot(_origins(mounts))
    if kind == "camera" and session.camera is not None:
        return _apply_to_camera(session, cause, value)
    if cause.effect == "board_scale" and session.board is not None:
        factor, board = 1.0 + value["scale_error"], session.board
        size = board.marker_size_m
        better = replace(
            board, square_m=factor * board.square_m, marker_size_m=None if size is None else factor * size
        )
        what = f"board.square = {better.square_m:.8g} m"
        return replace(session, board=better), Written(cause, "session.toml", what)
    if cause.effect == "mirror_glass" and session.mirror is not None:
        thickness = max(0.0, value["thickness_m"])
        mirror = replace(session.mirror, glass_thickness_m=thickness)
        what = f"mirror.glass_thickness = {thickness:.6g} m"
        return replace(session, mirror=mirror), Written(cause, "session.toml", what)
    if cause.effect in MECHANICAL:
        return session, Written(cause, MJCF, "")
    return refused(NOT_IN_A_MODEL.get(cause.effect, "no file of a session holds it"))


def _used_links(session: Session) -> set[str]:
    """The links whose places the session's observations depend on."""
    links = {session.root_link, *session.frames.accelerometer_links}
    links |= {marker.link for marker in session.markers}
    links |= {link for link in (session.camera_link, session.board and session.board.link) if link}
    return links | ({session.points.frame_link} if session.points is not None else set())


def _origins(joints: list[str]) -> str:
    return f"origin of joint {', '.join(joints)}" if joints else "no origin: the motion is 0"


def _apply_to_camera(session: Session, cause: Cause, value: dict[str, float]) -> tuple[Session, Written]:
    camera = session.camera
    assert camera is not None
    if cause.effect == "camera_focal":
        factor = 1.0 + value["scale_error"]
        camera = replace(camera, focal_px=(factor * camera.fx_px, factor * camera.fy_px))
        what = f"fx = {camera.fx_px:.3f} px, fy = {camera.fy_px:.3f} px"
    elif cause.effect == "camera_center":
        camera = replace(camera, center_px=(camera.cx_px + value["du_px"], camera.cy_px + value["dv_px"]))
        what = f"cx = {camera.cx_px:.3f} px, cy = {camera.cy_px:.3f} px"
    elif cause.effect == "lens_distortion":
        k1, *others = camera.distortion or (0.0,) * 5
        coefficients = (k1 + value["dk1"], *others)
        model = "plumb_bob" if camera.distortion_model == "none" else camera.distortion_model
        camera = replace(camera, distortion_model=model, distortion=coefficients)
        what = f"k1 = {coefficients[0]:.6f}"
    else:
        return session, Written(
            cause, None, NOT_IN_A_MODEL.get(cause.effect, "no file of a session holds it")
        )
    return replace(session, camera=camera), Written(cause, "camera.yaml", what)


def rows_for_people(applied: Applied) -> list[tuple[str, str, str, str]]:
    """Rows of a table: cause, parameters, file, what was written or why not."""
    return [
        (
            f"{formatting.effect_in_words(entry.cause.effect)} at {formatting.place_in_words(entry.cause.at)}",
            "\n".join(map(str, formatting.tell_all(entry.cause))),
            entry.file or "not written",
            entry.what,
        )
        for entry in applied.written
    ]
