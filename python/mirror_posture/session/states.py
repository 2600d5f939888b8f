"""states.csv: a log of the joints that is denser than the pictures, and the joints of a frame read from it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa

from .errors import SessionError, choices
from .frames import MEASURED
from .tables import Table

if TYPE_CHECKING:
    from ..robot import Robot
    from .types import States

TIME = "time_s"


def read_states(table: Table, robot: Robot) -> States:
    """The log: `time_s`, a column for each joint (commanded) and `measured:<joint>`.

    Raises:
        SessionError: no `time_s`, or one that falls; a column of no movable joint; a bad cell.
    """
    from .types import States

    table.require(TIME)
    if table.rows == 0:
        raise SessionError(table.name, "has no rows; needed the joints' positions by time, or no such file")
    time_s = table.numbers(TIME)
    falls = np.flatnonzero(np.diff(time_s) <= 0.0)
    if len(falls):
        row = int(falls[0]) + 1
        raise SessionError(
            table.name,
            f"got {time_s[row]:g} after {time_s[row - 1]:g}, needed times that rise from row to row",
            row=row + 1,
            column=TIME,
        )
    columns = [name for name in table.columns if name != TIME]
    movable = [joint.name for joint in robot.joints if joint.kind != "fixed"]
    for column in columns:
        if column.removeprefix(MEASURED) not in movable:
            raise SessionError(
                table.name,
                f"the URDF has no movable joint {column.removeprefix(MEASURED)!r}; its joints: {choices(movable)}; "
                "rename or remove the column",
                column=column,
            )
    joints = tuple(name for name in columns if not name.startswith(MEASURED))
    measured = tuple(name for name in columns if name.startswith(MEASURED))
    return States(
        time_s,
        joints,
        _stack(table, joints),
        tuple(name.removeprefix(MEASURED) for name in measured),
        _stack(table, measured),
    )


def with_states(frames: Table, states: States, log_name: str) -> Table:
    """The frames table, with a column more for each joint that it leaves out and the log has: read at the frame's `time_s`.

    Between two rows of the log a joint moves straight.

    Raises:
        SessionError: a frame before the log's first row or after its last, or frames without times.
    """
    parts = ((states.joint_names, states.commanded, ""), (states.measured_names, states.measured, MEASURED))
    missing = {
        prefix + name: values[:, index]
        for names, values, prefix in parts
        for index, name in enumerate(names)
        if prefix + name not in frames.columns
    }
    if not missing:
        return frames
    if TIME not in frames.columns:
        raise SessionError(
            frames.name,
            f"the column 'time_s' is missing; needed it to read {choices(missing)} from {log_name}",
        )
    time_s = frames.numbers(TIME)
    outside = np.flatnonzero((time_s < states.time_s[0]) | (time_s > states.time_s[-1]))
    if len(outside):
        raise SessionError(
            frames.name,
            f"got {time_s[outside[0]]:g} s, needed a time within {log_name} ({states.time_s[0]:g} to {states.time_s[-1]:g} s)",
            row=int(outside[0]) + 1,
            column=TIME,
        )
    read = {name: pa.array(np.interp(time_s, states.time_s, values)) for name, values in missing.items()}
    return Table(frames.name, {**frames.columns, **read}, frames.rows)


def states_table(states: States) -> pa.Table:
    """The log as it is written."""
    columns = {TIME: states.time_s}
    columns |= {name: states.commanded[:, i] for i, name in enumerate(states.joint_names)}
    columns |= {MEASURED + name: states.measured[:, i] for i, name in enumerate(states.measured_names)}
    return pa.table(columns)


def _stack(table: Table, columns: tuple[str, ...]) -> np.ndarray:
    if not columns:
        return np.zeros((table.rows, 0))
    return np.stack([table.numbers(column) for column in columns], axis=1)
