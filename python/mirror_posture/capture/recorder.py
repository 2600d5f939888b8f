"""Writes captured data to disk at once: each picture first, then the table that names it, both whole or not
at all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa

from .._core import MirrorPostureError
from ..folder_lock import FolderLock
from ..output_files import new_file, write_file
from ..picture_files import encoded_picture
from ..plan.table import PlannedFrame
from ..session.tables import find_table, open_table
from ..session.write import write_table
from .made import Made

IMAGES = "images"
FRAMES = "frames.csv"


@dataclass(frozen=True)
class Taken:
    """A row of frames.csv."""

    frame: int
    posture: int
    time_s: float
    image: str
    measured: Mapping[str, float]


class Recorder:
    """Adds pictures to a session's folder, and goes on where a stopped or killed capture of the same plan ended.

    Nothing is written, locked or deleted before `begin`; what `overwrite` replaces stays until the first picture is there.

    Raises `MirrorPostureError` where the folder holds frames of another plan, or detections.
    """

    def __init__(self, folder: Path, plan: Sequence[PlannedFrame], overwrite: bool = False) -> None:
        self._folder, self._plan = folder, {frame.frame: frame for frame in plan}
        self._joints, self._overwrite = list(plan[0].commanded), overwrite
        self.taken: dict[int, Taken] = {}
        self._lock: FolderLock | None = None
        self._read()

    def _read(self) -> None:
        """What is in the folder now."""
        old = [
            table
            for stem in ("frames", "detections")
            if (table := find_table(self._folder, stem)) is not None
        ]
        self._replaced = old if self._overwrite else []
        self.taken.clear()
        if old and not self._overwrite:
            self._resume(old)
        self._made = Made(self._folder)
        # A source's time begins anew each time that it is opened.
        self._late_s = max((row.time_s for row in self.taken.values()), default=0.0)

    def begin(self, source: Path | None = None) -> None:
        """Locks the folder for this recorder; safe to call again. `source` is the film or folder of the pictures, if they have one.

        Raises `MirrorPostureError` where another process records into the folder, or pictures are in the way that no capture made.
        """
        images = self._folder / IMAGES
        if source is not None and source.resolve().is_relative_to(images.resolve()):
            raise MirrorPostureError(
                f"--source {source}: lies in the session's {IMAGES}/, where the capture writes its own pictures; move it out of it"
            )
        if self._lock is not None:
            return
        lock = FolderLock(self._folder)
        try:
            # Another recorder may have written since.
            self._read()
            self._refuse_replacing()
        except BaseException:
            lock.release()
            raise
        self._lock = lock

    def close(self) -> None:
        """Lets go of the folder; nothing can be added any more."""
        if self._lock is not None:
            self._lock.release()

    def _refuse_replacing(self) -> None:
        named = {row.image for row in self.taken.values()} | set(self._named_by_replaced())
        there = [frame for frame in self._plan if (self._folder / _image(frame)).exists()]
        foreign = [
            f for f in there if _image(f) not in named and not self._made.made(f, self._folder / _image(f))
        ]
        if foreign:
            raise MirrorPostureError(
                f"{self._folder / _image(foreign[0])}: is there already, no row of {FRAMES} names it and no capture made it "
                f"({len(foreign)} such in all); the capture would replace it: move it out of {IMAGES}/"
            )

    def _named_by_replaced(self) -> list[str]:
        """The pictures of the frames that `overwrite` replaces."""
        frames = next((file for file in self._replaced if file.stem == "frames"), None)
        try:
            cells = None if frames is None else open_table(frames).columns.get("image")
        except MirrorPostureError:
            # Frames that cannot be read are replaced all the same.
            cells = None
        return [] if cells is None else [str(name) for name in cells.to_pylist()]

    def go_on_in(self, film: str) -> float | None:
        """Goes on within a film: the second of the last picture that was taken of it, None where none was. Times go on as in the film."""
        last = self._made.last_in(film, self.taken)
        if last is None:
            return None
        frame, film_s = last
        self._late_s = self.taken[frame].time_s - film_s
        return film_s

    def _resume(self, old: list[Path]) -> None:
        told = f"{self._folder}: has {' and '.join(file.name for file in old)} already"
        again = "add --overwrite to replace them, or give another session"
        if [file.name for file in old] != [FRAMES]:
            raise MirrorPostureError(f"{told}; {again}")
        table = open_table(self._folder / FRAMES)
        columns = {name: cells.to_pylist() for name, cells in table.columns.items()}
        joints = [
            name
            for name in columns
            if name not in ("frame", "posture", "time_s", "image") and ":" not in name
        ]
        if joints != self._joints or "image" not in columns:
            raise MirrorPostureError(f"{told}, of another plan; {again}")
        try:
            self._take(columns, joints)
        except (ValueError, KeyError):
            raise MirrorPostureError(f"{told}, of another plan; {again}") from None

    def _take(self, columns: Mapping[str, list[str]], joints: Sequence[str]) -> None:
        """Rows that were taken already. Raises ValueError or KeyError for those that are not of this plan."""
        for row, frame in enumerate(columns["frame"]):
            planned = self._plan.get(int(frame))
            same = planned is not None and all(
                abs(float(columns[name][row]) - planned.commanded[name]) < 1e-9 for name in joints
            )
            if planned is None or not same or not (self._folder / columns["image"][row]).is_file():
                raise ValueError
            measured = {
                name.split(":", 1)[1]: float(columns[name][row])
                for name in columns
                if name.startswith("measured:")
            }
            self.taken[int(frame)] = Taken(
                int(frame), planned.posture, float(columns["time_s"][row]), columns["image"][row], measured
            )

    def add(
        self, frame: PlannedFrame, picture: Any, time_s: float, measured: Mapping[str, float], film: str = ""
    ) -> None:
        """Writes a picture and its row; when this returns both are on the disk.

        `film` names the film of which `time_s` is the time. Raises `MirrorPostureError` as `begin`, and after `close`.
        """
        image = _image(frame.frame)
        data = encoded_picture(picture, self._folder / image)
        self._writable()
        if self._replaced:
            # Only now, when there is something in their place. First it is noted which pictures lose their rows; the frames go last:
            # detections without them would be of other pictures.
            named = set(self._named_by_replaced())
            files = {
                number: self._folder / _image(number) for number in self._plan if _image(number) in named
            }
            self._made.begin_anew({number: file for number, file in files.items() if file.is_file()})
            for file in reversed(self._replaced):
                file.unlink(missing_ok=True)
            self._replaced, self._overwrite = [], False
        (self._folder / IMAGES).mkdir(exist_ok=True)
        self._made.note(frame.frame, data, film, time_s)
        write_file(self._folder / image, data)
        self.taken[frame.frame] = Taken(
            frame.frame, frame.posture, self._late_s + time_s, image, dict(measured)
        )
        self._write()

    @property
    def last(self) -> int | None:
        """The frame that was taken last; None before the first."""
        return max(self.taken, key=lambda frame: (self.taken[frame].time_s, frame), default=None)

    def drop(self, frame: int) -> None:
        """Takes a frame out of the table, to be taken again; its picture stays until then."""
        self._writable()
        self.taken.pop(frame, None)
        self._write()

    def _writable(self) -> None:
        self.begin()
        if self._lock is not None:
            self._lock.check()

    def _write(self) -> None:
        # Rows are in the order of execution, which is that of the plan's numbers.
        rows = [self.taken[frame] for frame in sorted(self.taken)]
        start = rows[0].time_s if rows else 0.0
        columns: dict[str, Any] = {
            "frame": pa.array([row.frame for row in rows], pa.int64()),
            "posture": pa.array([row.posture for row in rows], pa.int64()),
            "time_s": pa.array([max(0.0, row.time_s - start) for row in rows], pa.float64()),
            "image": pa.array([row.image for row in rows], pa.string()),
        }
        for name in self._joints:
            columns[name] = pa.array([self._plan[row.frame].commanded[name] for row in rows], pa.float64())
        for name in self._joints:
            if rows and all(name in row.measured for row in rows):
                columns[f"measured:{name}"] = pa.array([row.measured[name] for row in rows], pa.float64())
        with new_file(self._folder / FRAMES) as part:
            write_table(pa.table(columns), part)


def _image(frame: int) -> str:
    """A frame's picture, relative to the session."""
    return f"{IMAGES}/{frame:04d}.png"
