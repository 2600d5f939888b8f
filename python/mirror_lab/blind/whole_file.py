"""Files and folders that are written as a whole or not at all; no code of the product is used."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

try:
    import fcntl
except ImportError:  # pragma: no cover - Windows
    fcntl = None  # type: ignore[assignment]

UNFINISHED = ".part"


def write_whole(file: Path, data: bytes | str) -> None:
    """Writes beside the file's place, waits for the disk, and renames in one step."""
    remove_unfinished(file.parent, file.name)
    handle, name = tempfile.mkstemp(dir=file.parent, prefix=f".{file.name}.", suffix=UNFINISHED)
    part = Path(name)
    try:
        with os.fdopen(handle, "wb") as stream:
            _lock(stream.fileno())
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
    """A folder beside its place, which takes that place at the end of the block; what stood there goes. If the process is killed before,
    nothing is there."""
    place.parent.mkdir(parents=True, exist_ok=True)
    remove_unfinished(place.parent, place.name)
    part = Path(tempfile.mkdtemp(dir=place.parent, prefix=f".{place.name}.", suffix=UNFINISHED))
    handle = None if fcntl is None else os.open(part, os.O_RDONLY)
    try:
        _lock(handle)
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
    finally:
        if handle is not None:
            os.close(handle)


def remove_unfinished(folder: Path, name: str = "") -> None:
    """Removes the remains of killed runs from a folder, of one name or of all; those of a running one are locked and are kept."""
    for path in folder.glob(f".*{UNFINISHED}"):
        if fcntl is None or not path.name.startswith(f".{name}"):
            continue
        try:
            handle = os.open(path, os.O_RDONLY)
        except OSError:
            # Another one removed it.
            continue
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink(missing_ok=True)
        except OSError:
            pass
        finally:
            os.close(handle)


def _lock(handle: int | None) -> None:
    if fcntl is not None and handle is not None:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX)
        except OSError:
            # Some network file systems have no locks.
            pass
