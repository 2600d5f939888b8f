"""A session's folder, read and validated as a whole."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from .._core import MirrorPostureError
from ..robot import Robot
from .camera_info import load_camera_info
from .detections import COLUMNS as DETECTION_COLUMNS
from .detections import OPTIONAL_COLUMNS, read_detections
from .errors import SessionError, choices
from .frames import check_images_exist, read_frames
from .metadata import FILE, Metadata, load_metadata
from .points import COLUMNS as POINT_COLUMNS
from .points import read_points
from .tables import UNFINISHED, Table, find_table, read_table
from .types import UNKNOWN_FRAME, Frames, Session, Views


def load_session(folder: str | os.PathLike[str]) -> Session:
    """Loads a session's folder and validates it as a whole.

    Tables may be CSV or Parquet. A session with pictures and no detections table loads with `detected` False.

    A session that is being recorded, or whose recording was cut off, loads with what is complete in it.

    Raises `SessionError` (a `MirrorPostureError`) for what cannot be meant: it names the file, the row and the fix.
    Unknown keys and columns are kept, and named in `Session.warnings`.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise SessionError(folder, "is no folder; a session is one folder with a session.toml in it")
    metadata = load_metadata(folder)
    warnings = list(metadata.warnings)
    robot_file = _inside(folder, metadata.robot, "robot")
    robot = _load_robot(robot_file, metadata.robot)
    _check_links(metadata, robot)
    camera = None
    if metadata.camera is not None:
        camera = load_camera_info(_inside(folder, metadata.camera, "camera"), metadata.camera)

    frames_file = find_table(folder, "frames")
    if frames_file is None:
        raise SessionError(
            folder / "frames.csv", "the file is missing; needed one row for each captured picture"
        )
    frames_name = frames_file.name
    unfinished = (folder / UNFINISHED).exists()
    if unfinished:
        warnings.append(f"{folder}: is being recorded, or was cut off; what is complete is read")
    frames, odd = read_frames(read_table(frames_file, unfinished), robot, metadata.ordered)
    warnings += odd

    marker_names = tuple(marker.name for marker in metadata.markers)
    detections_file = find_table(folder, "detections")
    points_file = find_table(folder, "points")
    pictures = any(name is not None for name in frames.image or ())
    if detections_file is None and points_file is None and not pictures:
        raise SessionError(
            folder / "detections.csv",
            "the file is missing, and so are points.csv and pictures (an `image` column in the frames table): "
            "nothing was observed; add one of them",
        )
    # Pictures are optional beside a detections table: a session may be passed on without them, as a whole.
    if pictures and (detections_file is None or (folder / "images").is_dir()):
        check_images_exist(folder, frames_name, frames)
    elif pictures:
        warnings.append(f"{frames_name}: the column 'image' names pictures, and there is no folder images/")

    corners = 0 if metadata.board is None else metadata.board.columns * metadata.board.rows
    mirror_view, direct_view = (Views.empty(len(frames), corners, len(marker_names)) for _ in range(2))
    if detections_file is not None:
        table = _whole_frames(read_table(detections_file, unfinished), frames, unfinished)
        warnings += _unknown_columns(table, (*DETECTION_COLUMNS, *OPTIONAL_COLUMNS))
        mirror_view, direct_view = read_detections(table, frames, frames_name, metadata.board, marker_names)
    if (mirror_view.any_seen or direct_view.any_seen or pictures) and camera is None:
        raise SessionError(
            FILE, "there are pictures or detections and no camera; add `camera` and [camera_mount]"
        )
    if mirror_view.any_seen and metadata.board is None:
        raise SessionError(
            FILE,
            "points were seen in the mirror and there is no [board], whose reflection tells where the mirror stands; "
            f"add it, or write `direct` in the column via of {detections_file.name if detections_file else ''}",
        )
    points = None
    if points_file is not None:
        if metadata.points_frame is None:
            raise SessionError(
                FILE, f"there is {points_file.name} and no [points]; add it with `frame`, a link or unknown"
            )
        table = _whole_frames(read_table(points_file, unfinished), frames, unfinished)
        warnings += _unknown_columns(table, POINT_COLUMNS)
        points = read_points(table, frames, frames_name, marker_names, metadata.points_frame)
    elif metadata.points_frame is not None:
        raise SessionError(folder / "points.csv", "the file is missing; session.toml has a section [points]")

    return Session(
        folder,
        robot_file,
        robot,
        metadata.root,
        metadata.gravity_m_per_s2,
        frames,
        metadata.markers,
        mirror_view,
        direct_view,
        camera,
        metadata.camera_link,
        metadata.board,
        metadata.mirror,
        metadata.noise,
        points,
        detections_file is not None,
        metadata.raw,
        tuple(warnings),
    )


def _whole_frames(table: Table, frames: Frames, unfinished: bool) -> Table:
    """Of an unfinished recording the rows whose frame was written too."""
    if not unfinished or "frame" not in table.columns:
        return table
    return table.only(np.isin(table.integers("frame"), frames.frame))


def _inside(folder: Path, name: str, key: str) -> Path:
    """A file that session.toml names: it lies in the session's folder, so that the folder can be passed on."""
    path = Path(name)
    if path.is_absolute() or ".." in path.parts or "\0" in name:
        raise SessionError(FILE, f"{key}: got {name!r}, needed a path inside the session's folder")
    return folder / path


def _load_robot(file: Path, shown_as: str) -> Robot:
    if not file.is_file():
        raise SessionError(shown_as, "the file is missing; save the robot's nominal URDF there")
    try:
        return Robot.from_urdf_text(file.read_text(encoding="utf-8-sig"))
    except (OSError, UnicodeDecodeError) as error:
        raise SessionError(shown_as, f"cannot be read as text ({error}); needed a URDF in UTF-8") from None
    except MirrorPostureError as error:
        raise SessionError(shown_as, " ".join(str(error).split())) from None


def _check_links(metadata: Metadata, robot: Robot) -> None:
    places = [("root", metadata.root)]
    if metadata.camera_link is not None:
        places.append(("camera_mount.link", metadata.camera_link))
    if metadata.board is not None:
        places.append(("board.link", metadata.board.link))
    places += [(f"markers[{index}].link", marker.link) for index, marker in enumerate(metadata.markers)]
    if metadata.points_frame not in (None, UNKNOWN_FRAME):
        places.append(("points.frame", str(metadata.points_frame)))
    for key, link in places:
        if link not in robot.link_names:
            raise SessionError(
                FILE,
                f"{key}: the URDF {metadata.robot} has no link {link!r}; its links: {choices(robot.link_names)}",
            )


def _unknown_columns(table: Table, known: tuple[str, ...]) -> list[str]:
    return [
        f"{table.name}: {column!r} is not a column of the format and has no effect"
        for column in table.columns
        if column not in known
    ]
