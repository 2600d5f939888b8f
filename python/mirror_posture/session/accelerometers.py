"""Accelerometers in frames.csv: columns `accelerometer:<link>:x`, `:y`, `:z`, the reading at rest of a
sensor on that link.

At rest an accelerometer reads the specific force `−g`: about 9.81 m/s², upward, here in the link's frame. A
frame with three empty cells was not measured.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa

from ..robot import Robot
from ..short_repr import ShortRepr
from .errors import SessionError, choices
from .tables import Table

if TYPE_CHECKING:
    from ..arrays import Floats, Mask
    from .types import Frames

ACCELEROMETER = "accelerometer:"
AXES = ("x", "y", "z")
NEEDED = "needed accelerometer:<link>:x, :y and :z"


@dataclass(frozen=True, eq=False, repr=False)
class Accelerometers(ShortRepr):
    """All readings: links (L), force (F, L, 3) in each link's frame, m/s², and whether it was read (F, L)."""

    links: tuple[str, ...]
    force_m_per_s2: Floats
    read: Mask


def is_accelerometer(column: str, robot: Robot) -> bool:
    """Whether a column of the frames table speaks of an accelerometer: a joint may have such a name, and then goes first."""
    return column.startswith(ACCELEROMETER) and all(joint.name != column for joint in robot.joints)


def read_accelerometers(table: Table, robot: Robot) -> Accelerometers:
    """The accelerometers' columns, checked against the robot's links.

    Raises:
        SessionError: a link that the URDF lacks, a link with one or two of its three columns, a reading with one or two
            of its three cells, or one of zero length.
    """
    links: dict[str, set[str]] = {}
    for column in table.columns:
        if not is_accelerometer(column, robot):
            continue
        link, _, axis = column.removeprefix(ACCELEROMETER).rpartition(":")
        if not link or axis not in AXES:
            raise SessionError(table.name, f"names no axis of a link; {NEEDED}", column=column)
        if link not in robot.link_names:
            raise SessionError(
                table.name,
                f"the URDF has no link {link!r}; its links: {choices(robot.link_names)}; rename or remove the column",
                column=column,
            )
        links.setdefault(link, set()).add(axis)
    force = np.zeros((table.rows, len(links), 3))
    read = np.zeros((table.rows, len(links)), dtype=bool)
    for index, (link, axes) in enumerate(links.items()):
        names = [_column(link, axis) for axis in AXES]
        missing = [name for name, axis in zip(names, AXES, strict=True) if axis not in axes]
        if missing:
            raise SessionError(
                table.name, f"the column is missing; {NEEDED} of link {link!r}", column=missing[0]
            )
        read[:, index] = _rows_read(table, names)
        rows = np.flatnonzero(read[:, index])
        force[rows, index] = np.stack([table.numbers_in(name, rows) for name in names], axis=1)
        nothing = rows[~force[rows, index].any(axis=1)]
        if len(nothing):
            raise SessionError(
                table.name,
                "got a reading of zero, which nothing at rest has; leave all three cells empty where it was not measured",
                row=int(nothing[0]) + 1,
                column=names[0],
            )
    return Accelerometers(tuple(links), force, read)


def accelerometer_columns(frames: Frames) -> dict[str, pa.Array]:
    """The columns as they are written; empty cells where nothing was read."""
    return {
        _column(link, axis): pa.array(
            frames.accelerometer_m_per_s2[:, index, k], mask=~frames.accelerometer_read[:, index]
        )
        for index, link in enumerate(frames.accelerometer_links)
        for k, axis in enumerate(AXES)
    }


def _column(link: str, axis: str) -> str:
    return f"{ACCELEROMETER}{link}:{axis}"


def _rows_read(table: Table, names: list[str]) -> Mask:
    """(rows,): whether there is a reading; refuses one with a part of its cells."""
    blank = np.stack([table.blank(name) for name in names], axis=1)
    partly = np.flatnonzero(blank.any(axis=1) & ~blank.all(axis=1))
    if len(partly):
        row = int(partly[0])
        raise SessionError(
            table.name,
            "got an empty cell with other cells of the same reading; needed all three numbers, or three empty cells",
            row=row + 1,
            column=names[int(np.flatnonzero(blank[row])[0])],
        )
    read: Mask = ~blank[:, 0]
    return read
