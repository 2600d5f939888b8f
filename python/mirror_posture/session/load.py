"""A session's folder, read and validated as a whole."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from .._core import MirrorPostureError
from ..arguments import checked_arguments
from ..camera import Camera
from ..input_files import LARGEST_MODEL, read_text, reason
from ..output_files import is_whole
from ..robot import Robot
from .camera_info import load_camera_info
from .detections import COLUMNS as DETECTION_COLUMNS
from .detections import OPTIONAL_COLUMNS, read_detections
from .errors import Problems, SessionError, choices
from .frames import check_images_exist, read_frames
from .lines import told_by_line
from .metadata import FILE, Metadata, load_metadata
from .plausibility import check_plausible
from .points import COLUMNS as POINT_COLUMNS
from .points import read_points
from .states import read_states, with_states
from .tables import UNFINISHED, Table, find_table, read_table
from .types import UNKNOWN_FRAME, Frames, Points, Session, States, Views

MOST_VIEW_POINTS = 10_000_000
"""Frames times board corners and markers at most: each takes 34 bytes."""


def as_session(session: Session | str | os.PathLike[str]) -> Session:
    """A session as it is, or the one of a folder; see `load_session`."""
    return session if isinstance(session, Session) else load_session(session)


@checked_arguments
def load_session(folder: str | os.PathLike[str]) -> Session:
    """Loads a session's folder and validates it as a whole.

    Tables may be CSV or Parquet. A session with pictures and no detections table loads with `detected`
    False.

    A session that is being recorded, or whose recording was cut off, loads with its complete part.

    Raises `SessionError` (a `MirrorPostureError`) for invalid input: it names the file, the row and the
    fix; its `problems` contain everything that was found. Unknown keys and columns are kept, and named in
    `Session.warnings`.
    """
    folder = Path(folder)
    with told_by_line(folder):
        return _load(folder)


def _load(folder: Path) -> Session:
    metadata = load_metadata(folder)
    warnings = list(metadata.warnings)
    problems = Problems()
    robot_file = folder / metadata.robot
    robot: Robot | None = None
    with problems.kept():
        robot = _load_robot(robot_file, metadata.robot)
        _check_links(metadata, robot)
    camera = None
    if metadata.camera is not None:
        with problems.kept():
            camera = load_camera_info(folder / metadata.camera, metadata.camera)

    frames_file = find_table(folder, "frames")
    if frames_file is None:
        raise SessionError(
            folder / "frames.csv", "the file is missing; needed one row for each captured picture"
        )
    if robot is None:
        problems.end()
        raise AssertionError("a robot that is missing is a problem")
    if not is_whole(folder):
        raise SessionError(
            folder, "its files are being exchanged, or the program that did so was killed; run that once more"
        )
    unfinished = (folder / UNFINISHED).exists()
    if unfinished:
        warnings.append(f"{folder}: is being recorded, or was cut off; what is complete is read")
    try:
        states = _states(folder, robot)
        table = read_table(frames_file, unfinished)
        if states is not None:
            table = with_states(table, states, "states.csv")
        frames, odd = read_frames(table, robot, metadata.ordered)
    except SessionError as error:
        # Without frames no other table can be judged.
        problems.found += error.problems or (error,)
        problems.end()
        raise
    warnings += odd
    tables = _Tables(folder, metadata, frames, frames_file.name, unfinished, camera, warnings, problems)
    detected, (mirror_view, direct_view), points = tables.read()
    problems.end()
    session = Session(
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
        states,
        *metadata.camera_tolerance,
        detected,
        metadata.raw,
    )
    warnings += check_plausible(session, problems)
    problems.end()
    return replace(session, warnings=tuple(warnings))


def _states(folder: Path, robot: Robot) -> States | None:
    file = find_table(folder, "states")
    return None if file is None else read_states(read_table(file), robot)


@dataclass(frozen=True)
class _Tables:
    """The tables of observations, read against the frames."""

    folder: Path
    metadata: Metadata
    frames: Frames
    frames_name: str
    unfinished: bool
    camera: Camera | None
    warnings: list[str]
    problems: Problems

    def read(self) -> tuple[bool, tuple[Views, Views], Points | None]:
        """Whether there is a detections table, the observations in the mirror and direct ones, and measured
        points."""
        folder, metadata, frames = self.folder, self.metadata, self.frames
        detections_file, points_file = find_table(folder, "detections"), find_table(folder, "points")
        pictures = any(name is not None for name in frames.image or ())
        if detections_file is None and points_file is None and not pictures:
            raise SessionError(
                folder / "detections.csv",
                "the file is missing, and so are points.csv and pictures (an `image` column in the frames table): "
                "nothing was observed; add one of them",
            )
        # Pictures are optional if there is a detections table: a session may be passed on without all of
        # them.
        if pictures and (detections_file is None or (folder / "images").is_dir()):
            with self.problems.kept():
                check_images_exist(folder, self.frames_name, frames)
        elif pictures:
            self.warnings.append(
                f"{self.frames_name}: the column 'image' names pictures, and there is no folder images/"
            )
        views = self._views(detections_file)
        seen = views[0].any_seen or views[1].any_seen or pictures
        if seen and metadata.camera is None:
            raise SessionError(
                FILE, "there are pictures or detections and no camera; add `camera` and [camera_mount]"
            )
        if views[0].any_seen and metadata.board is None:
            raise SessionError(
                FILE,
                "points were seen in the mirror and there is no [board], whose reflection tells where the mirror stands; add "
                f"it, or write `direct` in the column via of {detections_file.name if detections_file else ''}",
            )
        return detections_file is not None, views, self._points(points_file)

    def _views(self, file: Path | None) -> tuple[Views, Views]:
        board, markers = self.metadata.board, tuple(marker.name for marker in self.metadata.markers)
        corners = 0 if board is None else board.columns * board.rows
        count = len(self.frames)
        if count * (corners + len(markers)) > MOST_VIEW_POINTS:
            raise SessionError(
                self.frames_name,
                f"got {count} frames of up to {corners + len(markers)} points each, needed at most {MOST_VIEW_POINTS} points; "
                "split the session",
            )
        views = (Views.empty(count, corners, len(markers)), Views.empty(count, corners, len(markers)))
        if file is None:
            return views
        with self.problems.kept():
            table = _whole_frames(read_table(file, self.unfinished), self.frames, self.unfinished)
            self.warnings.extend(_unknown_columns(table, (*DETECTION_COLUMNS, *OPTIONAL_COLUMNS)))
            camera = self.camera
            size = None if camera is None else (camera.width_px, camera.height_px)
            views = read_detections(table, self.frames, self.frames_name, board, markers, size)
        return views

    def _points(self, file: Path | None) -> Points | None:
        frame = self.metadata.points_frame
        if file is None:
            if frame is not None:
                raise SessionError(
                    self.folder / "points.csv", "the file is missing; session.toml has a section [points]"
                )
            return None
        if frame is None:
            raise SessionError(
                FILE,
                f'there is {file.name} and no [points]; add the two lines `[points]` and `frame = "LINK"`, the link in whose frame '
                'x, y, z are given, or `frame = "unknown"` for a tracker\'s own',
            )
        points = None
        with self.problems.kept():
            table = _whole_frames(read_table(file, self.unfinished), self.frames, self.unfinished)
            self.warnings.extend(_unknown_columns(table, POINT_COLUMNS))
            names = tuple(marker.name for marker in self.metadata.markers)
            points = read_points(table, self.frames, self.frames_name, names, frame)
        return points


def _whole_frames(table: Table, frames: Frames, unfinished: bool) -> Table:
    """Of an unfinished recording the rows whose frame was written too."""
    if not unfinished or "frame" not in table.columns:
        return table
    return table.only(np.isin(table.integers("frame"), frames.frame))


def _load_robot(file: Path, shown_as: str) -> Robot:
    try:
        return Robot.from_urdf_text(read_text(file, LARGEST_MODEL))
    except FileNotFoundError:
        raise SessionError(shown_as, "the file is missing; save the robot's nominal URDF there") from None
    except (OSError, UnicodeDecodeError) as error:
        raise SessionError(
            shown_as, f"cannot be read as text ({reason(error)}); needed a URDF in UTF-8"
        ) from None
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
