"""What a session says about its pictures: what to look for, and what to expect of the board in each frame."""

from __future__ import annotations

import numpy as np

from ..robot import Robot
from ..session.types import Session
from .pictures import PicturePrediction
from .types import (
    BoardPrediction,
    BoardSpec,
    CameraSpec,
    ColorSpec,
    DetectionError,
    DetectionSetup,
    MarkerSpec,
)


def setup_from_session(session: Session) -> DetectionSetup:
    """The board, the markers and the camera of a session. Raises `DetectionError` for a marker without a colour."""
    board = None
    if session.board is not None:
        given = session.board
        board = BoardSpec(
            given.columns, given.rows, given.square_m, given.pattern, given.marker_size_m, given.dictionary
        )
    markers = []
    for marker in session.markers:
        if marker.color is None:
            raise DetectionError(
                f"session.toml: marker {marker.name!r} has no color, and pictures need one; add "
                "color = { hue = …, hue_tolerance = …, min_saturation = …, min_value = … }"
            )
        color = ColorSpec(
            marker.color.hue_deg,
            marker.color.hue_tolerance_deg,
            marker.color.min_saturation,
            marker.color.min_value,
        )
        markers.append(MarkerSpec(marker.name, marker.diameter_m, color))
    camera = None
    if session.camera is not None:
        info = session.camera
        camera = CameraSpec(info.matrix_px, np.asarray(info.distortion), info.width_px, info.height_px)
    return DetectionSetup(board, tuple(markers), camera)


def predictions_from_session(session: Session) -> tuple[PicturePrediction | None, ...]:
    """The board's nominal pose before the camera in each frame, from the robot model at the commanded posture.

    It settles the labels of a board that looks the same turned by 180°. None for each frame where the session has no board or camera.
    """
    frames = session.frames
    if session.board is None or session.camera_link is None:
        return (None,) * len(frames)
    robot = Robot.from_urdf(session.robot_file)
    commanded = {name: frames.commanded[:, column] for column, name in enumerate(frames.joint_names)}
    # Without a joint column there is one posture, the same in all frames.
    positions = np.broadcast_to(robot.positions(commanded), (len(frames), len(robot.position_names)))
    root_from_link = robot.forward_kinematics(positions)
    root_from_camera = root_from_link[:, robot.link_index(session.camera_link)]
    root_from_board = root_from_link[:, robot.link_index(session.board.link)]
    camera_from_board = np.linalg.solve(root_from_camera, root_from_board)
    return tuple(PicturePrediction(BoardPrediction(camera_from_board=pose)) for pose in camera_from_board)
