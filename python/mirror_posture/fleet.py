"""Many sessions at once on a fleet of machines by Dask (extra `fleet`).

The machines need share no disk: a session's files are sent with its job, its diagnosis is returned. The
jobs of a lost worker are repeated by the others, with the same results.

Trust. Dask pickles jobs and results: whoever can connect to the scheduler or to a worker can run code
there, and a scheduler or worker can run code here. Over `tcp://` nothing is encrypted and nobody is
authenticated: use it within one machine or a private network, otherwise `tls://` with certificates (`Tls`).
Sent are every file of the session's folder (and of those to check on), under its name within the folder,
with its hash, and the options of the diagnosis; the text of diagnosis.json is returned. A worker refuses
files with another hash.
"""

from __future__ import annotations

import hashlib
import json
import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ._core import MirrorPostureError, __version__
from .input_files import path_inside
from .session import load_session
from .session.motion import is_moving

if TYPE_CHECKING:
    from .diagnosis import Diagnosis

RETRIES = 3
"""How often a job is tried again that ended with an error of the machine that ran it."""
CONNECT_SECONDS = 15.0
_ADDRESS = re.compile(r"(?:(?:tcp|tls)://)?(?:\[[^\]\s]+\]|[^\s:/]+):\d{1,5}/?")
OPEN_LINE = (
    "--scheduler {}: plain tcp to another machine: whoever is on the way can read the sessions and run code on both ends; "
    "use tls:// beyond a network of your own"
)
LARGEST_BYTES = 512 * 1024 * 1024
"""A session beyond this does not travel: its pictures are to be detected first, where they lie."""


@dataclass(frozen=True)
class Tls:
    """Files of a `tls://` scheduler's certificates, PEM: the authority's, this machine's own, and its key."""

    authority: Path
    certificate: Path
    key: Path


@dataclass(frozen=True)
class PackedSession:
    """A session's folder as it travels: its name, its files by their path within it, and the hash of all."""

    name: str
    files: dict[str, bytes]
    sha256: str

    def unpack(self, below: Path) -> Path:
        """Write the folder below `below`; returns it.

        Raises:
            MirrorPostureError: other files than were packed, or a name that leaves the folder.
        """
        if hash_of(self.files) != self.sha256:
            raise MirrorPostureError(
                f"session {self.name}: what arrived has another hash than what was sent; send it again"
            )
        folder = below / self.name
        if path_inside(below, self.name) is None or any(
            path_inside(folder, place) is None for place in self.files
        ):
            raise MirrorPostureError(f"session {self.name}: got a file name that leaves the session's folder")
        for place, data in self.files.items():
            path = folder / place
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
        return folder


def hash_of(files: Mapping[str, bytes]) -> str:
    """SHA-256 over all names and contents, in the order of the names."""
    whole = hashlib.sha256()
    for place in sorted(files):
        for part in (place.encode(), files[place]):
            whole.update(len(part).to_bytes(8, "big") + part)
    return whole.hexdigest()


def pack(folder: Path) -> PackedSession:
    """Read a session's folder.

    Raises:
        MirrorPostureError: no such folder, one too large to travel, or one with a link that leads out of it.
    """
    if not folder.is_dir():
        raise MirrorPostureError(f"{folder}: no such folder; needed a session's folder")
    files = sorted(p for p in folder.rglob("*") if p.is_file())
    for path in files:
        if path_inside(folder, path.relative_to(folder).as_posix()) is None:
            raise MirrorPostureError(
                f"{path}: is a link that leads out of the session's folder; it would travel along"
            )
    size = sum(p.stat().st_size for p in files)
    if size > LARGEST_BYTES:
        raise MirrorPostureError(
            f"{folder}: {size / 1e6:.0f} MB are too much to send to a fleet (at most {LARGEST_BYTES / 1e6:.0f} MB); "
            "run `mirror-posture detect` on it first and leave images/ out"
        )
    name = folder.name or folder.resolve().name
    packed = {p.relative_to(folder).as_posix(): p.read_bytes() for p in files}
    return PackedSession(name, packed, hash_of(packed))


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
    """The same of a session that was received; its unpacked copy is removed again."""
    with tempfile.TemporaryDirectory(prefix="mirror-posture-") as name:
        below = Path(name)
        others = [other.unpack(below / f"check-{i}") for i, other in enumerate(check)]
        return diagnose_folder(session.unpack(below / "session"), without, others, withhold, most_causes)


@contextmanager
def on_fleet(scheduler: str, tls: Tls | None = None) -> Iterator[Executor]:
    """An executor over the workers of a Dask scheduler, by its address (`tcp://10.0.0.1:8786`, `tls://…`).

    Without `tls` a `tls://` address uses the certificates of Dask's own configuration.

    Raises:
        MirrorPostureError: `distributed` is not installed, there is no answer at the address, or a worker has another version of this package.
    """
    require_address(scheduler)
    try:
        from distributed import Client
    except ModuleNotFoundError as error:
        raise MirrorPostureError(
            "a fleet needs Dask: pip install 'mirror-posture[fleet]', here and on each worker"
        ) from error
    try:
        client = Client(
            scheduler, timeout=CONNECT_SECONDS, set_as_default=False, security=_security(scheduler, tls)
        )
    # Missing or foreign certificates raise errors of several kinds.
    except (OSError, ValueError, RuntimeError, TypeError) as error:
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


def require_address(scheduler: str) -> None:
    """Raises `MirrorPostureError` for what is no address of a scheduler: Dask would try it for half a minute, and end with a traceback."""
    if not _ADDRESS.fullmatch(scheduler):
        raise MirrorPostureError(
            f"--scheduler: got {scheduler!r}, needed tcp://HOST:PORT or tls://HOST:PORT, as in tcp://10.0.0.1:8786"
        )


def is_open(scheduler: str) -> bool:
    """Whether what travels to a scheduler can be read and changed by others: plain tcp to another machine."""
    kind, _, place = scheduler.partition("://")
    host = place.rpartition(":")[0].strip("[]")
    return kind != "tls" and host not in ("localhost", "::1") and not host.startswith("127.")


def _security(scheduler: str, tls: Tls | None) -> Any:
    from distributed.security import Security

    if tls is None:
        return None
    if not scheduler.startswith("tls://"):
        raise MirrorPostureError(
            f"--scheduler {scheduler}: got certificates, needed an address that starts with tls://"
        )
    for file in (tls.authority, tls.certificate, tls.key):
        if not file.is_file():
            raise MirrorPostureError(f"{file}: the file is missing; needed a certificate or key in PEM")
    return Security(
        tls_ca_file=str(tls.authority),
        tls_client_cert=str(tls.certificate),
        tls_client_key=str(tls.key),
        require_encryption=True,
    )


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
    tls: Tls | None = None,
) -> Iterator[Diagnosis]:
    """The diagnoses of many sessions, in their order, by the workers of a Dask scheduler.

    The same documents as `diagnosis.diagnose` gives here; options as there.

    Raises:
        MirrorPostureError: a session in motion, at once; later as `on_fleet` and `diagnosis.diagnose` do.
    """
    for folder in folders:
        # Workers diagnose still postures only: each picture of a motion would be taken for one.
        if _moves(folder):
            raise MirrorPostureError(
                f"--scheduler: {folder} is a session in motion, needed sessions of still postures; diagnose it here, without --scheduler"
            )
    return _from_fleet(folders, scheduler, without, check, withhold, most_causes, tls)


def _moves(folder: Path) -> bool:
    try:
        return is_moving(load_session(folder))
    except MirrorPostureError:
        # Told where it is diagnosed.
        return False


def _from_fleet(
    folders: Sequence[Path], scheduler: str, without: Sequence[str], check: Sequence[Path], withhold: Sequence[str],
    most_causes: int | None, tls: Tls | None,
) -> Iterator[Diagnosis]:  # fmt: skip
    from .diagnosis import Diagnosis

    others = [pack(folder) for folder in check]
    with on_fleet(scheduler, tls) as pool:
        jobs = [
            pool.submit(diagnose_packed, pack(folder), without, others, withhold, most_causes)
            for folder in folders
        ]
        for job in jobs:
            yield Diagnosis.from_document(json.loads(job.result()))
