"""Identifies the session of a diagnosis: a hash of the robot and of the commands."""

from __future__ import annotations

import hashlib

import numpy as np

from .._core import MirrorPostureError
from ..session import Session

KEY = "session"


def fingerprint(session: Session) -> dict[str, str]:
    """SHA-256 of the robot's file and of the frames with their commands.

    Image points are not included, because they may be detected again; nor are line ends, which differ
    between systems.
    """
    frames = session.frames
    commands = hashlib.sha256("\n".join(frames.joint_names).encode())
    for values in (frames.frame, frames.posture, frames.commanded):
        commands.update(np.ascontiguousarray(values).tobytes())
    robot = session.robot_file.read_bytes().replace(b"\r\n", b"\n")
    return {"robot_sha256": hashlib.sha256(robot).hexdigest(), "frames_sha256": commands.hexdigest()}


def require_same(session: Session, document: object) -> None:
    """Refuses a diagnosis that states another session; one that states none is accepted.

    Raises:
        MirrorPostureError: with what differs.
    """
    told = document.get(KEY) if isinstance(document, dict) else None
    if not isinstance(told, dict):
        return
    words = {"robot_sha256": "its robot.urdf", "frames_sha256": "its frames and commands"}
    differ = [words[key] for key, value in fingerprint(session).items() if told.get(key, value) != value]
    if differ:
        raise MirrorPostureError(
            f"{session.folder}: the diagnosis is of another session ({' and '.join(differ)} differ); apply it to the session "
            "that was diagnosed, or diagnose this one"
        )
