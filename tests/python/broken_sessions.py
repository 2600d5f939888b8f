"""Sessions broken by a script: each must end in a clear error or a right answer.

`python tests/python/broken_sessions.py` makes three sound sessions, whose diagnosis names a cause, breaks them in the ways of
`session_breaks`, every way in turn, and diagnoses them, each in a process of its own; sessions that are given are broken instead. Wrong
are: the verdict `none` or no gap (the cause is still there), an answer where a refusal is due, another answer where nothing that counts
was changed, exit code 4, a traceback, an error of several lines, more than 5 s of computing or 1 GB of memory. A short run is a test.

With `--log FILE` a run can be ended at any moment and be gone on with; `--again` runs those once more that ended wrongly, and `--keep FOLDER`
keeps them.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import json
import os
import random
import resource
import shutil
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

from session_breaks import KINDS, Kind, NotHere

MOST_SECONDS, MOST_KB = 5.0, 1_000_000
MOST_BYTES = 8_000_000_000
"""Of address space: the machine is not to be brought down."""
LONGEST_CPU_S = 10
"""Who computes for so long is ended: it has failed already."""
ENDLESS_SECONDS = 1800.0
"""Wall time: a machine may be busy with other work."""

Causes = tuple[tuple[str, str], ...]


@dataclass
class End:
    """How a broken session ended."""

    number: int
    kind: str
    what: str
    code: int
    verdict: str | None
    text: str
    cpu_s: float
    memory_kb: int
    faults: list[str]


def diagnose(number: int, folder: Path, kind: Kind, what: str, whole: tuple[str, Causes]) -> End:
    """Diagnoses in a forked process, whose time and memory are its own."""
    out, err = folder.parent / "stdout", folder.parent / "stderr"
    begun, child = time.monotonic(), os.fork()
    if child == 0:
        try:
            for number, file in ((1, out), (2, err)):
                handle = os.open(file, os.O_CREAT | os.O_WRONLY | os.O_TRUNC)
                os.dup2(handle, number)
            # Whatever stands in their place: a test runner catches what is written to them.
            sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
            resource.setrlimit(resource.RLIMIT_CPU, (LONGEST_CPU_S, LONGEST_CPU_S))
            resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, MOST_BYTES))
            sys.argv = ["mirror-posture", "diagnose", str(folder), "--json"]
            from mirror_posture.cli.app import main

            main()
        except SystemExit as end:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(int(end.code or 0))
        except BaseException:
            import traceback

            traceback.print_exc()
            sys.stderr.flush()
        os._exit(99)
    while True:
        done, status, usage = os.wait4(child, os.WNOHANG)
        if done:
            break
        if time.monotonic() - begun > ENDLESS_SECONDS:
            os.kill(child, 9)
        time.sleep(0.005)
    code = os.waitstatus_to_exitcode(status)
    said, text = out.read_text(errors="replace"), err.read_text(errors="replace")
    tree = json.loads(said) if said.strip() and code != 99 else {}
    verdict = tree.get("verdict")
    seconds, memory = usage.ru_utime + usage.ru_stime, usage.ru_maxrss
    errors = [line for line in text.splitlines() if line.startswith("error:")]
    faults = []
    if code not in (0, 1, 3):
        faults.append(f"exit code {code}")
    if "Traceback" in text or "fault of this program" in text or "panicked" in text:
        faults.append("a traceback or a panic")
    if code == 1 and (len(errors) != 1 or len(errors[0]) < 25):
        faults.append("no single clear error")
    gap = tree.get("gap", {})
    if code == 0 and verdict == "none":
        faults.append("nothing is wrong, it says")
    if (
        code == 0
        and verdict not in (None, "insufficient")
        and not any(gap.get(f"{when}_{unit}") for when in ("before", "after") for unit in ("m", "px"))
    ):
        faults.append("a verdict without a gap")
    if kind.must == "refused" and code == 0 and verdict != "insufficient":
        faults.append(f"taken, and found {verdict}")
    if kind.must == "same" and (verdict, causes_of(tree)) != whole:
        faults.append(f"not as the whole session: {verdict}, {causes_of(tree)}")
    if seconds > MOST_SECONDS or memory > MOST_KB:
        faults.append(f"{seconds:.1f} s, {memory / 1000:.0f} MB")
    return End(number, kind.name, what, code, verdict, text, seconds, memory, faults)


def causes_of(tree: dict[str, object]) -> Causes:
    causes = tree.get("causes", [])
    assert isinstance(causes, list)
    return tuple((cause["effect"], cause["at"]) for cause in causes)


def whole_diagnoses(sessions: Sequence[Path], below: Path) -> dict[Path, tuple[str, Causes]]:
    """What the sessions say before they are broken, found in processes of their own: the core's threads must not be there when this one is forked."""
    wholes = {}
    for session in sessions:
        file = below / "whole.json"
        if (child := os.fork()) == 0:
            from mirror_posture.diagnosis import diagnose as diagnose_whole

            file.write_text(diagnose_whole(session).to_json(), encoding="utf-8")
            os._exit(0)
        assert os.waitpid(child, 0)[1] == 0
        tree = json.loads(file.read_text(encoding="utf-8"))
        assert tree["causes"], (
            f"{session} names no cause: what breaks it could not be told from what is right"
        )
        wholes[session] = (tree["verdict"], causes_of(tree))
    return wholes


def run(
    sessions: Sequence[Path],
    count: int,
    seed: int,
    below: Path,
    *,
    skip: int = 0,
    done: Collection[int] = (),
    seconds: float = 1e9,
    tell: Callable[[End, Path], None] = lambda end, folder: None,
) -> list[End]:
    """Breaks the sessions, every way in turn, each in a copy below a folder; those of the numbers `done` are left out, and count."""
    until = time.monotonic() + seconds
    # Imported once: a child's time is that of its own work.
    import matplotlib.figure  # noqa: F401

    import mirror_posture.cli.app
    import mirror_posture.detect
    import mirror_posture.diagnosis  # noqa: F401

    wholes = whole_diagnoses(sessions, below)
    ends: list[End] = []
    number, left = skip, count
    while left > 0 and time.monotonic() < until:
        session, kind = sessions[(number // len(KINDS) + number) % len(sessions)], KINDS[number % len(KINDS)]
        number += 1
        chance = random.Random(f"{seed}-{number}")
        if number in done:
            left -= 1
            continue
        place = below / "broken"
        shutil.rmtree(place, ignore_errors=True)
        folder = place / "session"
        shutil.copytree(session, folder)
        try:
            how = kind.make(folder, chance)
        except NotHere:
            continue
        left -= 1
        what = f"{seed}-{number} {session.name}, {kind.name}: {how}"
        ends.append(diagnose(number, folder, kind, what, wholes[session]))
        tell(ends[-1], folder)
    return ends


def sound_sessions(below: Path) -> list[Path]:
    """Three sessions of the embedded robot's right arm, whose elbow is off by 0.03 rad or turns 5 % too far."""
    from mirrored_session import write_mirrored
    from tracked_session import write_tracked

    def off(q: dict[str, float]) -> dict[str, float]:
        return {**q, "r_elbow": q["r_elbow"] + 0.03}

    def geared(q: dict[str, float]) -> dict[str, float]:
        return {**q, "r_elbow": q["r_elbow"] * 1.05}

    return [
        write_tracked(below / "tracked", 3, off),
        write_mirrored(below / "mirrored", 4, off, 24),
        write_mirrored(below / "with encoders", 5, geared, 24, True),
    ]


def table(ends: Sequence[End]) -> str:
    """How the sessions ended, by kind, as a table of Markdown."""
    rows: dict[str, Counter[str]] = defaultdict(Counter)
    for end in ends:
        rows[end.kind]["refused" if end.code == 1 else end.verdict or "?"] += 1
        rows[end.kind]["wrong"] += bool(end.faults)
    columns = ["refused", "insufficient", "unknown", "partial", "explained", "none", "wrong"]
    lines = [f"| broken by | must be | {' | '.join(columns)} |", "| --- " * (len(columns) + 2) + "|"]
    must = {kind.name: kind.must for kind in KINDS}
    for name, counts in [*rows.items(), ("**all**", sum(rows.values(), Counter()))]:
        lines.append(f"| {name} | {must.get(name, '')} | {' | '.join(str(counts[c]) for c in columns)} |")
    return "\n".join(lines)


def read_log(log: Path | None) -> dict[int, End]:
    """The ends that stand in a log, by number; the last of each counts."""
    if log is None or not log.exists():
        return {}
    ends = [End(**json.loads(line)) for line in log.read_text(encoding="utf-8").splitlines()]
    return {end.number: end for end in ends}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sessions", type=Path, nargs="*")
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--skip", type=int, default=0, help="So many ways, in turn, are left out at the start."
    )
    parser.add_argument("--seconds", type=float, default=1e9, help="No longer than this.")
    parser.add_argument(
        "--log", type=Path, help="Every end is a line of this file; those that stand there are not run."
    )
    parser.add_argument(
        "--again", action="store_true", help="Those of the log that ended wrongly are run once more."
    )
    parser.add_argument("--keep", type=Path, help="Sessions that end wrongly are kept here.")
    options = parser.parse_args()
    ends = read_log(options.log)
    done = [number for number, end in ends.items() if not (options.again and end.faults)]

    def tell(end: End, folder: Path) -> None:
        ends[end.number] = end
        if options.log:
            with options.log.open("a", encoding="utf-8") as log:
                log.write(json.dumps(dataclasses.asdict(end)) + "\n")
        if end.faults:
            print(f"{end.what}: {'; '.join(end.faults)}\n    {end.text.strip()[:300]}", flush=True)
        if end.faults and options.keep:
            with contextlib.suppress(shutil.Error):
                shutil.copytree(folder, options.keep / str(end.number), symlinks=True, dirs_exist_ok=True)

    with tempfile.TemporaryDirectory() as name:
        sessions = options.sessions or sound_sessions(Path(name))
        run(
            sessions,
            options.count,
            options.seed,
            Path(name),
            skip=options.skip,
            done=done,
            seconds=options.seconds,
            tell=tell,
        )
    found = list(ends.values())
    wrong = sum(bool(end.faults) for end in found)
    print(table(found))
    print(
        f"{wrong} of {len(found)} ended wrongly; at most {max(end.cpu_s for end in found):.1f} s, "
        f"{max(end.memory_kb for end in found) / 1000:.0f} MB"
    )
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
