"""A folder that grows has one writer: a lock for the recorder's life, which the system takes from a killed process.

Without it two commands on one folder write the same frame twice, or each replaces the rows of the other. The lock is
advisory (`flock`): readers are never stopped. Where the system has no such locks there is none.
"""

from __future__ import annotations

import os
import platform
import weakref
from pathlib import Path

from ._core import MirrorPostureError

try:
    import fcntl
except ImportError:  # pragma: no cover - Windows
    fcntl = None  # type: ignore[assignment]

LOCK = ".recording.lock"
"""A file of this name in the folder is locked, not the folder itself: whoever replaces a folder in it locks that."""
LONGEST_NAME = 200
"""Bytes of the holder's name at most."""


class FolderLock:
    """The right to write into a folder.

    A second lock of the same process takes the first one's place, as a recording that is gone on with in the same
    program does: then `check` of the first one fails, so that nothing is written twice.
    """

    def __init__(self, folder: Path) -> None:
        """Raises `MirrorPostureError` where another process holds it (with its number), or nothing can be written."""
        self._folder, self._place = folder, folder.resolve() / LOCK
        before = _HELD.get(self._place)
        if before is not None:
            before.release()
        self.held = True
        handle = _locked(folder, self._place)
        # A recorder that nobody holds any more lets go of its folder.
        self._end = weakref.finalize(self, _unlock, handle, self._place, os.getpid())
        _HELD[self._place] = self

    def check(self) -> None:
        """Raises `MirrorPostureError` where the lock was released, or taken over within this process."""
        if not self.held:
            raise MirrorPostureError(
                f"{self._folder}: this recorder has ended, or another one of this program goes on with the folder; nothing was "
                "written; use the newer one, or go on with the folder once more"
            )

    def release(self) -> None:
        """Lets go of the folder; safe to call again."""
        self.held = False
        self._end()


_HELD: weakref.WeakValueDictionary[Path, FolderLock] = weakref.WeakValueDictionary()
"""The locks of this process."""


def _locked(folder: Path, place: Path) -> int | None:
    """The open file that is locked; None where the system has no locks."""
    if fcntl is None:
        return None
    while True:
        try:
            # Not through a link: what it points to would be written over.
            handle = os.open(place, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
        except OSError as error:
            raise MirrorPostureError(f"{place}: cannot be written ({error.strerror})") from error
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.read(handle, LONGEST_NAME).decode("utf-8", "replace").strip() or "another process"
            os.close(handle)
            raise MirrorPostureError(
                f"{folder}: {holder} records into it; needed one recorder at a time: wait until it has ended, or end it"
            ) from None
        except OSError:
            # Some network file systems have no locks.
            os.close(handle)
            place.unlink(missing_ok=True)
            return None
        # Who held it may have removed the file meanwhile: a lock on that keeps nobody out.
        try:
            if os.path.samestat(os.fstat(handle), os.stat(place)):
                break
        except FileNotFoundError:
            pass
        os.close(handle)
    os.ftruncate(handle, 0)
    os.write(handle, f"process {os.getpid()} on {platform.node() or 'this machine'}".encode()[:LONGEST_NAME])
    return handle


def _unlock(handle: int | None, place: Path, process: int) -> None:
    """Removes the file before its lock ends: after it, the file may be another's."""
    if handle is None:
        return
    # A forked child that ends must not let go of its parent's folder.
    if os.getpid() == process:
        try:
            place.unlink(missing_ok=True)
        except OSError:
            pass
    os.close(handle)
