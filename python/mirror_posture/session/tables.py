"""A table file, CSV or Parquet, as checked NumPy columns: a bad value is named by file, row and column.

CSV is read as text and converted a whole column at a time, so that the first bad cell can be found and
quoted as it is in the file, without a loop over the good ones.
"""

from __future__ import annotations

import csv
import io
import os
from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv

from ..arrays import Floats, Integers, Mask
from ..input_files import LARGEST_TABLE, path_inside, read_regular, reason
from ..short_repr import ShortRepr
from .errors import SessionError, choices
from .parquet_sizes import chunk_sizes

SUFFIXES = (".csv", ".parquet")
SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "bars"}
"""What spreadsheets of other languages write between cells."""
MOST_COLUMNS, MOST_CELLS = 5_000, 30_000_000
"""Of a table at most."""
ONE_BLOCK = 1 << 20
"""Bytes that Arrow reads at a time: for less, threads bring nothing."""
LONGEST_FIXED = 64
"""Bytes of a Parquet value of a fixed length at most."""
LARGEST_NUMBER = 1e12
"""A number beyond this is no length, angle, pixel or time, and its square would overflow."""
UNFINISHED = "recording.unfinished"
"""A file of this name in a session's folder means that it is being recorded, or that the recording was cut
off."""


@dataclass(frozen=True, eq=False, repr=False)
class Table(ShortRepr):
    """A table as read, with the name that messages give it."""

    name: str
    columns: dict[str, pa.Array]
    rows: int

    def require(self, *columns: str) -> None:
        """Refuses a table that lacks one of these columns."""
        for column in columns:
            if column not in self.columns:
                raise SessionError(
                    self.name,
                    f"the column {column!r} is missing; got the columns {choices(self.columns)}; "
                    f"needed {choices(columns)}",
                )

    def only(self, kept: Mask) -> Table:
        """The rows that are kept."""
        mask = pa.array(kept)
        columns = {name: array.filter(mask) for name, array in self.columns.items()}
        return Table(self.name, columns, int(kept.sum()))

    def numbers(self, column: str, largest: float = LARGEST_NUMBER) -> Floats:
        """A column as finite doubles of at most this size."""
        values = self._cast(column, pa.float64(), "a finite number")
        bad = np.flatnonzero(~(np.abs(values) <= largest))
        if len(bad):
            raise self._bad_cell(column, int(bad[0]), f"a finite number of at most {largest:g}")
        return values

    def numbers_in(self, column: str, rows: Integers) -> Floats:
        """Some rows of a column as finite doubles; a bad cell is named by its row in the whole table."""
        part = Table(self.name, {column: self.columns[column].take(pa.array(rows))}, len(rows))
        try:
            return part.numbers(column)
        except SessionError as error:
            if error.row is None:
                raise
            raise self._bad_cell(column, int(rows[error.row - 1]), "a finite number") from None

    def blank(self, column: str) -> Mask:
        """(rows,): whether a cell of a column is empty (null, or text of blanks only)."""
        array = self.columns[column]
        empty = array.is_null()
        if pa.types.is_string(array.type) or pa.types.is_large_string(array.type):
            empty = pc.or_(empty, pc.equal(pc.utf8_trim_whitespace(array.fill_null("")), ""))
        result: Mask = empty.to_numpy(zero_copy_only=False).astype(bool)
        return result

    def integers(self, column: str) -> Integers:
        """A column as whole numbers."""
        return self._cast(column, pa.int64(), "a whole number")

    def texts(self, column: str) -> tuple[Integers, list[str]]:
        """A column as codes (one a row) and their distinct texts, in order of appearance."""
        array = self._filled(column, "a name")
        if not pa.types.is_string(array.type) and not pa.types.is_large_string(array.type):
            try:
                array = array.cast(pa.string())
            except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
                raise SessionError(
                    self.name, f"got values of type {array.type}, needed names (text)", column=column
                ) from None
        encoded = pc.utf8_trim_whitespace(array).dictionary_encode()
        return encoded.indices.to_numpy(zero_copy_only=False).astype(np.int64), encoded.dictionary.to_pylist()

    def _filled(self, column: str, needed: str) -> pa.Array:
        array = self.columns[column]
        if array.null_count:
            raise self._bad_cell(
                column, int(np.flatnonzero(array.is_null().to_numpy(zero_copy_only=False))[0]), needed
            )
        return array

    def _cast(self, column: str, kind: pa.DataType, needed: str) -> npt.NDArray[Any]:
        array = self._filled(column, needed)
        if pa.types.is_boolean(array.type) or pa.types.is_temporal(array.type):
            raise SessionError(self.name, f"got values of type {array.type}, needed {needed}", column=column)
        for attempt in (array, None):
            # Cells with blanks around the number are rare: trimmed only where the plain conversion fails.
            if attempt is None:
                if not pa.types.is_string(array.type):
                    break
                attempt = array = pc.utf8_trim_whitespace(array)
            try:
                result: npt.NDArray[Any] = attempt.cast(kind).to_numpy(zero_copy_only=False)
                return result
            except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
                continue
        raise self._bad_cell(column, self._first_that_fails(array, kind), needed)

    @staticmethod
    def _first_that_fails(array: pa.Array, kind: pa.DataType) -> int:
        """The first cell that cannot be converted, by bisection: the cells before `low` all can."""
        low, high = 0, len(array)
        while high - low > 1:
            middle = (low + high) // 2
            try:
                array.slice(low, middle - low).cast(kind)
                low = middle
            except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
                high = middle
        return low

    def _bad_cell(self, column: str, row: int, needed: str) -> SessionError:
        value = self.columns[column][row].as_py()
        shown = "an empty cell" if value is None or value == "" else repr(value)
        return SessionError(
            self.name,
            f"got {shown}, needed {needed}; mend the cell or leave out the row",
            row=row + 1,
            column=column,
        )


def find_table(folder: Path, stem: str) -> Path | None:
    """The file of a table, `<stem>.csv` or `<stem>.parquet`; None where there is neither; both is refused."""
    # An entry that is no file (a pipe, a broken link) is found too; reading it reports the reason.
    found = [folder / (stem + suffix) for suffix in SUFFIXES if os.path.lexists(folder / (stem + suffix))]
    if len(found) > 1:
        raise SessionError(
            f"{stem}.csv", f"there is also {stem}.parquet; remove one, it cannot be known which is meant"
        )
    return found[0] if found else None


def read_table(file: Path, unfinished: bool = False) -> Table:
    """Reads a CSV or Parquet file; refuses one that is no table or names a column twice.

    Of an `unfinished` CSV file everything after the last end of a line is left out: it was being written.
    """
    if path_inside(file.parent, file.name) is None:
        raise SessionError(
            file.name, "is a link that leads out of the session's folder; needed the file itself"
        )
    return open_table(file, unfinished)


def open_table(
    file: Path,
    unfinished: bool = False,
    only: Collection[str] | None = None,
    most_cells: int = MOST_CELLS,
) -> Table:
    """As `read_table`, for a file named by the user, which may be a link; of Parquet `only` some columns,
    if there."""
    name = file.name
    try:
        data = read_regular(file, LARGEST_TABLE)
        parquet = file.suffix == ".parquet"
        table = _read_parquet(data, name, only, most_cells) if parquet else _read_csv(data, name, unfinished)
        names = table.column_names
        table.validate(full=parquet)
    except SessionError:
        raise
    except (pa.ArrowException, csv.Error, OSError, UnicodeDecodeError, ValueError) as error:
        raise SessionError(name, f"cannot be read as a table ({_first_line(reason(error))})") from None
    # Blanks around a name are left out: two names that are the same then would overwrite each other.
    twice = next((column for column, count in Counter(map(str.strip, names)).items() if count > 1), None)
    if twice is not None:
        raise SessionError(
            name,
            f"the column {twice!r} stands there twice (blanks around a name do not count); remove or rename one",
        )
    columns = {}
    for column, chunked in zip(names, table.columns, strict=True):
        array = chunked.combine_chunks()
        if isinstance(array, pa.ChunkedArray):
            array = pa.concat_arrays(array.chunks) if array.num_chunks else pa.array([], chunked.type)
        if pa.types.is_dictionary(array.type):
            array = array.dictionary_decode()
        columns[column.strip()] = array
    return Table(name, columns, table.num_rows)


def _reader(data: bytes) -> pa.BufferReader:
    """A reader of a copy that is Arrow's own.

    A thread of Arrow can be the last to let go of what it reads. Memory of Python's is let go of under Python's lock,
    and a thread that asks for the lock while the process ends is aborted ("terminate called without an active
    exception").
    """
    copy = pa.BufferOutputStream()
    copy.write(data)
    return pa.BufferReader(copy.getvalue())


def _check_size(name: str, columns: int, rows: int, most_cells: int = MOST_CELLS) -> None:
    if columns > MOST_COLUMNS or columns * rows > most_cells:
        raise SessionError(
            name,
            f"has {columns} columns and {rows} rows, needed at most {MOST_COLUMNS} columns and {most_cells} cells",
        )


def _read_parquet(data: bytes, name: str, only: Collection[str] | None, most_cells: int) -> pa.Table:
    """A few bytes of Parquet can expand to any size: the sizes that it states are checked first, and no
    text is expanded before its size is known."""
    # It takes longer to load than most tables to read, and most are CSV.
    from pyarrow import parquet

    told = parquet.read_metadata(pa.BufferReader(data))
    leaves = [told.schema.column(i) for i in range(told.num_columns)]
    if len(leaves) > MOST_COLUMNS:
        _check_size(name, len(leaves), told.num_rows, most_cells)
    wanted = [column for column in told.schema.to_arrow_schema().names if only is None or column in only]
    # A leaf's path is its column's name, and more where it is nested.
    read = [i for i, leaf in enumerate(leaves) if leaf.path.startswith(tuple(wanted))]
    _check_size(name, len(read), told.num_rows, most_cells)
    chunks = [group[i] for group in chunk_sizes(data, len(leaves)) for i in read]
    values, size = sum(chunk[0] for chunk in chunks), sum(chunk[1] for chunk in chunks)
    if size > LARGEST_TABLE or values > most_cells:
        raise SessionError(
            name,
            f"unfolds to {size} bytes and {values} cells, needed at most {LARGEST_TABLE} bytes and {most_cells} cells",
        )
    texts = [leaves[i].path for i in read if leaves[i].physical_type == "BYTE_ARRAY"]
    odd = [leaves[i].path for i in read if leaves[i].length > LONGEST_FIXED]
    if odd := odd + [path for path in texts if path not in wanted]:
        raise SessionError(
            name, f"got the column {odd[0]!r} of long or nested values, needed numbers or names"
        )
    file = parquet.ParquetFile(_reader(data), read_dictionary=texts)
    table = file.read(columns=wanted, use_threads=len(data) > ONE_BLOCK)
    unfolded = sum(_text_bytes(chunk) for text in texts for chunk in table[text].chunks)
    if unfolded > LARGEST_TABLE:
        raise SessionError(name, f"unfolds to {unfolded} bytes of text, needed at most {LARGEST_TABLE}")
    return table


def _text_bytes(chunk: pa.Array) -> int:
    """Bytes of texts, each counted as often as it occurs."""
    if not pa.types.is_dictionary(chunk.type):
        return int(chunk.nbytes)
    lengths = pc.binary_length(chunk.dictionary.cast(pa.binary())).cast(pa.int64())
    return int(pc.sum(lengths.take(chunk.indices)).as_py() or 0)


def _read_csv(data: bytes, name: str, unfinished: bool) -> pa.Table:
    """Every cell as text; empty cells stay empty text."""
    if unfinished:
        data = data[: data.rfind(b"\n") + 1]
    # The header may hold ends of lines between quotes: it is read as a row, of a text that is not copied as a whole.
    names = next(csv.reader(io.TextIOWrapper(io.BytesIO(data), encoding="utf-8-sig", newline="")), [])
    _check_size(name, len(names), data.count(b"\n"))
    if len(names) == 1 and (other := next((c for c in SEPARATORS if c in names[0]), None)):
        raise SessionError(
            name,
            f"its cells are separated by {SEPARATORS[other]}; needed commas, and points in numbers (of a spreadsheet: CSV in English)",
        )
    convert = pyarrow.csv.ConvertOptions(
        column_types=dict.fromkeys(names, pa.string()),
        strings_can_be_null=False,
        quoted_strings_can_be_null=False,
    )
    try:
        return pyarrow.csv.read_csv(
            _reader(data),
            read_options=pyarrow.csv.ReadOptions(use_threads=len(data) > ONE_BLOCK),
            convert_options=convert,
        )
    except pa.ArrowInvalid:
        _name_ragged_row(data, name, convert)
        raise


def _name_ragged_row(data: bytes, name: str, convert: pyarrow.csv.ConvertOptions) -> None:
    """Reads again, row by row, to find the row with the wrong number of cells."""

    # The reader decodes the ragged row before it reports it, and prints what fails: bytes that are no text
    # are named here.
    data.decode("utf-8-sig")
    ragged: list[pyarrow.csv.InvalidRow] = []

    def remember(row: pyarrow.csv.InvalidRow) -> str:
        # An exception raised here would not get through the reader.
        ragged.append(row)
        return "skip"

    pyarrow.csv.read_csv(
        _reader(data),
        read_options=pyarrow.csv.ReadOptions(use_threads=False),
        parse_options=pyarrow.csv.ParseOptions(invalid_row_handler=remember),
        convert_options=convert,
    )
    if ragged:
        row = ragged[0]
        raise SessionError(
            name,
            f"got {row.actual_columns} cells, needed {row.expected_columns} as in the header; mend the row",
            # The reader counts the header as row 1, and no blank lines.
            row=row.number - 1,
        )


def _first_line(text: str) -> str:
    return text.splitlines()[0]
