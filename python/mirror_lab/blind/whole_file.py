"""A file that is there as a whole or not at all; this package writes without a line of the product's."""

from __future__ import annotations

import os
from pathlib import Path


def write_whole(file: Path, data: bytes | str) -> None:
    """Writes beside the file's place, waits for the disk, and renames in one step."""
    part = file.with_name(f".{file.name}.part")
    with part.open("wb") as stream:
        stream.write(data.encode("utf-8") if isinstance(data, str) else data)
        stream.flush()
        os.fsync(stream.fileno())
    os.replace(part, file)
