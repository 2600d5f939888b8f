"""Undoes gross mistakes of model or log in a session: what can be written, and where; and what to do
instead."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from ...rotations import rotation_of_vector
from ...session import Frames, Session
from ..parts import Cause
from ..vocabulary import BESIDE, MISTAKES, remedy
from .urdf import Urdf

BY_HAND_ONLY = tuple(name for name in MISTAKES if BESIDE[name]["written_to"] == "nothing")
"""Mistakes that no file of a model can hold."""
AGREES = (0.5, 2.0)
"""Slope of an encoder over its command where both are in one unit and of one joint."""
FRAMES, CAMERA, ROBOT, SETTINGS = "frames.csv", "camera.yaml", "robot.urdf", "session.toml"


def undo_mistake(session: Session, urdf: Urdf, cause: Cause) -> tuple[Session, str | None, str] | None:
    """Undoes a mistake: the corrected session, the file and what was written in it, or None and what to do
    instead.

    None where the cause is no mistake of this kind.
    """
    value = {name: estimate.value for name, estimate in cause.parameters.items()}
    name = cause.at.partition(":")[2]
    if cause.effect == "axis_sign":
        urdf.set_axis(name, -urdf.axis(name))
        return session, ROBOT, f"axis of joint {name}, turned round"
    if cause.effect == "joints_swapped":
        first, _, second = name.partition("<->joint:")
        better, also = _exchanged(session, first, second)
        what = f"columns {first} and {second} exchanged{also}; if it is the cables, exchange them instead"
        return better, FRAMES, what
    if cause.effect == "joint_unit":
        # Degrees in place of radians leave lengths as they are.
        turning = {joint.name for joint in session.robot.joints if joint.kind != "prismatic"}
        better, also = _scaled(session, turning if cause.at == "robot" else {name}, value["factor"])
        what = "columns of all joints that turn" if cause.at == "robot" else f"column {name}"
        return better, FRAMES, f"{what} multiplied by {value['factor']:.9g}{also}"
    if cause.effect == "camera_resolution" and session.camera is not None:
        camera, factor = session.camera, value["factor"]
        camera = replace(
            camera,
            focal_px=(factor * camera.fx_px, factor * camera.fy_px),
            center_px=(factor * camera.cx_px + value["du_px"], factor * camera.cy_px + value["dv_px"]),
        )
        return replace(session, camera=camera), CAMERA, f"focal lengths and centre times {factor:.6g}"
    if cause.effect == "gravity_direction":
        turn = rotation_of_vector(np.array([value[f"r{axis}_rad"] for axis in "xyz"]))
        gravity = turn @ session.gravity_m_per_s2
        told = ", ".join(f"{part:.3f}" for part in gravity)
        return replace(session, gravity_m_per_s2=gravity), SETTINGS, f"gravity = [{told}] m/s²"
    if cause.effect in BY_HAND_ONLY:
        return session, None, remedy(cause.effect)
    return None


def _exchanged(session: Session, first: str, second: str) -> tuple[Session, str]:
    """The session with two columns exchanged, and what else was; a joint without a column stays at 0."""
    frames = session.frames
    instead, names = {first: second, second: first}, list(frames.joint_names)
    commanded = frames.commanded.copy()
    for joint, source in instead.items():
        if joint in names:
            commanded[:, names.index(joint)] = (
                frames.commanded[:, names.index(source)] if source in names else 0.0
            )
    read = [name for name in frames.measured_names if name in instead]
    agree = _as_commanded(frames, read)
    # One of two columns cannot take the name that the other keeps.
    renamed = instead if agree == read else {}
    measured = tuple(renamed.get(name, name) for name in frames.measured_names)
    better = replace(frames, commanded=commanded, measured_names=measured)
    return replace(session, frames=better), _also(agree if renamed else [])


def _scaled(session: Session, joints: set[str], factor: float) -> tuple[Session, str]:
    """The session with scaled columns, and which `measured:` columns were."""
    frames = session.frames
    agree = _as_commanded(frames, [name for name in frames.measured_names if name in joints])

    def scale(names: Sequence[str], scaled: Collection[str]) -> np.ndarray:
        return np.array([factor if name in scaled else 1.0 for name in names])

    better = replace(
        frames,
        commanded=frames.commanded * scale(frames.joint_names, joints),
        measured=frames.measured * scale(frames.measured_names, agree),
    )
    return replace(session, frames=better), _also(agree)


def _as_commanded(frames: Frames, names: Sequence[str]) -> list[str]:
    """The joints whose encoders read what was commanded, in its unit, from a zero of their own: they share its mistake."""
    found = []
    for name in names:
        if name not in frames.joint_names:
            continue
        command = frames.commanded[:, frames.joint_names.index(name)]
        read = frames.measured[:, frames.measured_names.index(name)]
        c, m = command - command.mean(), read - read.mean()
        if c @ c > 0.0 and AGREES[0] < (c @ m) / (c @ c) < AGREES[1]:
            found.append(name)
    return found


def _also(names: Sequence[str]) -> str:
    return f", and {', '.join(f'measured:{name}' for name in names)}" if names else ""
