"""Commands killed at random moments: what stands in their place afterwards is whole, the old or the new.

`python tests/python/killed_commands.py --kills 500`: every command that writes is run in two ways that write different things into the same
place, is killed by SIGKILL at a random moment, and what stands there must be one of both, byte by byte, or nothing where nothing was.
A correction adds to what is there: every picture that it told of must be there, readable, and can be gone on with.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib
import os
import random
import re
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

SMALL_STAMPS = re.compile(rb"/(CreationDate|ModDate) ?\(D:[^)]*\)|/ID ?\n?\[<\w+><\w+>\]|/ID \n?\[[^\]]*\]")
"""What a PDF says of the time and of itself."""


PRELOADED = (
    "matplotlib.figure", "mirror_posture.calibrate", "mirror_posture.cli.app", "mirror_posture.detect", "mirror_posture.diagnosis.page",
    "mirror_lab.robots",
)  # fmt: skip


@dataclass
class Job:
    """A command that writes into one place, in two ways; `fresh`: the place must not be there before."""

    name: str
    place: Path
    ways: Sequence[Sequence[object]]
    fresh: bool = False
    trees: dict[str, int] = field(default_factory=dict)
    """What a whole run leaves there: its hash, and which way it was."""
    takes_s: float = 0.0


def start(words: Sequence[object], inside: Path) -> int:
    """A command in a forked process; its number."""
    child = os.fork()
    if child:
        return child
    try:
        os.chdir(inside)
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.dup2(os.open(inside / "stderr", os.O_CREAT | os.O_WRONLY | os.O_TRUNC), 2)
        sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
        sys.argv = ["mirror-posture", *map(str, words)]
        from mirror_posture.cli.app import main

        main()
    except SystemExit as end:
        os._exit(int(end.code or 0))
    except BaseException:
        os._exit(99)
    os._exit(0)


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
        found = tree(job.place)
        assert found is not None and job.trees.get(found) in (None, way), (
            f"{job.name}: both ways write the same"
        )
        job.trees[found] = way


def kill(job: Job, chance: random.Random, below: Path) -> str:
    """One kill; what stands there then."""
    way = chance.randrange(len(job.ways))
    if job.fresh:
        remove(job.place)
    before = tree(job.place)
    child = start(job.ways[way], below)
    time.sleep(chance.uniform(0.0, 1.1 * job.takes_s))
    os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    after = tree(job.place)
    assert after in (before, *job.trees), f"{job.name}: what stands there is neither the old nor the new"
    if not os.WIFSIGNALED(status):
        assert job.trees[after or ""] == way
        return "ended before the kill"
    return "the old" if after == before else "the new"


def kill_correction(chance: random.Random, below: Path) -> str:
    """A correction that is killed, and gone on with by the next one."""
    from mirror_posture import load_session

    folder, log = below / "run", below / "told"
    if folder.exists() and (folder / "outcome.json").exists():
        shutil.rmtree(folder)
    told_before = len(load_session(folder).frames) if (folder / "frames.csv").exists() else 0
    child = os.fork()
    if child == 0:
        try:
            os.dup2(os.open(log, os.O_CREAT | os.O_WRONLY | os.O_TRUNC), 1)
            sys.stdout = os.fdopen(1, "w")
            import correct_child

            correct_child.main(folder)
        except BaseException:
            os._exit(99)
        os._exit(0)
    time.sleep(chance.uniform(0.0, 0.6))
    os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    assert os.WIFSIGNALED(status) or os.waitstatus_to_exitcode(status) == 0, "could not be gone on with"
    told = [int(line) for line in log.read_text().split("\n")[:-1] if line.isdigit()]
    if (folder / "frames.csv").exists() and (told or told_before):
        found = len(load_session(folder).frames)
        assert found >= max([told_before, *told]), f"{found} frames of {max([told_before, *told])} are left"
    return "ended before the kill" if not os.WIFSIGNALED(status) else "what was told of is there"


def make_inputs(below: Path, only: Sequence[str]) -> list[Job]:
    """Small inputs of every command that writes, and the commands."""
    import cv2

    import small_arm
    from board_drawing import chessboard_picture
    from mirrored_session import write_mirrored

    def off(by_rad: float) -> Callable[[dict[str, float]], dict[str, float]]:
        return lambda q: {**q, "r_elbow": q["r_elbow"] + by_rad}

    one = write_mirrored(below / "one", 4, off(0.03), 20)
    other = write_mirrored(below / "other", 5, off(-0.04), 20)
    (below / "arm.urdf").write_text(small_arm.URDF)
    os.waitpid(start(["init", below / "arm.urdf", below / "arm", *small_arm.MOUNTS], below), 0)
    for name in ("one", "other"):
        os.waitpid(start(["diagnose", below / name, "--out", below / f"found-{name}"], below), 0)
    pictures, drawn = below / "pictures", below / "drawn"
    pictures.mkdir()
    if not only or "calibrate-camera" in only:
        for k in range(8):
            c, s = np.cos(0.4 * k), np.sin(0.4 * k)
            turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.diag([1.0, -1.0, 1.0])
            tilt = np.array([[1.0, 0, 0], [0, 1.0, 0], [0.012 * np.cos(k), 0.012 * np.sin(k), 1.0]])
            scale = np.array([[24.0, 0, 200 + 20.0 * (k % 4)], [0, 24.0, 150 + 15.0 * (k % 3)], [0, 0, 1.0]])
            cv2.imwrite(str(pictures / f"{k}.png"), chessboard_picture(7, 4, scale @ tilt @ turn, seed=k))
    if not only or "detect" in only:
        os.waitpid(start(["render", drawn, "--postures", "1", "--yaw", "0", "--no-noise"], below), 0)
    out = below / "out"
    out.mkdir()
    init = ["init", below / "arm.urdf", out / "arm", *small_arm.MOUNTS]
    return [
        Job("diagnose", out / "found", [["diagnose", one, "--out", out / "found"], ["diagnose", other, "--out", out / "found"]]),
        Job("apply", out / "better", [["apply", s, below / f"found-{s.name}", "--out", out / "better", "--overwrite"] for s in (one, other)]),
        Job("measure", out / "points.csv", [["measure", s, "--out", out / "points.csv"] for s in (one, other)]),
        Job("measure --plot", out / "points.png", [["measure", s, "--plot", out / "points.png"] for s in (one, other)]),
        Job("calibrate", out / "mount.json", [["calibrate", s, "--out", out / "mount.json"] for s in (one, other)]),
        Job("board", out / "board.pdf", [["board", out / "board.pdf", "--corners", c, "--square-mm", "15", "--overwrite"] for c in ("7x4", "6x5")]),
        Job("init", out / "arm", [init, [*init[:-1], "800"]], fresh=True),
        Job("calibrate-camera", out / "camera.yaml",
            [["calibrate-camera", pictures, "--corners", "7x4", "--square-mm", q, "--out", out / "camera.yaml", "--overwrite"] for q in ("20",)]),
        Job("detect", out / "detections.csv", [["detect", drawn, "--out", out / "detections.csv", "--no-overlays", "--overwrite"]]),
        Job("render", out / "drawn", [["render", out / "drawn", "--postures", "1", "--yaw", "0", "--seed", n, "--overwrite"] for n in ("1", "2")]),
        Job("plan", out / "plan", [["plan", below / "arm", "--postures", n, "--mirror-size", "50x50", "--out", out / "plan"] for n in ("6", "8")]),
    ]  # fmt: skip


def run(
    kills: int,
    seed: int,
    below: Path,
    only: Sequence[str] = (),
    told: bool = False,
    seconds: float = float("inf"),
) -> dict[str, Counter[str]]:
    """Kills so many commands in turn; what stood there, by command."""
    # Imported once: a child's time is that of its own work, and it holds no threads of the core.
    for name in PRELOADED:
        importlib.import_module(name)
    chance = random.Random(seed)
    jobs = [job for job in make_inputs(below, only) if not only or job.name in only]
    for job in jobs:
        learn(job, below)
        if told:
            print(f"{job.name}: {job.takes_s:.1f} s", flush=True)
    seen: dict[str, Counter[str]] = {job.name: Counter() for job in jobs}
    if not only or "correct" in only:
        seen["correct"] = Counter()
    names = list(seen)
    until = time.monotonic() + seconds
    for number in range(kills):
        if time.monotonic() > until:
            break
        name = names[number % len(names)]
        if name == "correct":
            seen[name][kill_correction(chance, below)] += 1
        else:
            seen[name][kill(next(job for job in jobs if job.name == name), chance, below)] += 1
    # The next whole run removes what killed ones left beside.
    for job in jobs:
        if job.fresh:
            remove(job.place)
        assert os.waitpid(start(job.ways[0], below), 0)[1] in (0, 3 << 8)
        assert job.trees.get(tree(job.place) or "") == 0
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
