"""Files and folders that are there as a whole or not at all; this package writes without a line of the product's."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

UNFINISHED = ".part"


def write_whole(file: Path, data: bytes | str) -> None:
    """Writes beside the file's place, waits for the disk, and renames in one step."""
    handle, name = tempfile.mkstemp(dir=file.parent, prefix=f".{file.name}.", suffix=UNFINISHED)
    part = Path(name)
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(data.encode("utf-8") if isinstance(data, str) else data)
            stream.flush()
            os.fsync(stream.fileno())
        part.chmod(0o644)
        os.replace(part, file)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


@contextmanager
def whole_folder(place: Path) -> Iterator[Path]:
    """A folder beside its place, which takes that place at the end of the block; what stood there goes. Killed between, nothing is there.

    What a killed run left beside is removed by `remove_unfinished`.
    """
    place.parent.mkdir(parents=True, exist_ok=True)
    part = Path(tempfile.mkdtemp(dir=place.parent, prefix=f".{place.name}.", suffix=UNFINISHED))
    try:
        yield part
        part.chmod(0o755)
        for path in part.rglob("*"):
            if path.is_file():
                with path.open("rb") as stream:
                    os.fsync(stream.fileno())
        old = part.with_name(f"{part.name.removesuffix(UNFINISHED)}.old{UNFINISHED}")
        if place.exists():
            os.replace(place, old)
        os.replace(part, place)
        shutil.rmtree(old, ignore_errors=True)
    except BaseException:
        shutil.rmtree(part, ignore_errors=True)
        raise


def remove_unfinished(folder: Path) -> None:
    """Removes what killed runs left in a folder; for whoever alone writes there."""
    for path in folder.glob(f".*{UNFINISHED}"):
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink()
