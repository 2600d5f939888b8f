"""Limits of recordings, checked before anything is decompressed: files, chunks, pictures, rows.

A recording is read as a stream, whatever its length; the memory in use is limited here. The libraries of
bags decompress a chunk to any size, so each chunk is checked first.
"""

from __future__ import annotations

import bz2
import io
import re
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import IO, Any

import cv2
import numpy as np
from PIL import Image

from .._core import MirrorPostureError
from ..input_files import LARGEST_TABLE, given_text, open_regular, parse_yaml
from ..picture_files import MOST_PIXELS
from .recording import Picture

LARGEST_FILE = 1_000_000_000_000
"""Bytes of a film or a bag at most."""
LARGEST_PACKED = 20_000_000_000
"""Bytes that a packed file of a bag unfolds to at most: its reader unpacks it as a whole, onto the disk."""
LARGEST_CHUNK = LARGEST_TABLE
"""Bytes of a chunk, a record or a message of a bag at most, packed and unpacked."""
MOST_PICTURES = 2_000_000
"""Pictures of a recording at most: 18 hours of 30 a second."""
MOST_POSITIONS = 100_000_000
"""Rows times joints of a recording at most."""
_PLAIN_SQL = re.compile(r"\s*create\s+(table|(unique\s+)?index)\b", re.IGNORECASE)
_COMPUTED = re.compile(r"\bas\b", re.IGNORECASE)
"""In the definition of a table: of a column that is computed from others."""
MOST_BAG_PARTS = 200_000
"""Of a bag's metadata.yaml; each topic has some hundred."""


@contextmanager
def opened(file: Path, needed: str) -> Iterator[IO[bytes]]:
    """A regular file, open for reading; MirrorPostureError if it is not regular or too large."""
    try:
        stream = open_regular(file, LARGEST_FILE)
    except (OSError, ValueError) as error:
        raise MirrorPostureError(
            f"{file}: cannot be read ({getattr(error, 'strerror', None) or error}); needed {needed}"
        ) from None
    with stream:
        yield stream


def checked_size(width: int, height: int, name: str) -> None:
    """Refuses a picture by its size, before it is decoded."""
    if width < 1 or height < 1 or width * height > MOST_PIXELS:
        raise MirrorPostureError(
            f"{name}: got a picture of {width} × {height} px, needed one of at most {MOST_PIXELS // 10**6} million pixels"
        )


def decoded(data: bytes, name: str) -> Picture:
    """A compressed picture as BGR, as stored: a rotation in its file is not applied."""
    try:
        size = Image.open(io.BytesIO(data)).size
    # Errors of many kinds, because a picture's content is arbitrary.
    except Exception as error:
        raise MirrorPostureError(
            f"{name}: a compressed picture cannot be read ({' '.join(str(error).split())[:200]})"
        ) from None
    checked_size(*size, name)
    picture = cv2.imdecode(
        np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
    )
    if picture is None:
        raise MirrorPostureError(f"{name}: a compressed picture cannot be decoded")
    return picture


def counted_pictures(pictures: Iterator[Any], name: str) -> Iterator[Any]:
    """The pictures, as long as they are not too many."""
    for count, picture in enumerate(pictures):
        if count >= MOST_PICTURES:
            raise MirrorPostureError(f"{name}: has more than {MOST_PICTURES} pictures; cut it into parts")
        yield picture


def check_mcap(file: Path) -> None:
    """Refuses an MCAP file whose records or chunks are, or unfold to, more than `LARGEST_CHUNK` bytes."""
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader

    with opened(file, "an MCAP file") as stream:
        for record in StreamReader(stream, emit_chunks=True, record_size_limit=LARGEST_CHUNK).records:
            if isinstance(record, Chunk):
                _check_unfolded(
                    _unfolded_size(record.compression, record.data, record.uncompressed_size), file
                )


def check_bag_folder(folder: Path) -> None:
    """Refuses a ROS 2 bag's folder for its metadata.yaml, or for files that unfold to too much."""
    file = folder / "metadata.yaml"
    try:
        tree = parse_yaml(given_text(file, "a bag's metadata"), "a bag's metadata", MOST_BAG_PARTS)
        told = tree["rosbag2_bagfile_information"]
        names = [Path(str(name)).name for name in told["relative_file_paths"]]
        packed = str(told.get("compression_mode", "")).lower() == "file"
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise MirrorPostureError(
            f"{file}: cannot be read as a bag's metadata ({' '.join(str(error).split())})"
        ) from None
    for name in names:
        with opened(folder / name, "a file of the bag") as stream:
            if packed:
                _check_packed(stream, folder / name)
        if name.endswith(".mcap"):
            check_mcap(folder / name)
        elif name.endswith(".db3"):
            check_sqlite(folder / name)


def _check_packed(stream: IO[bytes], file: Path) -> None:
    """Refuses a packed file that unfolds to too much, or to a database that is none of messages."""
    with tempfile.TemporaryDirectory() as place:
        out = Path(place) / "unpacked"
        with out.open("wb") as unpacked:
            if _unpack(stream, unpacked) > LARGEST_PACKED:
                raise MirrorPostureError(
                    f"{file}: unfolds to more than {LARGEST_PACKED} bytes; unpack it: zstd -d"
                )
        if ".db3" in file.name:
            check_sqlite(out, str(file))


def check_sqlite(file: Path, name: str = "") -> None:
    """Refuses a bag's database in which anything is computed while it is read (views, generated columns), or a message is too large.

    Any SQLite file may hold such things, and reading one row of them may take forever or all memory.
    """
    name = name or str(file)
    try:
        with closing(sqlite3.connect(f"{file.resolve().as_uri()}?mode=ro&immutable=1", uri=True)) as database:
            for (sql,) in database.execute("SELECT sql FROM sqlite_master WHERE sql IS NOT NULL"):
                if not _PLAIN_SQL.match(sql) or _COMPUTED.search(sql):
                    raise MirrorPostureError(
                        f"{name}: got {' '.join(str(sql).split())[:80]!r} in the database, needed plain tables of messages; record it again"
                    )
            largest = database.execute("SELECT max(length(data)) FROM messages").fetchone()[0]
    except (sqlite3.Error, TypeError) as error:
        raise MirrorPostureError(
            f"{name}: cannot be read as a bag's database ({' '.join(str(error).split())[:200]}); record or copy it again"
        ) from None
    _check_unfolded(largest or 0, file)


def check_open_bag(reader: Any, source: Path) -> None:
    """Refuses chunks and messages of a bag, opened by `rosbags`, that unfold to more than `LARGEST_CHUNK` bytes."""
    import zstandard

    for one in reader.readers:
        # ROS 1: a chunk is given by its position in the file and the function that unpacks it.
        for chunk in () if reader.is2 else one.chunks.values():
            _check_unfolded(chunk.datasize, source)
            one.bio.seek(chunk.datapos)
            kind = chunk.decompressor.__module__.lstrip("_")
            _check_unfolded(_unfolded_size(kind, one.bio.read(chunk.datasize), 0), source)
        if reader.is2 and one.compression_mode == "message":
            for storage in one.storage.storages:
                for _, _, data in storage.messages(storage.connections):
                    size = zstandard.frame_content_size(data)
                    _check_unfolded(size if size >= 0 else LARGEST_CHUNK + 1, source)


def _unfolded_size(kind: str, data: bytes, told: int) -> int:
    """Bytes that packed data unfold to; no more than one above `LARGEST_CHUNK` are unfolded to find it."""
    if kind.startswith(("bz2", "lz4")):
        return _counted(bz2.BZ2Decompressor if kind.startswith("bz2") else _lz4(), data)
    if kind == "zstd":
        import zstandard

        # Without a size in the data the decoder expands to the size that the chunk states.
        return max(told, int(zstandard.frame_content_size(data)))
    return max(told, len(data))


def _lz4() -> Any:
    import lz4.frame

    return lz4.frame.LZ4FrameDecompressor


def _counted(decompressor: Any, data: bytes) -> int:
    """Bytes of one packed stream after the other."""
    size = 0
    while data and size <= LARGEST_CHUNK:
        one = decompressor()
        size += len(one.decompress(data, LARGEST_CHUNK + 1 - size))
        data = one.unused_data or b"" if one.eof else b""
    return size


def _unpack(stream: IO[bytes], out: IO[bytes]) -> int:
    """Unpacks a zstd file and returns its bytes; ends where they are too many."""
    import zstandard

    size = 0
    reader = zstandard.ZstdDecompressor().stream_reader(stream, read_across_frames=True)
    while size <= LARGEST_PACKED and (part := reader.read(1 << 22)):
        size += len(part)
        out.write(part)
    return size


def _check_unfolded(size: int, source: Path) -> None:
    if size > LARGEST_CHUNK:
        raise MirrorPostureError(
            f"{source}: a chunk or message unfolds to more than {LARGEST_CHUNK} bytes; record it in smaller chunks"
        )
