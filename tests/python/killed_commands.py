"""Commands killed at random moments: what stands in their place afterwards is whole, the old or the new.

`python tests/python/killed_commands.py --kills 500`: every command that writes is run in two ways that write different things into the same
place, is killed at a random moment (SIGKILL; every fifth time SIGTERM, SIGINT or SIGHUP; every second time while it writes), and what stands there must be one of both, byte by
byte, or nothing where nothing was. A diagnosis may instead be one that says it was interrupted. A correction and a capture add to what is
there: every picture that they told of must be there, readable, and can be gone on with.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib
import itertools
import json
import os
import random
import re
import shutil
import signal
import statistics
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from killed_jobs import Job, make_jobs, start
from killed_recordings import Capturing, kill_correction

SMALL_STAMPS = re.compile(rb"/(CreationDate|ModDate) ?\(D:[^)]*\)|/ID ?\n?\[<\w+><\w+>\]|/ID \n?\[[^\]]*\]")
"""What a PDF says of the time and of itself."""


PRELOADED = (
    "matplotlib.figure", "mirror_posture.calibrate", "mirror_posture.cli.app", "mirror_posture.detect", "mirror_posture.diagnosis.page",
    "mirror_posture.importing", "mirror_posture.capture", "mirror_lab.robots",
)  # fmt: skip
SLOW = 4.0
"""A command takes its turn less often from so many times the median of all on."""
SIGNALS = (signal.SIGKILL,) * 12 + (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)


def tree(place: Path) -> str | None:
    """The hash of a file, or of a folder's files with their names; None where there is nothing."""
    if not place.exists():
        return None
    files = sorted(p for p in place.rglob("*") if p.is_file()) if place.is_dir() else [place]
    hashes = []
    for file in files:
        name = file.relative_to(place).as_posix() if place.is_dir() else ""
        assert not name.endswith(".part") and ".being-replaced" not in name, (
            f"{file} is left in a finished folder"
        )
        data = SMALL_STAMPS.sub(b"", file.read_bytes())
        hashes.append(f"{name} {hashlib.sha256(data).hexdigest()}")
    return hashlib.sha256("\n".join(hashes).encode()).hexdigest()


def remove(place: Path) -> None:
    if place.is_dir():
        shutil.rmtree(place)
    else:
        place.unlink(missing_ok=True)


def learn(job: Job, below: Path) -> None:
    """Runs each way to its end, once, and remembers what it leaves."""
    for way, words in enumerate(job.ways):
        if job.fresh:
            remove(job.place)
        begun = time.monotonic()
        _, status = os.waitpid(start(words, below), 0)
        job.takes_s = max(job.takes_s, time.monotonic() - begun)
        assert os.waitstatus_to_exitcode(status) in (0, 3), (
            f"{job.name}: {words}: {(below / 'stderr').read_text()}"
        )
        if job.sound:
            assert job.place.exists()
            job.sound(job.place)
            continue
        found = tree(job.place)
        assert found is not None and job.trees.get(found) in (None, way), (
            f"{job.name}: both ways write the same"
        )
        job.trees[found] = way
        if job.between:
            job.trees |= {one: way for one in parts(job.place)}


def parts(place: Path) -> list[str]:
    """The hashes of what stands in a folder; a session also without what is added to it later."""
    found = []
    for path in sorted(place.iterdir()):
        if not path.name.startswith("."):
            found.append(f"{path.name} {tree(path)}")
    return found


def interrupted(place: Path) -> bool:
    """Whether a diagnosis stands there that says of itself that it was interrupted."""
    file = place / "diagnosis.json"
    return file.exists() and bool(json.loads(file.read_text(encoding="utf-8")).get("interrupted"))


def unfinished(job: Job) -> set[Path]:
    """What is being written beside the job's place and in it, or was when a run was killed."""
    try:
        beside = set(job.place.parent.glob(f".{job.place.name}*.part*"))
        return beside | set(job.place.rglob(".*.part*") if job.place.is_dir() else ())
    except FileNotFoundError:
        # Renamed while it was looked through.
        return set()


def wait_for_writing(job: Job, child: int, left: set[Path]) -> None:
    """Until something unfinished stands there that is not left from earlier runs, or the command has ended."""
    end = time.monotonic() + 20.0 * job.takes_s
    while time.monotonic() < end:
        if unfinished(job) - left:
            return
        # Not waited for: it keeps its number until it is.
        if os.waitid(os.P_PID, child, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None:
            return
        time.sleep(0.002)


def kill(job: Job, chance: random.Random, below: Path) -> str:
    """One kill; what stands there then."""
    way, number = chance.randrange(len(job.ways)), chance.choice(SIGNALS)
    if job.fresh:
        remove(job.place)
    # Where several outputs stand in one folder, a killed run may leave there what the next one removes.
    before = None if job.between or job.sound else tree(job.place)
    left = unfinished(job)
    child = start(job.ways[way], below)
    if chance.random() < 0.5:
        # While it writes, which is a hundredth of its time.
        wait_for_writing(job, child, left)
        time.sleep(0.03 * chance.random() ** 3)
    else:
        time.sleep(chance.uniform(0.0, 1.1 * job.takes_s))
    os.kill(child, number)
    _, status = os.waitpid(child, 0)
    ended = not os.WIFSIGNALED(status) and os.waitstatus_to_exitcode(status) in (0, 3)
    assert ended or os.WIFSIGNALED(status) or os.waitstatus_to_exitcode(status) in (129, 130, 143), (
        f"{job.name}, {number}: exit code {os.waitstatus_to_exitcode(status)}: {(below / 'stderr').read_text()}"
    )
    if job.sound:
        if job.place.exists():
            job.sound(job.place)
        return "ended before the kill" if ended else "all that is there is whole"
    if job.between:
        now = parts(job.place)
        known = [name for name in now if name in job.trees or name.startswith("session ")]
        assert known == now, f"{job.name}: {set(now) - set(known)} is neither the old nor the new"
        return "ended before the kill" if ended else "each the old or the new"
    if number != signal.SIGKILL and job.name == "diagnose" and interrupted(job.place):
        # The next whole run writes over it.
        assert os.waitpid(start(job.ways[0], below), 0)[1] == 0
        return "says that it was interrupted"
    after = tree(job.place)
    assert after in (before, *job.trees), (
        f"{job.name}, {number}: what stands there is neither the old nor the new"
    )
    if ended:
        assert job.trees[after or ""] == way
        return "ended before the kill"
    return "the old" if after == before else "the new"


def in_turn(jobs: Mapping[str, Job], recorders: Sequence[str]) -> Iterator[str]:
    """The commands' names without end, one after the other; one that takes long only every few rounds."""
    usual = statistics.median([job.takes_s for job in jobs.values()] or [1.0])
    every = {name: max(1, round(job.takes_s / (SLOW * usual))) for name, job in jobs.items()}
    for turn in itertools.count():
        yield from (name for name in jobs if turn % every[name] == 0)
        yield from recorders


def run(
    kills: int,
    seed: int,
    below: Path,
    only: Sequence[str] = (),
    told: bool = False,
    seconds: float = float("inf"),
    enough: int | None = None,
) -> dict[str, Counter[str]]:
    """Kills so many commands in turn, or until `enough` of them struck a command at work; what stood there, by command."""
    # Imported once: a child's time is that of its own work, and it holds no threads of the core.
    for name in PRELOADED:
        importlib.import_module(name)
    chance = random.Random(seed)
    jobs = {job.name: job for job in make_jobs(below, only)}
    for job in jobs.values():
        learn(job, below)
        if told:
            print(f"{job.name}: {job.takes_s:.1f} s", flush=True)
    capturing = Capturing(below) if not only or "capture" in only else None
    recorders = [name for name in ("correct", "capture") if not only or name in only]
    seen: dict[str, Counter[str]] = {name: Counter() for name in (*jobs, *recorders)}
    turns, until = in_turn(jobs, recorders), time.monotonic() + seconds
    for number in range(kills):
        struck = sum(counts["the old"] + counts["the new"] for counts in seen.values())
        if time.monotonic() > until or (enough is not None and struck >= enough):
            break
        name = next(turns)
        if name in jobs:
            how = kill(jobs[name], chance, below)
        elif capturing is not None and name == "capture":
            how = capturing.kill(chance, chance.choice(SIGNALS))
        else:
            how = kill_correction(chance, below)
        seen[name][how] += 1
        if told and number % 20 == 19:
            print(f"{number + 1} kills: {dict(sum(seen.values(), Counter()))}", flush=True)
    # The next whole run removes what killed ones left beside.
    for job in jobs.values():
        if job.fresh:
            remove(job.place)
        assert os.waitpid(start(job.ways[0], below), 0)[1] in (0, 3 << 8)
        if job.sound:
            job.sound(job.place)
            assert not list(job.place.rglob(".*.part")), f"{job.name}: a part is left"
        if job.between:
            assert not [p for p in job.place.rglob(".*") if ".part" in p.name], f"{job.name}: a part is left"
        assert job.between or job.sound or job.trees.get(tree(job.place) or "") == 0
        left = [
            path.name for path in job.place.parent.iterdir() if path.name.startswith(f".{job.place.name}")
        ]
        assert not left, f"{job.name}: {left}"
    return seen


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("commands", nargs="*", help="Only these.")
    parser.add_argument("--kills", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=float("inf"), help="Kill no longer than this.")
    options = parser.parse_args()
    below = Path(tempfile.mkdtemp())
    try:
        seen = run(options.kills, options.seed, below, options.commands, True, options.seconds)
        for name, counts in [*seen.items(), ("all", sum(seen.values(), Counter()))]:
            print(f"| {name} | {sum(counts.values())} | {dict(counts)} |")
    finally:
        shutil.rmtree(below)
