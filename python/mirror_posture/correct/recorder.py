"""Records a correction while it runs: an append-only session, on disk before anything depends on it.

The order: the picture (whole, under its name), the frame's row, its image points, the look's measurement;
each is flushed and synced before the next begins. So after `kill -9` at any moment everything that was
captured is there: a frame without image points is detected again from its picture; a last line without its
end is ignored.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from .._core import MirrorPostureError
from ..folder_lock import FolderLock
from ..output_files import new_folder, write_file
from ..robots.errors import NoLookError
from ..robots.nominal import Nominal
from ..robots.protocol import ImagePoints, Look, MarkerPoints
from ..session.camera_info import dump_camera_info
from ..session.load import load_session
from ..session.metadata import FILE
from ..session.tables import UNFINISHED
from ..session.write import metadata_tree
from ..shapes import keep_coarse_meshes
from ..shapes.of_links import COARSE_FOLDER
from .lines import (
    DETECTIONS,
    FRAMES,
    POINTS,
    append,
    append_bytes,
    cut_last_line,
    drop_orphans,
    line,
)
from .observation import USUAL_NOISE_PX, Readings
from .outcome import Outcome
from .recorded import (
    HEADER,
    PROPOSED,
    READINGS,
    TURNING,
    Past,
    Proposed,
    read_header,
    read_proposed,
    read_readings,
    recorded_looks,
)

RESULT = "outcome.json"


class Recorder:
    """Writes one correction into a folder, which every command reads as a session, also while it runs."""

    def __init__(
        self,
        folder: Path,
        nominal: Nominal,
        header: Mapping[str, Any],
        past: Past,
        next_frame: int,
        lock: FolderLock,
    ) -> None:
        """Use `start` or `resume`."""
        self.folder, self.nominal, self.joints = folder, nominal, tuple(header["joints"])
        self.proposed = read_proposed(header, folder / HEADER)
        """The views that were proposed, by this run or an earlier one."""
        self._header, self._past, self._next, self._lock = dict(header), past, next_frame, lock
        self._open = False
        self._measured: tuple[str, ...] | None = None
        self._late_s = 0.0
        if past.looks:
            self._measured = tuple(past.looks[0].measured)
            self._late_s = past.looks[-1].time_s

    @classmethod
    def start(
        cls,
        folder: str | os.PathLike[str],
        nominal: Nominal,
        joints: Sequence[str],
        header: Mapping[str, Any] | None = None,
    ) -> Recorder:
        """Begins a recording in a folder that is not there yet, or empty. `header` is kept for `resume` (plain values).

        The meshes that the URDF names are kept, simplified: a recording that is gone on with has the same body to keep off the glass.

        Raises `MirrorPostureError` for a folder that holds something.
        """
        folder = Path(folder)
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise MirrorPostureError(
                f"{folder}: is there already; give another folder, or --resume to go on with what it holds"
            )
        document = {"joints": list(joints), **(header or {})}
        # In one step: a folder that is there can be gone on with.
        with new_folder(folder) as part:
            (part / "images").mkdir()
            (part / "robot.urdf").write_bytes(nominal.robot_file.read_bytes())
            _keep_meshes(nominal.robot_file, part / "robot.urdf")
            if nominal.camera is not None:
                (part / "camera.yaml").write_text(dump_camera_info(nominal.camera), encoding="utf-8")
            tree = metadata_tree(nominal.session([Look({}, 0.0)], [0]))
            (part / FILE).write_text(tomli_w.dumps(tree), encoding="utf-8")
            (part / UNFINISHED).touch()
            (part / HEADER).write_text(json.dumps(document, indent=1, allow_nan=False), encoding="utf-8")
        return cls(folder, nominal, document, Past(), 0, FolderLock(folder))

    @classmethod
    def resume(cls, folder: str | os.PathLike[str]) -> tuple[Recorder, dict[str, Any]]:
        """Goes on with a recording; second, the header that it was started with.

        A last line without its end is taken off; a frame without image points is detected again from its picture.

        Raises `MirrorPostureError` for a folder without a recording, or one that another process records into.
        """
        folder = Path(folder)
        header = read_header(folder)
        # Before a line is cut that another recorder is just writing.
        lock = FolderLock(folder)
        try:
            return cls._resumed(folder, header, lock), header
        except BaseException:
            lock.release()
            raise

    @classmethod
    def _resumed(cls, folder: Path, header: dict[str, Any], lock: FolderLock) -> Recorder:
        for name in (FRAMES, DETECTIONS, POINTS, READINGS):
            cut_last_line(folder / name)
        nominal = Nominal.load(folder)
        past, last = Past(), -1
        if (folder / FRAMES).is_file() and (folder / FRAMES).read_bytes().count(b"\n") > 1:
            drop_orphans(folder)
            session = load_session(folder)
            last = int(session.frames.frame[-1])
            looks = recorded_looks(session, nominal, header.get(TURNING, ()))
            postures = session.frames.posture.tolist()
            past = Past(tuple(looks), tuple(postures), tuple(read_readings(folder / READINGS)))
        recorder = cls(folder, nominal, header, past, last + 1, lock)
        if past.looks:
            # Once more, whole: the last frame's image points may have been cut.
            recorder._rewrite_detections(past)
        return recorder

    def past(self) -> Past:
        """What an earlier run recorded; empty for a new recording."""
        return self._past

    def capture(self, look: Look, posture: int) -> int:
        """Writes a look's picture and its frame; returns the frame's number.

        Raises `NoLookError` where the encoders that earlier frames have are missing, `MirrorPostureError` where another recorder has
        taken over the folder.
        """
        self._lock.check()
        if not self._open:
            # Not before there is something to write: a recording that ended stays so where it is only asked to go on.
            write_file(self.folder / UNFINISHED, b"")
            self._open = True
        if self._measured is None:
            self._measured = tuple(name for name in self.joints if name in look.measured)
        lacking = [name for name in self._measured if name not in look.measured]
        if lacking:
            raise NoLookError(f"the look lacks the encoder of {', '.join(lacking)}, which earlier looks had")
        frame = self._next
        image = ""
        if look.picture_bgr is not None:
            from ..picture_files import encoded_picture

            image = f"images/{frame:04d}.png"
            try:
                data = encoded_picture(look.picture_bgr, image)
            except MirrorPostureError as error:
                # Another look may give a better one.
                raise NoLookError(str(error)) from None
            write_file(self.folder / image, data)
        elif look.points is not None:
            # Without a picture nothing can be detected again: the points come before the frame that speaks of them.
            self._append_detections(frame, look)
        elif look.marker_points is not None:
            self._append_points(frame, look.marker_points)
        columns = ["frame", "posture", "time_s", "image", *self.joints]
        columns += [f"measured:{name}" for name in self._measured]
        row: list[Any] = [frame, posture, look.time_s + self._late_s, image]
        row += [float(look.commanded.get(name, 0.0)) for name in self.joints]
        row += [float(look.measured[name]) for name in self._measured]
        append(self.folder / FRAMES, columns, [row])
        self._next += 1
        return frame

    def detected(self, frame: int, look: Look) -> None:
        """Writes the image points of a look whose picture has its frame already."""
        if look.picture_bgr is not None and look.points is not None:
            self._lock.check()
            self._append_detections(frame, look)

    def measured(self, posture: int, readings: Readings) -> None:
        """Writes the measurement of a look."""
        self._lock.check()
        document = {"posture": posture, **{k: _plain(v) for k, v in asdict(readings).items()}}
        append_bytes(self.folder / READINGS, (json.dumps(document, allow_nan=False) + "\n").encode())

    def end(self, outcome: Outcome) -> None:
        """Writes what came of it. An interrupted correction stays open to `resume`."""
        self._lock.check()
        document = json.dumps(_plain({**asdict(outcome), "data": outcome.data}), indent=1, allow_nan=False)
        write_file(self.folder / RESULT, document.encode())
        if outcome.stop.kind not in ("interrupted", "robot_failed"):
            (self.folder / UNFINISHED).unlink(missing_ok=True)

    def close(self) -> None:
        """Lets go of the folder; nothing can be written any more. Safe to call again."""
        self._lock.release()

    def keep_proposed(self, proposed: Proposed) -> None:
        """Writes the views that were proposed, for the runs that go on."""
        self.proposed = proposed
        views = [[view.yaw_rad, view.pitch_rad, view.distance_m] for view in proposed.views]
        self._keep(PROPOSED, {"count": proposed.count, "views": views})

    def keep_turning(self, joints: Sequence[str]) -> None:
        """Writes which joints turn the robot before its mirror: the markers that they move are no part of the recording."""
        self._keep(TURNING, list(joints))

    def _keep(self, key: str, value: Any) -> None:
        if self._header.get(key) != value:
            self._lock.check()
            self._header[key] = value
            write_file(self.folder / HEADER, json.dumps(self._header, indent=1, allow_nan=False))

    def _append_detections(self, frame: int, look: Look) -> None:
        points = look.points
        assert points is not None
        append(self.folder / DETECTIONS, _DETECTION_COLUMNS, _detection_rows(frame, points, self.nominal))

    def _append_points(self, frame: int, points: MarkerPoints) -> None:
        file = self.folder / FILE
        if "[points]" not in file.read_text(encoding="utf-8"):
            addition = tomli_w.dumps({"points": {"frame": points.frame_link}})
            write_file(file, file.read_bytes() + b"\n" + addition.encode())
        rows = [
            [frame, name, *points.point_m[index].tolist()]
            for index, name in enumerate(self.nominal.marker_names)
            if points.seen[index]
        ]
        append(self.folder / POINTS, ["frame", "marker", "x", "y", "z"], rows)

    def _rewrite_detections(self, past: Past) -> None:
        if not any(look.points is not None for look in past.looks):
            return
        rows: list[list[Any]] = []
        session = load_session(self.folder)
        for frame, look in zip(session.frames.frame.tolist(), past.looks, strict=True):
            if look.points is not None:
                rows += _detection_rows(frame, look.points, self.nominal)
        text = "".join(line(row) for row in [_DETECTION_COLUMNS, *rows])
        write_file(self.folder / DETECTIONS, text.encode())


_DETECTION_COLUMNS = ["frame", "target", "index", "u", "v", "std_px"]


def _detection_rows(frame: int, points: ImagePoints, nominal: Nominal) -> list[list[Any]]:
    # The column takes no empty cell.
    usual_px, names = nominal.metadata.noise.pixel_std_px or USUAL_NOISE_PX, nominal.marker_names
    rows: list[list[Any]] = []
    for index in np.flatnonzero(points.board_seen).tolist():
        std = None if points.board_std_px is None else float(points.board_std_px[index])
        rows.append([frame, "board", index, *points.board_px[index].tolist(), std or usual_px])
    for index in np.flatnonzero(points.marker_seen).tolist():
        std = None if points.marker_std_px is None else float(points.marker_std_px[index])
        rows.append([frame, names[index], 0, *points.marker_px[index].tolist(), std or usual_px])
    return rows


def _keep_meshes(source: Path, urdf: Path) -> None:
    """Simplified copies of a URDF's meshes beside its copy; those that are simplified already as they are."""
    keep_coarse_meshes(source, urdf, {})
    for copy in (urdf.parent / COARSE_FOLDER).glob("*"):
        if (before := source.parent / COARSE_FOLDER / copy.name).is_file():
            shutil.copyfile(before, copy)


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return value
