"""The lines of a CSV file's rows: blank lines are no rows, and a cell in quotes may go over several lines."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..input_files import LARGEST_TABLE, path_inside, read_regular
from .errors import SessionError

_UNEVEN = re.compile(rb'"|\n\r?\n|\r\r|\A[\r\n]')
"""What makes a row's line another than its number tells."""


def row_lines(data: bytes) -> list[int] | None:
    """The line of the header and of each row, counted from 1; None where row r simply is in line r + 1.

    Raises:
        ValueError: bytes that are no UTF-8.
        csv.Error: text that is no CSV.
    """
    if not _UNEVEN.search(data):
        return None
    reader = csv.reader(io.TextIOWrapper(io.BytesIO(data), encoding="utf-8-sig", newline=""))
    lines, before = [], 0
    for cells in reader:
        if cells:
            lines.append(before + 1)
        before = reader.line_num
    return lines


@contextmanager
def told_by_line(place: Path) -> Iterator[None]:
    """Errors that leave the block tell the line of their CSV file: of this one, or of those in this folder.

    The file is read again only then: most sessions are right, and a table keeps no text of its own.
    """
    try:
        yield
    except SessionError as error:
        known: dict[str, list[int] | None] = {}
        for problem in error.problems or (error,):
            name = problem.file.name
            if problem.line is None or problem.row is None:
                continue
            if name not in known:
                known[name] = _lines_of(place, name)
            lines = known[name]
            if lines is not None and problem.row < len(lines):
                problem.move_to_line(lines[problem.row])
        raise


def _lines_of(place: Path, name: str) -> list[int] | None:
    # A file that somebody names may be a link; a session's files may not.
    file = place if place.name == name and not place.is_dir() else path_inside(place, name)
    try:
        return None if file is None else row_lines(read_regular(file, LARGEST_TABLE))
    # What cannot be read has been told: it is the error itself.
    except (OSError, ValueError, csv.Error):
        return None
