"""Output files and folders, whole or not at all.

Everything is written under a temporary name beside its place, synced to the disk, and renamed in one step.
A full disk, an exception, a kill at any moment and a second writer leave the old or the new result, never a
part of one or a mixture of both. The next run that writes to the same place removes what a killed run left
under its temporary name.

Errors are `MirrorPostureError` and name the file, also where a library's own error does not.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from fnmatch import fnmatch
from pathlib import Path

from ._core import MirrorPostureError

try:
    import fcntl
except ImportError:  # pragma: no cover - Windows
    fcntl = None  # type: ignore[assignment]

WINDOWS = os.name == "nt"
"""On Windows folders cannot be opened, open files cannot be renamed, and a file must be open for writing to
be synced."""
PART = ".part"
"""Ending of a file that is not complete yet."""
MIXED = ".being-replaced"
"""A file of this name in a folder means that its files are being exchanged one by one; it is removed when
all are there."""


def write_file(file: str | os.PathLike[str], data: bytes | str) -> Path:
    """Writes a file in one step; text in UTF-8. Returns its path.

    Raises:
        MirrorPostureError: it cannot be written; the old file is still there.
    """
    with new_file(file) as part:
        part.write_bytes(data.encode("utf-8") if isinstance(data, str) else data)
    return Path(file)


@contextmanager
def new_file(file: str | os.PathLike[str]) -> Iterator[Path]:
    """A path beside the file's, with the same ending, which becomes the file at the end of the block.

    Raises:
        MirrorPostureError: as `write_file`.
    """
    file = Path(file)
    part: Path | None = None
    with _named(file):
        try:
            _remove_left_over(file)
            handle, name = tempfile.mkstemp(
                dir=file.parent, prefix=f".{file.name}-", suffix=PART + file.suffix
            )
            part = Path(name)
            if WINDOWS:
                os.close(handle)
            else:
                _lock(handle)
            try:
                yield part
                _sync(part)
                part.chmod(0o666 & ~_umask())
                os.replace(part, file)
                sync_folder(file.parent)
            finally:
                if not WINDOWS:
                    os.close(handle)
        except BaseException:
            if part is not None:
                part.unlink(missing_ok=True)
            raise


@contextmanager
def new_folder(folder: str | os.PathLike[str], owned: Sequence[str] | None = None) -> Iterator[Path]:
    """A temporary folder beside the folder's place, which takes its place at the end of the block.

    `owned` are patterns of the names that the folder's writer makes: files of these names from an earlier
    run are removed, all others stay. None: everything there is replaced.

    If others' files are there, the new ones are moved in one after the other, and the file `MIXED` exists
    meanwhile; otherwise the whole folder is exchanged in one step.

    Raises:
        MirrorPostureError: it cannot be written; the old folder is still there.
    """
    folder = Path(folder)
    part: Path | None = None
    with _named(folder):
        try:
            place = folder.resolve()
            place.parent.mkdir(parents=True, exist_ok=True)
            _remove_left_over(place)
            part = Path(tempfile.mkdtemp(dir=place.parent, prefix=f".{place.name}-", suffix=PART))
            with _holding(part):
                yield part
                for path in part.rglob("*"):
                    _sync(path)
                part.chmod(0o777 & ~_umask())
                _sync(part)
                with _holding(place.parent):
                    _publish(part, place, owned)
                    _sync(place.parent)
        except BaseException:
            if part is not None:
                shutil.rmtree(part, ignore_errors=True)
            raise


def keep_files(folder: Path, part: Path, besides: Sequence[str]) -> None:
    """Everything of a folder in a new one, as links to the same files, except those of some names (patterns
    of paths in it).

    To be used within `new_folder`: the linked files must not be written into, only replaced.

    Raises:
        MirrorPostureError: an entry is neither a file nor a folder nor a link.
    """
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder)
        if _is_owned(name.as_posix(), besides):
            continue
        target = part / name
        if path.is_symlink():
            target.symlink_to(os.readlink(path))
        elif path.is_dir():
            target.mkdir(exist_ok=True)
        elif not path.is_file():
            raise MirrorPostureError(f"{path}: is no file (a pipe or a device); remove it")
        else:
            try:
                os.link(path, target)
            except OSError:
                # Not on every file system.
                shutil.copy2(path, target)


def is_whole(folder: Path) -> bool:
    """Whether the files of a folder are of one run; False where a run was killed while it exchanged them."""
    return not (folder / MIXED).exists()


def _publish(part: Path, place: Path, owned: Sequence[str] | None) -> None:
    if not place.exists():
        os.replace(part, place)
        return
    if not place.is_dir():
        raise MirrorPostureError(f"{place}: is a file, needed a folder; give another name")
    # A folder that is a process's working directory must stay the same folder.
    stands_in_it = Path.cwd().is_relative_to(place)
    others = owned is not None and any(not _is_owned(path.name, owned) for path in place.iterdir())
    if not others and not stands_in_it and _exchange(part, place):
        shutil.rmtree(part)
        return
    if not others and not stands_in_it:
        _by_two_renames(part, place)
        return
    (place / MIXED).touch()
    _sync(place)
    new = {path.name for path in part.iterdir()}
    for path in list(place.iterdir()):
        if path.name not in new and path.name != MIXED and (owned is None or _is_owned(path.name, owned)):
            _remove(path)
    for path in sorted(part.iterdir()):
        target = place / path.name
        if target.is_dir() and not target.is_symlink():
            _remove(target)
        os.replace(path, target)
        # Renaming one link of a file to another does nothing.
        path.unlink(missing_ok=True)
    _sync(place)
    (place / MIXED).unlink()
    part.rmdir()


def _is_owned(name: str, owned: Sequence[str]) -> bool:
    return name == MIXED or any(fnmatch(name, pattern) for pattern in owned)


def _exchange(part: Path, place: Path) -> bool:
    """Exchanges two folders in one step; False where the system cannot."""
    # Neither Python nor a library on its list of dependencies has this call.
    try:
        libc = ctypes.CDLL(None, use_errno=True)
        if sys.platform == "linux":
            here, exchange = -100, 2
            done = libc.renameat2(here, os.fsencode(part), here, os.fsencode(place), ctypes.c_uint(exchange))
        elif sys.platform == "darwin":
            done = libc.renamex_np(os.fsencode(part), os.fsencode(place), ctypes.c_uint(2))
        else:
            return False
    except (AttributeError, OSError, TypeError):
        return False
    return bool(done == 0)


def _by_two_renames(part: Path, place: Path) -> None:
    """Between the two renames the place is empty, and the old folder is beside it."""
    old = Path(tempfile.mkdtemp(dir=place.parent, prefix=f".{place.name}-old-", suffix=PART))
    os.replace(place, old / place.name)
    try:
        os.replace(part, place)
    except BaseException:
        os.replace(old / place.name, place)
        raise
    shutil.rmtree(old)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink()


def _remove_left_over(place: Path) -> None:
    """Removes what killed runs left beside a place; what a running one holds is locked, and stays."""
    if fcntl is None or not place.parent.is_dir():
        return
    prefix, suffix = f".{place.name}-", (PART, PART + place.suffix)
    for path in place.parent.iterdir():
        if not (path.name.startswith(prefix) and path.name.endswith(suffix)):
            continue
        try:
            handle = os.open(path, os.O_RDONLY)
        except OSError:
            continue
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            _remove(path)
        except OSError:
            pass
        finally:
            os.close(handle)


@contextmanager
def _holding(folder: Path) -> Iterator[None]:
    """A lock on a folder for as long as the block runs; a killed process loses it."""
    if fcntl is None:
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        _lock(handle)
        yield
    finally:
        os.close(handle)


def _lock(handle: int) -> None:
    if fcntl is not None:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX)
        except OSError:
            # Some network file systems have no locks: the renames are whole all the same.
            pass


def _sync(path: Path) -> None:
    """Waits until a file, or a folder's list of names, is on the disk."""
    if path.is_symlink() or (WINDOWS and path.is_dir()):
        return
    handle = os.open(path, os.O_RDWR if WINDOWS else os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def sync_folder(folder: Path) -> None:
    """Waits until a folder's list of names is on disk, where the system allows that."""
    _sync(folder)


@contextmanager
def _named(place: Path) -> Iterator[None]:
    """Errors of the operating system, with the file that was to be written."""
    try:
        yield
    except OSError as error:
        about = "" if error.filename is None else os.fspath(error.filename)
        beside = os.fspath(place.absolute().parent / f".{place.name}-")
        if about and about != os.fspath(place) and not os.path.abspath(about).startswith(beside):
            # Of a file that was read meanwhile.
            raise
        why = " ".join(str(error.strerror or error).split())
        raise MirrorPostureError(
            f"{place}: cannot be written ({why}); what was there before is unchanged"
        ) from error


def _umask() -> int:
    """The process's mask of permissions; temporary files start without any for others."""
    mask = os.umask(0)
    os.umask(mask)
    return mask
