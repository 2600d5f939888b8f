"""Many sessions at once: on the cores of this machine, or on a fleet of machines by Dask (extra `fleet`).

A fleet's machines need share no disk: a session's files travel with its job, its diagnosis travels back. A worker
that is lost takes nothing with it: its jobs are done again by the others, and give the same results.
"""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING

from ._core import MirrorPostureError, __version__

if TYPE_CHECKING:
    from .diagnosis import Diagnosis

RETRIES = 3
"""How often a job is tried again that ended with an error of the machine that ran it."""
CONNECT_SECONDS = 15.0
LARGEST_BYTES = 512 * 1024 * 1024
"""A session beyond this does not travel: its pictures are to be detected first, where they lie."""


@dataclass(frozen=True)
class PackedSession:
    """A session's folder as it travels: its name, and its files by their path within it."""

    name: str
    files: dict[str, bytes]

    def unpack(self, below: Path) -> Path:
        """Write the folder below `below`; returns it."""
        folder = below / self.name
        for place, data in self.files.items():
            path = folder / place
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
        return folder


def pack(folder: Path) -> PackedSession:
    """Read a session's folder.

    Raises:
        MirrorPostureError: no such folder, or one too large to travel.
    """
    if not folder.is_dir():
        raise MirrorPostureError(f"{folder}: no such folder; needed a session's folder")
    files = sorted(p for p in folder.rglob("*") if p.is_file())
    size = sum(p.stat().st_size for p in files)
    if size > LARGEST_BYTES:
        raise MirrorPostureError(
            f"{folder}: {size / 1e6:.0f} MB are too much to send to a fleet (at most {LARGEST_BYTES / 1e6:.0f} MB); "
            "run `mirror-posture detect` on it first and leave images/ out"
        )
    name = folder.name or folder.resolve().name
    return PackedSession(name, {p.relative_to(folder).as_posix(): p.read_bytes() for p in files})


def checked_effects(names: Sequence[str]) -> list[str]:
    """The names of effects, where all are of the vocabulary.

    Raises:
        MirrorPostureError: an effect that is none; the message lists those that are.
    """
    from .diagnosis.vocabulary import checked_effects as checked

    return checked(names)


def diagnose_folder(
    folder: Path, without: Sequence[str] = (), check: Sequence[Path] = (), withhold: Sequence[str] = (),
    most_causes: int | None = None,
) -> str:  # fmt: skip
    """The text of diagnosis.json of one session's folder; options as of `diagnosis.diagnose`."""
    from .diagnosis import diagnose
    from .diagnosis.run import MOST_CAUSES

    most = MOST_CAUSES if most_causes is None else most_causes
    return diagnose(folder, without=without, check=check, withhold=withhold, most_causes=most).to_json()


def diagnose_packed(
    session: PackedSession, without: Sequence[str] = (), check: Sequence[PackedSession] = (),
    withhold: Sequence[str] = (), most_causes: int | None = None,
) -> str:  # fmt: skip
    """The same of a session that has travelled; what it was unpacked to is removed again."""
    with tempfile.TemporaryDirectory(prefix="mirror-posture-") as name:
        below = Path(name)
        others = [other.unpack(below / f"check-{i}") for i, other in enumerate(check)]
        return diagnose_folder(session.unpack(below / "session"), without, others, withhold, most_causes)


@contextmanager
def on_this_machine(workers: int | None = None) -> Iterator[Executor]:
    """An executor over this machine's cores, a process each, every one computing on one thread."""
    kept = {name: os.environ.get(name) for name in _ONE_THREAD}
    os.environ.update(_ONE_THREAD)
    try:
        with ProcessPoolExecutor(workers or os.cpu_count() or 1, mp_context=get_context("spawn")) as pool:
            yield pool
    finally:
        for name, value in kept.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


_ONE_THREAD = {"RAYON_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


@contextmanager
def on_fleet(scheduler: str) -> Iterator[Executor]:
    """An executor over the workers of a Dask scheduler, by its address (`tcp://10.0.0.1:8786`).

    Raises:
        MirrorPostureError: `distributed` is not installed, nobody answers at the address, or a worker has another
            version of this package.
    """
    try:
        from distributed import Client
    except ModuleNotFoundError as error:
        raise MirrorPostureError(
            "a fleet needs Dask: pip install 'mirror-posture[fleet]', here and on each worker"
        ) from error
    try:
        client = Client(scheduler, timeout=CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError) as error:
        raise MirrorPostureError(
            f"--scheduler {scheduler}: no scheduler answers there ({error}); start one with `dask scheduler`"
        ) from error
    with client:
        # Functions travel by name: each machine needs them in the same version.
        versions = client.run(_version, on_error="return")
        others = {address: got for address, got in versions.items() if got != __version__}
        if not versions or others:
            told = [f"{address} has {got}" for address, got in others.items()] or ["it has no worker"]
            raise MirrorPostureError(
                f"--scheduler {scheduler}: needed workers with mirror-posture {__version__}; {', '.join(told)}"
            )
        yield client.get_executor(pure=False, retries=RETRIES)


def _version() -> str:
    """What a worker has."""
    return __version__


def diagnose_on_fleet(
    folders: Sequence[Path],
    scheduler: str,
    *,
    without: Sequence[str] = (),
    check: Sequence[Path] = (),
    withhold: Sequence[str] = (),
    most_causes: int | None = None,
) -> Iterator[Diagnosis]:
    """The diagnoses of many sessions, in their order, by the workers of a Dask scheduler.

    The same documents as `diagnosis.diagnose` gives here; options as there.

    Raises:
        MirrorPostureError: as `on_fleet` and `diagnosis.diagnose` do.
    """
    from .diagnosis import Diagnosis

    others = [pack(folder) for folder in check]
    with on_fleet(scheduler) as pool:
        jobs = [
            pool.submit(diagnose_packed, pack(folder), without, others, withhold, most_causes)
            for folder in folders
        ]
        for job in jobs:
            yield Diagnosis.from_document(json.loads(job.result()))
