"""points.csv: marker positions from another measurement."""

from __future__ import annotations

import numpy as np

from .detections import frame_rows, refuse_twice
from .errors import SessionError, choices
from .tables import Table
from .types import Frames, Points

COLUMNS = ("frame", "marker", "x", "y", "z")


def read_points(
    table: Table, frames: Frames, frames_name: str, marker_names: tuple[str, ...], frame_link: str
) -> Points:
    """The measured positions, dense with a mask."""
    table.require(*COLUMNS)
    points = Points(
        frame_link,
        np.zeros((len(frames), len(marker_names), 3)),
        np.zeros((len(frames), len(marker_names)), dtype=bool),
    )
    if table.rows == 0:
        return points
    row = frame_rows(table, frames, frames_name)
    codes, names = table.texts("marker")
    for code, name in enumerate(names):
        if name not in marker_names:
            raise SessionError(
                table.name,
                f"session.toml has no marker {name!r}; valid: {choices(marker_names)}",
                row=int(np.flatnonzero(codes == code)[0]) + 1,
                column="marker",
            )
    number = {name: m for m, name in enumerate(marker_names)}
    marker = np.array([number[name] for name in names])[codes]
    refuse_twice(table, row * len(marker_names) + marker, "this marker of this frame")
    points.point_m[row, marker] = np.stack([table.numbers(axis) for axis in "xyz"], axis=1)
    points.seen[row, marker] = True
    return points
