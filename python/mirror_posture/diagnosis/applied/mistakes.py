"""Undoes gross mistakes of model or log in a session: what can be written, and where; and what to do
instead."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...rotations import rotation_of_vector
from ...session import Session
from ..parts import Cause
from ..vocabulary import BESIDE, MISTAKES, remedy
from .urdf import Urdf

BY_HAND_ONLY = tuple(name for name in MISTAKES if BESIDE[name]["written_to"] == "nothing")
"""Mistakes that no file of a model can hold."""
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
        better = _columns(session, {first: second, second: first})
        return (
            better,
            FRAMES,
            f"columns {first} and {second} exchanged; if it is the cables, exchange them instead",
        )
    if cause.effect == "joint_unit":
        # Degrees in place of radians leave lengths as they are.
        turning = {joint.name for joint in session.robot.joints if joint.kind != "prismatic"}
        better = _scaled(session, turning if cause.at == "robot" else {name}, value["factor"])
        what = "columns of all joints that turn" if cause.at == "robot" else f"column {name}"
        return better, FRAMES, f"{what} multiplied by {value['factor']:.9g}"
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


def _columns(session: Session, instead: dict[str, str]) -> Session:
    """The session with columns taken from others; a joint without a column stays at 0."""
    frames = session.frames
    commanded = frames.commanded.copy()
    names = list(frames.joint_names)
    for joint, source in instead.items():
        if joint in names:
            commanded[:, names.index(joint)] = (
                frames.commanded[:, names.index(source)] if source in names else 0.0
            )
    return replace(session, frames=replace(frames, commanded=commanded))


def _scaled(session: Session, joints: set[str], factor: float) -> Session:
    frames = session.frames
    scale = np.array([factor if name in joints else 1.0 for name in frames.joint_names])
    return replace(session, frames=replace(frames, commanded=frames.commanded * scale))
