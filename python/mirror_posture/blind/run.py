"""Run a diagnosis over a folder of sealed sessions: resumable, on all cores, one result folder a session.

The diagnosis is handed in as a command, so that this package knows nothing of it: `{session}` and `{out}`
are filled in.
A session counts as done when its `diagnosis.json` is there; a failure is kept as `failure.json`, and tried
again next time.
"""

from __future__ import annotations

import json
import os
import subprocess
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

from .errors import BlindError

RESULT = "diagnosis.json"


@dataclass(frozen=True)
class RunReport:
    """How many sessions were diagnosed now, were there before, and failed."""

    done: int
    before: int
    failed: list[str]


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


def run_sessions(
    cases: Path,
    results: Path,
    command: Sequence[str],
    workers: int | None = None,
    progress: Callable[[str, bool], None] | None = None,
) -> RunReport:
    """Diagnose every session of `cases` that has no result yet, each in a process of its own."""
    if not any("{session}" in part for part in command) or not any("{out}" in part for part in command):
        raise BlindError("the command of a diagnosis must have {session} and {out} in it")
    todo, before = [], 0
    for session in sessions_in(cases):
        if (results / session.name / RESULT).is_file():
            before += 1
        else:
            todo.append(session)
    failed: list[str] = []
    # Threads only wait for the processes; the diagnoses themselves run in parallel.
    with ThreadPoolExecutor(workers or os.cpu_count() or 1) as pool:
        jobs = {
            pool.submit(_diagnose, session, results / session.name, command): session.name for session in todo
        }
        for job in as_completed(jobs):
            ok = job.result()
            if not ok:
                failed.append(jobs[job])
            if progress is not None:
                progress(jobs[job], ok)
    return RunReport(len(todo) - len(failed), before, sorted(failed))


def _diagnose(session: Path, out: Path, command: Sequence[str]) -> bool:
    out.mkdir(parents=True, exist_ok=True)
    filled = [part.replace("{session}", str(session)).replace("{out}", str(out)) for part in command]
    started = time.perf_counter()
    ended = subprocess.run(filled, capture_output=True, text=True, check=False)
    seconds = time.perf_counter() - started
    failure = out / "failure.json"
    if ended.returncode == 0 and (out / RESULT).is_file():
        failure.unlink(missing_ok=True)
        (out / "time.json").write_text(json.dumps({"seconds": seconds}) + "\n", encoding="utf-8")
        return True
    (out / RESULT).unlink(missing_ok=True)
    body = {"command": filled, "code": ended.returncode, "seconds": seconds, "message": ended.stderr[-4000:]}
    failure.write_text(json.dumps(body, indent=1) + "\n", encoding="utf-8")
    return False
