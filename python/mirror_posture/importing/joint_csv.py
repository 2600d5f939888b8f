"""The joints' log of a film or of pictures: a CSV in any common dialect."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from .._core import MirrorPostureError
from ..input_files import LARGEST_TABLE, given_text
from ..session.errors import SessionError, choices
from ..session.lines import told_by_line
from ..session.tables import LARGEST_NUMBER, Table, open_table
from .recording import JointLog

TIME, MEASURED = "time_s", "measured:"
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
NEEDED = "a CSV with time_s and a column for each joint"


def joint_csv(file: Path, degrees: bool, time: str = TIME) -> JointLog:
    """A CSV with a column of time and one for each joint, optionally `measured:<joint>`, rad (or degrees) and m.

    `time` names the column of time, with its unit where that is not s: `stamp=ms`. Columns that hold no number at all (notes), and
    measurements of only some of the joints, are told in `others`. Semicolons or tabs between the cells, and decimal commas between semicolons, are read as well.

    Raises:
        MirrorPostureError: no such file, no such column, a cell that is no number.
    """
    column, _, unit = time.partition("=")
    if unit not in ("", *SECONDS):
        raise MirrorPostureError(
            f"--time: got {time!r}, needed COLUMN or COLUMN=UNIT with {choices(SECONDS)}"
        )
    with told_by_line(file):
        return _log(file, column, SECONDS[unit or "s"], degrees)


def _log(file: Path, column: str, second: float, degrees: bool) -> JointLog:
    """As `joint_csv`, with the column of time and how many seconds its unit has."""
    table = _table(file)
    if column not in table.columns:
        raise SessionError(
            file.name,
            f"the column {column!r} is missing; it has {choices(table.columns)}; --time COLUMN says which is the time, --time COLUMN=ms in "
            "milliseconds",
        )
    others = tuple(name for name in table.columns if name != column and _is_text(table, name))
    names = tuple(
        name for name in table.columns if name not in (column, *others) and not name.startswith(MEASURED)
    )
    if not names:
        raise SessionError(file.name, f"has no column for a joint; it has {choices(table.columns)}")
    factor = np.pi / 180.0 if degrees else 1.0
    position = factor * np.stack([table.numbers(name) for name in names], axis=1)
    told = tuple(name for name in table.columns if name.startswith(MEASURED) and name not in others)
    measured = None
    if set(told) == {MEASURED + name for name in names}:
        measured = factor * np.stack([table.numbers(MEASURED + name) for name in names], axis=1)
    else:
        others += told
    # The limit is one of seconds: a Unix time in ns is 1.8e18. The origin stays, as pictures may be named by the same clock.
    seconds = second * table.numbers(column, LARGEST_NUMBER / second)
    return JointLog(seconds, names, position, measured, commanded=True, others=others, source=file.name)


def _table(file: Path) -> Table:
    """The table, with commas between its cells."""
    if file.suffix == ".parquet":
        return open_table(file)
    text = given_text(file, NEEDED, LARGEST_TABLE)
    head = text.partition("\n")[0]
    between = next((one for one in (";", "\t") if one in head and "," not in head), None)
    if between is None:
        return open_table(file)
    with tempfile.TemporaryDirectory() as folder:
        # Under its own name: errors tell it.
        mended = Path(folder) / file.name
        mended.write_text(text.replace(",", ".").replace(between, ","), encoding="utf-8")
        return open_table(mended)


def _is_text(table: Table, name: str) -> bool:
    """Whether no cell of a column is a number: a note, not a joint with a cell that is broken."""
    for cell in table.columns[name].to_pylist():
        try:
            float(cell)
        except (TypeError, ValueError):
            continue
        return False
    return len(table.columns[name]) > 0
