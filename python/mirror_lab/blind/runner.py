"""Run a diagnosis over a folder of sealed sessions: resumable, on all cores or a fleet, one result folder a
session.

The diagnosis is handed in as a function of a session's folder that returns the text of `diagnosis.json`, and where it
runs as an executor, so that this package depends on neither. A session counts as done when its
`diagnosis.json` is there; a failure is kept as `failure.json`, and tried again next time.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from .errors import BlindError
from .made_of import begin_results
from .whole_file import write_whole

RESULT = "diagnosis.json"
OUTSTANDING = 64
"""Sessions that are submitted at once: enough for a fleet, few enough for the memory."""


@dataclass(frozen=True)
class Diagnosed:
    """A worker's result: the text of diagnosis.json, and its wall and CPU time."""

    document: str
    seconds: float
    cpu_seconds: float


@dataclass(frozen=True)
class RunReport:
    """How many sessions were diagnosed now, were there before, and failed."""

    done: int
    before: int
    failed: list[str]


Session = TypeVar("Session")


def timed(diagnose: Callable[[Session], str], session: Session) -> Diagnosed:
    """One session diagnosed, with its time: what an executor is given to run."""
    clock, cpu = time.perf_counter(), time.process_time()
    document = diagnose(session)
    return Diagnosed(document, time.perf_counter() - clock, time.process_time() - cpu)


def sessions_in(folder: Path) -> list[Path]:
    """The sealed sessions of a folder, by name.

    Raises BlindError where there is none.
    """
    found = sorted(p.parent for p in folder.glob("*/seal.json"))
    if not found:
        raise BlindError(
            f"{folder} has no sealed session (a folder with seal.json): make some with `blind make`"
        )
    return found


def sessions_to_do(cases: Path, results: Path) -> list[Path]:
    """Those that have no result yet."""
    return [s for s in sessions_in(cases) if not (results / s.name / RESULT).is_file()]


def run_sessions(
    cases: Path,
    results: Path,
    submit: Callable[[Executor, Path], Future[Diagnosed]],
    executor: Callable[[], AbstractContextManager[Executor]],
    progress: Callable[[str, bool], None] | None = None,
    leave_out: str | None = None,
) -> RunReport:
    """Diagnose every session of `cases` that has no result yet. Raises BlindError where results that are there are of other sessions, or
    were made with another effect left out.

    `submit` hands one session to an executor that `executor` opens. A pool that a crash has broken is opened
    again; a session that breaks it a second time, alone, has failed.
    """
    todo = sessions_to_do(cases, results)
    names = [session.name for session in todo]
    done = [session.name for session in sessions_in(cases) if session.name not in names]
    before = len(done)
    begin_results(cases, results, done, names, leave_out)
    failed: list[str] = []

    def end(session: Path, ok: bool) -> None:
        if not ok:
            failed.append(session.name)
        if progress is not None:
            progress(session.name, ok)

    crashed: list[Path] = []
    with executor() as pool:
        for session, job in _completed(pool, todo, submit):
            error = job.exception()
            if isinstance(error, BrokenExecutor):
                crashed.append(session)
            else:
                end(session, _keep(results / session.name, job))
    for session in crashed:
        with executor() as pool:
            ((_, job),) = _completed(pool, [session], submit)
            end(session, _keep(results / session.name, job))
    return RunReport(len(todo) - len(failed), before, sorted(failed))


def _completed(
    pool: Executor, todo: list[Path], submit: Callable[[Executor, Path], Future[Diagnosed]]
) -> Iterator[tuple[Path, Future[Diagnosed]]]:
    """Sessions and their jobs as they end; at most `OUTSTANDING` are running."""
    waiting = list(reversed(todo))
    under_way: dict[Future[Diagnosed], Path] = {}
    while waiting or under_way:
        while waiting and len(under_way) < OUTSTANDING:
            session = waiting.pop()
            try:
                under_way[submit(pool, session)] = session
            except BrokenExecutor as error:
                broken: Future[Diagnosed] = Future()
                broken.set_exception(error)
                under_way[broken] = session
        for job in wait(under_way, return_when=FIRST_COMPLETED).done:
            yield under_way.pop(job), job


def _keep(out: Path, job: Future[Diagnosed]) -> bool:
    out.mkdir(parents=True, exist_ok=True)
    failure = out / "failure.json"
    error = job.exception()
    if error is None:
        got = job.result()
        times = {"seconds": got.seconds, "cpu_seconds": got.cpu_seconds}
        write_whole(out / "time.json", json.dumps(times) + "\n")
        # The result is written last: it marks the session as done.
        write_whole(out / RESULT, got.document)
        failure.unlink(missing_ok=True)
        return True
    body = {"error": type(error).__name__, "message": str(error)[-4000:]}
    write_whole(failure, json.dumps(body, indent=1) + "\n")
    return False
