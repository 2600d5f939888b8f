"""The sizes that a Parquet file states of its columns, read from its footer.

pyarrow gives them one column chunk at a time, and ends the process where a chunk's size statistics contradict the schema. So the
footer (Thrift's compact protocol, a tree of numbered fields) is read here. Source: the format's `parquet.thrift`, and
"Thrift compact protocol encoding" of Apache Thrift.
"""

from __future__ import annotations

import struct
from typing import Any

LARGEST_FOOTER = 4_000_000
"""Bytes; that of a table of 1,000 columns has some hundred thousand."""
ROW_GROUPS, COLUMNS, META_DATA, VALUES, UNFOLDED = 4, 1, 3, 5, 6
"""Numbers of fields: `FileMetaData.row_groups`, `RowGroup.columns`, `ColumnChunk.meta_data`, `ColumnMetaData.num_values` and
`total_uncompressed_size`."""


def chunk_sizes(data: bytes, columns: int) -> list[list[tuple[int, int]]]:
    """By row group and column, of so many: how many values there are, and to how many bytes they unfold.

    Raises:
        ValueError: a footer that is damaged or too large.
    """
    length = int.from_bytes(data[-8:-4], "little")
    if length > LARGEST_FOOTER:
        raise ValueError(f"its footer has {length} bytes, needed at most {LARGEST_FOOTER}")
    try:
        groups = _Compact(data[-8 - length : -8]).struct()[ROW_GROUPS]
        chunks = [[chunk[META_DATA] for chunk in group[COLUMNS]] for group in groups]
        sizes = [[(int(chunk[VALUES]), int(chunk[UNFOLDED])) for chunk in group] for group in chunks]
    except (IndexError, KeyError, TypeError, struct.error, RecursionError):
        raise ValueError("its footer is damaged") from None
    if any(len(group) != columns or min(map(min, group), default=0) < 0 for group in sizes):
        raise ValueError("its footer is damaged")
    return sizes


class _Compact:
    """Reads values of the compact protocol from the beginning of some bytes on."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0

    def struct(self) -> dict[int, Any]:
        """The fields of a structure by their numbers."""
        fields: dict[int, Any] = {}
        number = 0
        while (head := self._byte()) & 0x0F:
            number = number + (head >> 4) if head >> 4 else self._signed()
            kind = head & 0x0F
            # The kind of a field tells a Boolean's value.
            fields[number] = kind == 1 if kind in (1, 2) else self._value(kind)
        return fields

    def _value(self, kind: int) -> Any:
        if kind in (1, 2, 3):
            return self._byte()
        if kind in (4, 5, 6):
            return self._signed()
        if kind == 7:
            return struct.unpack("<d", self._take(8))[0]
        if kind == 8:
            return self._take(self._unsigned())
        if kind in (9, 10):
            head = self._byte()
            count = head >> 4 if head >> 4 < 15 else self._unsigned()
            return [self._value(head & 0x0F) for _ in range(count)]
        if kind == 12:
            return self.struct()
        raise KeyError(kind)

    def _byte(self) -> int:
        self._at += 1
        return self._data[self._at - 1]

    def _take(self, count: int) -> bytes:
        if count > len(self._data) - self._at:
            raise IndexError(count)
        self._at += count
        return self._data[self._at - count : self._at]

    def _unsigned(self) -> int:
        value = shift = 0
        while (byte := self._byte()) & 0x80:
            value |= (byte & 0x7F) << shift
            shift += 7
            if shift > 63:
                raise IndexError(shift)
        return value | byte << shift

    def _signed(self) -> int:
        value = self._unsigned()
        return (value >> 1) ^ -(value & 1)
