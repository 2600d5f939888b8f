"""Output of commands: tables and progress for people, one JSON document for programs."""

from __future__ import annotations

import enum
import json
import math
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, TypeVar

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from rich.progress import Progress

WIDEST, NARROW = 400, 125
"""Columns of a page without edge, and of a terminal on which the long tables do not fit."""
CONTROLS = {
    chr(c) for c in (*range(32), *range(127, 160), *range(0x202A, 0x202F), *range(0x2066, 0x206A))
} - {"\n", "\t"}
"""What moves a terminal's cursor, changes its title or turns the direction of its text."""
Item = TypeVar("Item")


class ExitCode(enum.IntEnum):
    """Exit codes of every command."""

    FINE = 0
    INPUT = 1
    """The input is invalid; one line says where and why."""
    USAGE = 2
    """The command was called wrongly."""
    NOTHING = 3
    """The input is fine and nothing could be measured from it."""
    FAULT = 4
    """A fault of this program."""
    STOPPED = 130
    """Stopped with Ctrl-C."""


MaxResidualPx = Annotated[
    float, typer.Option(help="Refuse a view of the board that is farther from a flat one (RMS), px ...")
]
MaxResidualSquares = Annotated[
    float,
    typer.Option(help="... and than this share of its squares' side, which never allows more than 3 px."),
]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print one JSON document instead of tables; messages go to stderr.")
]
SessionArgument = Annotated[
    Path, typer.Argument(help="The session's folder (the one with session.toml in it).", show_default=False)
]


class Output:
    """Destination of a command's text: stdout for people, stderr if stdout is for a program."""

    _current: ClassVar[Output | None] = None

    def __init__(self, as_json: bool = False) -> None:
        self.as_json = as_json
        self.messages = _console(as_json)
        self.errors = _console(stderr=True)
        Output._current = self

    @classmethod
    def current(cls) -> Output:
        """The running command's output; before there is one, that for people."""
        return cls._current or cls()

    @property
    def narrow(self) -> bool:
        """Whether the long tables must leave out what can be left out."""
        return self.messages.is_terminal and self.messages.width < NARROW

    def say(self, text: str, style: str | None = None) -> None:
        """One line for people."""
        self.messages.print(Text(shown(text)), style=style)

    def warn(self, text: str) -> None:
        """A warning, on stderr."""
        self.errors.print(Text.assemble(("warning:", "yellow"), f" {shown(text)}"))

    def table(
        self, title: str, columns: Iterable[str], rows: Iterable[Iterable[str]], caption: str = ""
    ) -> None:
        """A table for people, as `made_table`."""
        if not self.as_json:
            self.messages.print(made_table(title, columns, rows, caption), soft_wrap=False)

    def result(self, document: Any) -> None:
        """The command's result as JSON, if requested."""
        if self.as_json:
            json.dump(plain(document), sys.stdout, indent=2, allow_nan=False, ensure_ascii=False)
            sys.stdout.write("\n")

    def progress(self, items: Iterable[Item], what: str, total: int | None = None) -> Iterable[Item]:
        """The items, with a bar on stderr while they are worked on (where stderr is a terminal)."""
        with _bar() as bar:
            yield from bar.track(items, description=escape(what), total=total)

    def chunks(self, chunks: Iterable[list[int]], what: str) -> Iterable[list[int]]:
        """Lists of items, with a bar that counts the items."""
        lists = list(chunks)
        with self.counting(what, sum(map(len, lists))) as count:
            done = 0
            for chunk in lists:
                yield chunk
                done += len(chunk)
                count(done)

    @contextmanager
    def counting(self, what: str, total: int) -> Iterator[Callable[[int], None]]:
        """A progress bar on stderr (if that is a terminal) for work of known length."""
        with _bar() as bar:
            task = bar.add_task(escape(what), total=total)
            yield lambda done: bar.update(task, completed=done)

    @contextmanager
    def working(self, what: str) -> Iterator[Callable[[str], None]]:
        """The current step, on stderr (if that is a terminal), for work of unknown length."""
        console = Console(stderr=True, emoji=False)
        with console.status(escape(what)) as status:
            yield lambda stage: status.update(escape(shown(stage)))

    def problem(self, text: str) -> None:
        """One of several errors, on stderr."""
        self.errors.print(Text.assemble(("error:", "red"), f" {shown(text)}"))

    def fail(self, message: str, error: BaseException, code: int) -> None:
        """An error as one line on stderr and, if JSON was requested, as a document on stdout."""
        self.problem(message)
        if self.as_json:
            place = {name: getattr(error, name, None) for name in ("file", "row", "column")}
            others = [str(other) for other in getattr(error, "problems", ())[1:]]
            more = {"others": others} if others else {}
            self.result({"error": {"message": message, "exit_code": int(code), **place, **more}})


def made_table(title: str, columns: Iterable[str], rows: Iterable[Iterable[str]], caption: str = "") -> Table:
    """A table for a terminal. A column's name starts with `*` for text, with `~` for text that may be folded; otherwise numbers."""
    columns = list(columns)
    table = Table(
        title=Text(shown(title), style="table.title"),
        caption=Text(shown(caption), style="table.caption") if caption else None,
        title_justify="left",
        caption_justify="left",
        show_header=any(column.strip("*~") for column in columns),
    )
    # Names and cells are literal text, never markup: a marker's name may look like markup.
    for column in columns:
        text = column.startswith(("*", "~"))
        table.add_column(
            Text(shown(column.lstrip("*~"))),
            justify="left" if text else "right",
            no_wrap=not column.startswith("~"),
        )
    for row in rows:
        table.add_row(*(Text(shown(cell)) for cell in row))
    return table


def shown(text: str) -> str:
    """A text as a terminal may get it: control characters, which could move its cursor or change its title, are replaced."""
    return "".join("\N{REPLACEMENT CHARACTER}" if c in CONTROLS else c for c in text)


def write_json(file: Path, document: Any) -> Path:
    """Writes a result as JSON, as `--json` prints it."""
    from ..output_files import write_file

    return write_file(file, json.dumps(plain(document), indent=1, allow_nan=False))


def _console(stderr: bool) -> Console:
    """A file or a pipe has no width: what would be cut off there is lost."""
    # Names with colons (`a:B:`) are no emoji.
    console = Console(stderr=stderr, highlight=False, soft_wrap=True, emoji=False)
    if not console.is_terminal:
        console.width = WIDEST
    return console


def _bar() -> Progress:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(compact=True),
    )
    return Progress(*columns, console=Console(stderr=True, emoji=False), transient=True)


def plain(value: Any) -> Any:
    """A value in JSON's types: arrays as lists, dataclasses as objects, what is not finite as null."""
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    # NumPy takes a third of the time that a command takes to start, and `--help` has no use for it.
    numpy = sys.modules.get("numpy")
    if numpy is not None and isinstance(value, (numpy.ndarray, numpy.generic)):
        return plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Path):
        return str(value)
    return value
