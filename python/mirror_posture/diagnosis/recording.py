"""Converts a session to the arrays that the core takes."""

from __future__ import annotations

import json

import numpy as np

from .._core import GapRecording
from ..mirror import IDEAL_MIRROR
from ..session import Session


def to_core(session: Session) -> GapRecording:
    """The session's arrays and names as the core's recording.

    Raises:
        MirrorPostureError: a robot that cannot be read, a joint or link that it does not have.
    """
    frames = session.frames
    camera = session.camera
    header = {
        "root_link": session.root_link,
        "gravity_m_per_s2": list(map(float, session.gravity_m_per_s2)),
        "camera": None
        if camera is None
        else {
            "size_px": list(camera.size_px),
            "focal_px": list(camera.focal_px),
            "center_px": list(camera.center_px),
            "model": camera.distortion_model,
            "distortion": list(map(float, camera.distortion)),
        },
        "camera_link": session.camera_link,
        "board": None
        if session.board is None
        else {
            "link": session.board.link,
            "corners": list(session.board.corners),
            "square_m": session.board.square_m,
        },
        **(session.mirror or IDEAL_MIRROR).glass,
        "markers": [
            {
                "name": m.name,
                "link": m.link,
                "diameter_m": m.diameter_m,
                "mount_known": m.mount_known,
                "tolerance_m": m.tolerance_m,
            }
            for m in session.markers
        ],
        "points_frame": session.points.frame_link if session.points else None,
        "ordered": frames.ordered,
        "timed": frames.time_s is not None,
        "pixel_std_px": session.noise.pixel_std_px,
        "point_std_m": session.noise.point_std_m,
        "joint_names": list(frames.joint_names),
        "board_tolerance": None
        if session.board is None
        else (session.board.tolerance_m, session.board.tolerance_rad),
        "camera_tolerance": (session.camera_tolerance_m, session.camera_tolerance_rad),
    }
    time_s = frames.time_s if frames.time_s is not None else frames.frame.astype(float)
    return GapRecording(
        session.robot.urdf,
        json.dumps(header),
        frames.frame,
        frames.posture,
        np.asarray(time_s, dtype=float),
        np.ascontiguousarray(frames.commanded, dtype=float),
        session.mirror_view,
        session.direct_view,
        session.points.point_m if session.points else None,
        session.points.seen if session.points else None,
    )
