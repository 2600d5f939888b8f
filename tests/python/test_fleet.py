"""A fleet in processes of its own: a Dask scheduler and two workers, one of which is killed in the middle."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import Future
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import pytest

pytest.importorskip("distributed", reason="a fleet needs the extra `fleet`")
pytest.importorskip("mujoco", reason="blind sessions need MuJoCo")

from typer.testing import CliRunner

from mirror_lab.blind.make import make_cases
from mirror_lab.blind.on_this_machine import on_this_machine
from mirror_lab.blind.runner import Diagnosed, run_sessions, timed
from mirror_lab.blind.simulate import Options
from mirror_posture import MirrorPostureError
from mirror_posture.cli.app import app
from mirror_posture.fleet import (
    PackedSession,
    diagnose_folder,
    hash_of,
    on_fleet,
    pack,
)
from slow_diagnosis import diagnose_slowly

SESSIONS = 4


@dataclass
class Fleet:
    address: str
    workers: list[subprocess.Popen[str]]


def _started(module: str, *arguments: str) -> tuple[subprocess.Popen[str], re.Match[str]]:
    """A process of Dask, once it says that it is there."""
    command = [sys.executable, "-m", "distributed.cli." + module, *arguments]
    paths = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    process = subprocess.Popen(
        command,
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        env={**os.environ, "PYTHONPATH": paths},
    )
    assert process.stderr is not None
    wanted = r"Scheduler at: +(tcp://\S+)" if module == "dask_scheduler" else r"Registered to: +(tcp://\S+)"
    said = []
    for line in process.stderr:
        said.append(line)
        if found := re.search(wanted, line):
            return process, found
    raise RuntimeError("".join(said))


@pytest.fixture(scope="module")
def fleet() -> Iterator[Fleet]:
    quiet = ("--no-dashboard", "--host", "127.0.0.1")
    scheduler, found = _started("dask_scheduler", "--port", "0", *quiet)
    worker = ("--nthreads", "1", "--no-nanny", "--death-timeout", "60", *quiet)
    made = Fleet(found[1], [_started("dask_worker", found[1], *worker)[0] for _ in range(2)])
    yield made
    for process in (*made.workers, scheduler):
        process.kill()
        process.wait()


@pytest.fixture(scope="module")
def cases(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("cases")
    plan = [(f"s{i}", "small", ["joint_offset"]) for i in range(SESSIONS)]
    make_cases(out, SESSIONS, 4, Options(frames=(20, 21), least_postures=10), plan)
    return out


def _documents(results: Path) -> dict[str, dict[str, object]]:
    return {
        p.parent.name: json.loads(p.read_text(encoding="utf-8")) for p in results.glob("*/diagnosis.json")
    }


def test_a_worker_killed_in_the_middle_loses_nothing_and_changes_nothing(
    fleet: Fleet, cases: Path, tmp_path: Path
) -> None:
    here, there = tmp_path / "here", tmp_path / "there"
    local = run_sessions(
        cases,
        here,
        lambda pool, s: pool.submit(partial(timed, diagnose_folder), s),
        partial(on_this_machine, 1),
    )
    assert (local.done, local.failed) == (SESSIONS, [])
    ended: list[str] = []

    def told(name: str, ok: bool) -> None:
        ended.append(name)
        if len(ended) == 1:
            os.kill(fleet.workers[0].pid, signal.SIGKILL)

    def submit(pool: object, session: Path) -> Future[Diagnosed]:
        return pool.submit(timed, diagnose_slowly, pack(session))  # type: ignore[attr-defined, no-any-return]

    afar = run_sessions(cases, there, submit, partial(on_fleet, fleet.address), told)
    why = [p.read_text(encoding="utf-8") for p in there.glob("*/failure.json")]
    assert (afar.done, afar.failed) == (SESSIONS, []), why
    assert fleet.workers[0].wait(timeout=10) == -signal.SIGKILL, "the worker was lost while jobs were waiting"
    assert _documents(here) == _documents(there)


def test_diagnose_gives_the_same_from_the_fleet(fleet: Fleet, cases: Path, tmp_path: Path) -> None:
    folders = [str(cases / n) for n in ("s0", "s1")]
    said = []
    for more in ((), ("--scheduler", fleet.address)):
        done = CliRunner().invoke(app, ["diagnose", *folders, "--json", *more])
        assert done.exit_code == 0, done.output
        said.append(json.loads(done.stdout))
    assert said[0] == said[1] and len(said[0]) == 2


def test_a_scheduler_that_is_not_there_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mirror_posture.fleet.CONNECT_SECONDS", 0.5)
    with pytest.raises(MirrorPostureError, match="no scheduler answers"), on_fleet("tcp://127.0.0.1:9"):
        pass


def test_what_travels_is_checked(tmp_path: Path) -> None:
    (tmp_path / "session").mkdir()
    (tmp_path / "session" / "frames.csv").write_text("frame,posture\n")
    packed = pack(tmp_path / "session")
    assert (packed.unpack(tmp_path / "there") / "frames.csv").read_text() == "frame,posture\n"
    changed = PackedSession(packed.name, {"frames.csv": b"frame,posture\n0,0\n"}, packed.sha256)
    with pytest.raises(MirrorPostureError, match="another hash"):
        changed.unpack(tmp_path / "other")
    for name in ("../escaped", "/tmp/escaped"):
        files = {name: b"x"}
        with pytest.raises(MirrorPostureError, match="leaves the session's folder"):
            PackedSession("session", files, hash_of(files)).unpack(tmp_path / "other")
    (tmp_path / "secret").write_text("x")
    (tmp_path / "session" / "notes").symlink_to(tmp_path / "secret")
    with pytest.raises(MirrorPostureError, match="link that leads out"):
        pack(tmp_path / "session")


def test_tls_options_are_passed_on(tmp_path: Path) -> None:
    from mirror_posture.fleet import Tls, _security, is_open

    files = [tmp_path / name for name in ("ca.pem", "cert.pem", "key.pem")]
    with pytest.raises(MirrorPostureError, match=r"ca\.pem: the file is missing"):
        _security("tls://h:1", Tls(*files))
    for file in files:
        file.touch()
    with pytest.raises(MirrorPostureError, match="starts with tls://"):
        _security("tcp://h:1", Tls(*files))
    security = _security("tls://h:1", Tls(*files))
    assert (
        security.require_encryption
        and security.tls_ca_file == str(files[0])
        and security.tls_client_key == str(files[2])
    )
    assert (
        is_open("tcp://10.0.0.1:8786")
        and not is_open("tls://10.0.0.1:8786")
        and not is_open("tcp://127.0.0.1:8786")
    )
