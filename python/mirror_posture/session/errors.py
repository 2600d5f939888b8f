"""The error of a session that is refused: it names the file, the row, what was got, what was needed and the fix."""

from __future__ import annotations

from pathlib import Path

from .._core import MirrorPostureError


class SessionError(MirrorPostureError):
    """A session that cannot be meant as it stands.

    The message is one line: place, what was got, what was needed, the fix. `file`, `row` (counted from 1 below
    the header) and `column` say the place again for programs; they are None where they do not apply.
    """

    def __init__(
        self, file: Path | str, problem: str, *, row: int | None = None, column: str | None = None
    ) -> None:
        self.file = Path(file)
        self.row = row
        self.column = column
        place = str(file)
        if row is not None:
            # The header is line 1 of a CSV file; Parquet has no lines.
            place += f", row {row}" + (f" (line {row + 1})" if self.file.suffix == ".csv" else "")
        if column is not None:
            place += f", column {column!r}"
        super().__init__(f"{place}: {problem}")


def choices(names: object, limit: int = 40) -> str:
    """The valid names as a message lists them, shortened where there are very many."""
    listed = [str(name) for name in names]  # type: ignore[attr-defined]
    if not listed:
        return "none"
    more = f", and {len(listed) - limit} more" if len(listed) > limit else ""
    return ", ".join(listed[:limit]) + more
