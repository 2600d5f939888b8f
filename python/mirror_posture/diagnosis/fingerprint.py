"""Identifies the session of a diagnosis: hashes of the robot, of the commands, and of the numbers of camera and setup."""

from __future__ import annotations

import hashlib

import numpy as np

from .._core import MirrorPostureError
from ..mirror import IDEAL_MIRROR
from ..session import Session

KEY = "session"


def fingerprint(session: Session) -> dict[str, str]:
    """SHA-256 of the robot's file, of the frames with their commands, and of what else a diagnosis corrects: the
    numbers of the camera, the board's squares, the mirror's glass and gravity.

    Image points are not included, because they may be detected again; nor are line ends, which differ
    between systems.
    """
    frames = session.frames
    commands = hashlib.sha256("\n".join(frames.joint_names).encode())
    for values in (frames.frame, frames.posture, frames.commanded):
        commands.update(np.ascontiguousarray(values).tobytes())
    robot = session.robot_file.read_bytes().replace(b"\r\n", b"\n")
    return {
        "robot_sha256": hashlib.sha256(robot).hexdigest(),
        "frames_sha256": commands.hexdigest(),
        "setup_sha256": hashlib.sha256(_setup(session).encode()).hexdigest(),
    }


def _setup(session: Session) -> str:
    """The numbers with nine digits and without the lens' last zeros: other spellings of a file are the same setup."""
    camera, board, mirror = session.camera, session.board, session.mirror or IDEAL_MIRROR
    told: list[object] = ["gravity", *session.gravity_m_per_s2, "glass", mirror.glass_thickness_m]
    # Of a front-surface mirror no index counts.
    told += [mirror.refractive_index] if mirror.glass_thickness_m else []
    if board is not None:
        told += ["board", board.square_m]
    if camera is not None:
        lens = list(camera.distortion)
        while lens and lens[-1] == 0.0:
            lens.pop()
        fisheye = camera.distortion_model == "equidistant"
        model = camera.distortion_model if lens or fisheye else "none"
        told += ["camera", *camera.size_px, *camera.focal_px, *camera.center_px, model, *lens]
    return " ".join(part if isinstance(part, str) else f"{float(part) + 0.0:.9g}" for part in told)  # type: ignore[arg-type]


def require_same(session: Session, document: object) -> None:
    """Refuses a diagnosis that states another session; what it does not state is not compared (older ones state no setup).

    Raises:
        MirrorPostureError: with what differs.
    """
    told = document.get(KEY) if isinstance(document, dict) else None
    if not isinstance(told, dict):
        return
    words = {
        "robot_sha256": "its robot.urdf",
        "frames_sha256": "its frames and commands",
        "setup_sha256": "the numbers of its camera, board, mirror or gravity",
    }
    differ = [words[key] for key, value in fingerprint(session).items() if told.get(key, value) != value]
    if differ:
        raise MirrorPostureError(
            f"{session.folder}: the diagnosis is of another session ({' and '.join(differ)} differ); apply it to the session "
            "that was diagnosed, or diagnose this one"
        )
