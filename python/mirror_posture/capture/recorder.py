"""Writes captured data to disk at once: each picture first, then the table that names it, both whole or not
at all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa

from .._core import MirrorPostureError
from ..output_files import new_file
from ..picture_files import write_picture
from ..plan.table import PlannedFrame
from ..session.tables import find_table, open_table
from ..session.write import write_table

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

    Raises `MirrorPostureError` where the folder holds frames of another plan, or detections.
    """

    def __init__(self, folder: Path, plan: Sequence[PlannedFrame], overwrite: bool = False) -> None:
        self._folder, self._plan = folder, {frame.frame: frame for frame in plan}
        self._joints = list(plan[0].commanded)
        old = [table for stem in ("frames", "detections") if (table := find_table(folder, stem)) is not None]
        self.taken: dict[int, Taken] = {}
        if overwrite:
            # The frames last: detections without them would be of other pictures.
            for file in reversed(old):
                file.unlink()
        elif old:
            self._resume(old)
        # A source's time begins anew each time that it is opened.
        self._late_s = max((row.time_s for row in self.taken.values()), default=0.0)

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

    def add(self, frame: PlannedFrame, picture: Any, time_s: float, measured: Mapping[str, float]) -> None:
        """Writes a picture and its row; when this returns both are on the disk."""
        image = f"images/{frame.frame:04d}.png"
        (self._folder / "images").mkdir(exist_ok=True)
        write_picture(self._folder / image, picture)
        self.taken[frame.frame] = Taken(
            frame.frame, frame.posture, self._late_s + time_s, image, dict(measured)
        )
        self._write()

    def drop(self, frame: int) -> None:
        """Takes a frame out of the table, to be taken again; its picture stays until then."""
        self.taken.pop(frame, None)
        self._write()

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
