"""The error of a refused session: it names the file, the row, what was given, what was required and the
fix."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from difflib import SequenceMatcher
from pathlib import Path

from .._core import MirrorPostureError
from ..error_pickling import PickledWhole


class SessionError(PickledWhole, MirrorPostureError):
    """An invalid session.

    The message is one line: place, what was given, what was required, the fix. `file`, `row` (counted from
    1 below the header, blank lines left out), `line` (of a CSV file, as an editor counts) and `column` give
    the place to programs; they are None where they do not apply. `problems` are all that were found in the
    session, this one first.
    """

    problems: tuple[SessionError, ...] = ()

    def __init__(
        self, file: Path | str, problem: str, *, row: int | None = None, column: str | None = None
    ) -> None:
        self.file = Path(file)
        self.row = row
        self.column = column
        self._shown_as, self._problem = str(file), problem
        # The header is line 1 of a CSV file; Parquet has no lines.
        self.line = row + 1 if row is not None and self.file.suffix == ".csv" else None
        super().__init__(self._message())

    def move_to_line(self, line: int) -> None:
        """Tells another line of the file: of one with blank lines, which no row is counted for."""
        self.line = line
        self.args = (self._message(),)

    def _message(self) -> str:
        place = self._shown_as
        if self.row is not None:
            place += f", row {self.row}" + ("" if self.line is None else f" (line {self.line})")
        if self.column is not None:
            place += f", column {self.column!r}"
        return f"{place}: {self._problem}"


class Problems:
    """All that is wrong with a session: what can still be judged after a problem is judged."""

    def __init__(self) -> None:
        self.found: list[SessionError] = []

    @contextmanager
    def kept(self) -> Iterator[None]:
        """A part of the work whose `SessionError` is kept for the end."""
        try:
            yield
        except SessionError as error:
            self.found += error.problems or (error,)

    def add(self, problem: SessionError) -> None:
        """One more."""
        self.found.append(problem)

    def end(self) -> None:
        """Raises the first problem, with all of them in its `problems`."""
        if self.found:
            self.found[0].problems = tuple(self.found)
            raise self.found[0]


def choices(names: object, limit: int = 40, got: str | None = None) -> str:
    """The valid names as a message lists them, shortened where there are very many; those most like `got` first."""
    listed = [str(name) for name in names]  # type: ignore[attr-defined]
    if not listed:
        return "none"
    if got is not None:
        listed.sort(key=lambda name: -SequenceMatcher(None, got, name).ratio())
    more = f", and {len(listed) - limit} more" if len(listed) > limit else ""
    return ", ".join(listed[:limit]) + more


def another_robots(
    file: Path, lacks: object, of: str, has: object, fix: str, kind: str = "joints"
) -> MirrorPostureError:
    """The error of a file of another robot: what it lacks (`joint NAME`, ...) of what was asked for, what it has of this kind, the fix."""
    return MirrorPostureError(
        f"{file}: has no {choices(lacks)}, of {of}; its {kind}: {choices(has)}; is it another robot's? {fix}"
    )
