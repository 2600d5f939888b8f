"""Every command that writes one output, on small inputs, each in ways that write different things into the same place."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np


@dataclass
class Job:
    """A command that writes into one place, in two ways; `fresh`: the place must not be there before."""

    name: str
    place: Path
    ways: Sequence[Sequence[object]]
    fresh: bool = False
    between: bool = False
    """Several outputs one after the other: only each of them is whole."""
    sound: Callable[[Path], None] | None = None
    """Says whether what stands there is whole, where a run writes other bytes each time (answers with a salt, times)."""
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
    except KeyboardInterrupt:
        # Before the command had begun, or after its end.
        os._exit(130)
    except BaseException:
        os._exit(99)
    os._exit(0)


def finish(words: Sequence[object], inside: Path) -> None:
    """A command to its end."""
    status = os.waitpid(start(words, inside), 0)[1]
    assert os.waitstatus_to_exitcode(status) in (0, 3), f"{words}: {(inside / 'stderr').read_text()}"


def off(by_rad: float) -> Callable[[dict[str, float]], dict[str, float]]:
    return lambda q: {**q, "r_elbow": q["r_elbow"] + by_rad}


SMALL_CASES = ["--cases", "2", "--robot", "small", "--frames", "60", "61", "--outside", "0"]
"""Of the blind check, made in seconds."""


def make_jobs(below: Path, only: Sequence[str]) -> list[Job]:
    """Small inputs of the commands, and the commands; `only`: of some."""
    import small_arm
    from mirrored_session import write_mirrored

    def asked(*names: str) -> bool:
        return not only or any(name in only for name in names)

    out = below / "out"
    out.mkdir()
    one, other = below / "one", below / "other"
    if asked(
        "diagnose",
        "apply",
        "simulate",
        "measure",
        "measure --plot",
        "measure --page",
        "check --page",
        "calibrate",
    ):
        write_mirrored(one, 4, off(0.03), 20)
        write_mirrored(other, 5, off(-0.04), 20)
    if asked("apply", "simulate"):
        for session in (one, other):
            finish(["diagnose", session, "--out", below / f"found-{session.name}"], below)
    (below / "arm.urdf").write_text(small_arm.URDF)
    arm = ["init", below / "arm.urdf", below / "arm", *small_arm.MOUNTS]
    if asked("plan", "import"):
        finish(arm, below)
    if asked("import"):
        finish([*arm[:2], out / "imported", *arm[3:]], below)
        write_recording(below / "film", below / "a.csv", below / "b.csv")
    pictures, drawn = below / "pictures", below / "drawn"
    if asked("calibrate-camera"):
        write_boards(pictures)
    if asked("detect"):
        finish(["render", drawn, "--postures", "1", "--yaw", "0", "--no-noise"], below)
    blind = ["blind", "make", below / "blind", *SMALL_CASES]
    if asked("blind run", "blind score"):
        finish(blind, below)
    if asked("blind score"):
        finish(["blind", "run", below / "blind", below / "results", "--workers", "1"], below)
    fresh = ["init", below / "arm.urdf", out / "arm", *small_arm.MOUNTS]
    plots = [("--out", "points.csv"), ("--plot", "points.png"), ("--page", "points.html")]
    jobs = [
        Job("diagnose", out / "found", [["diagnose", s, "--out", out / "found"] for s in (one, other)]),
        Job("apply", out / "better", [["apply", s, below / f"found-{s.name}", "--out", out / "better", "--overwrite"] for s in (one, other)]),
        Job("simulate", out / "simulated", [["simulate", s, "--with", below / f"found-{s.name}", "--out", out / "simulated"] for s in (one, other)]),
        *(Job("measure" if key == "--out" else f"measure {key}", out / name, [["measure", s, key, out / name] for s in (one, other)]) for key, name in plots),
        Job("check --page", out / "checked.html", [["check", s, "--page", out / "checked.html"] for s in (one, other)]),
        Job("calibrate", out / "mount.json", [["calibrate", s, "--out", out / "mount.json"] for s in (one, other)]),
        Job("board", out / "board.pdf", [["board", out / "board.pdf", "--corners", c, "--square-mm", "15", "--overwrite"] for c in ("7x4", "6x5")]),
        Job("init", out / "arm", [fresh, [*fresh[:-1], "800"]], fresh=True),
        Job("import", out / "imported",
            [["import", below / "film", out / "imported", "--joints", below / f"{n}.csv", "--offset-s", "0", "--overwrite"] for n in "ab"]),
        Job("calibrate-camera", out / "camera.yaml",
            [["calibrate-camera", pictures, "--corners", "7x4", "--square-mm", "20", "--out", out / "camera.yaml", "--overwrite"]]),
        Job("detect", out / "detections.csv", [["detect", drawn, "--out", out / "detections.csv", "--no-overlays", "--overwrite"]]),
        Job("render", out / "drawn", [["render", out / "drawn", "--postures", "1", "--yaw", "0", "--seed", n, "--overwrite"] for n in ("1", "2")]),
        Job("plan", out / "plan", [["plan", below / "arm", "--postures", n, "--mirror-size", "50x50", "--out", out / "plan"] for n in ("6", "8")]),
        Job("demo", out / "demo", [["demo", "--out", out / "demo", "--postures", "1"]], between=True),
        Job("schema", out / "schemas", [["schema", "--out", out / "schemas"]], between=True),
        *lab_jobs(below, out),
    ]  # fmt: skip
    return [job for job in jobs if asked(job.name)]


def lab_jobs(below: Path, out: Path) -> list[Job]:
    """The laboratory's commands. Their sessions have another salt in each run, their results other times."""
    made = [*SMALL_CASES, "--most", "1", "--workers", "1"]
    moved = ["--cases", "1", "--robot", "small", "--seconds", "4"]
    return [
        Job("blind make", out / "blind", [["blind", "make", out / "blind", *made, "--seed", n] for n in "12"], fresh=True, sound=sealed),
        Job("moving make", out / "moving", [["moving", "make", out / "moving", *moved, "--seed", n] for n in "12"], fresh=True, sound=sealed),
        Job("blind run", out / "results", [["blind", "run", below / "blind", out / "results", "--workers", "1"]], fresh=True, sound=diagnosed),
        Job("blind score", out / "score", [["blind", "score", below / "blind", below / "results", "--out", out / "score"]], between=True),
        Job("reproduce", out / "paper", [["reproduce", "--out", out / "paper", "--only", "fig7", "--trials", "2", "--seed", n] for n in "12"], between=True),
    ]  # fmt: skip


def sealed(place: Path) -> None:
    """Sessions in a folder: each can be loaded, has its seal, and the answer that it seals; a moving one its second motion."""
    from mirror_lab.blind.seal import unseal
    from mirror_posture import load_session

    for folder in place.glob("case-*"):
        load_session(folder)
        if not folder.name.endswith("-unseen"):
            unseal(place / "answers" / f"{folder.name}.json", folder / "seal.json")
            assert not (folder / "model.xml").exists() or folder.with_name(f"{folder.name}-unseen").is_dir()


def diagnosed(place: Path) -> None:
    """Results of a blind run: each that is there is a whole diagnosis, with its time."""
    from mirror_posture.diagnosis import Diagnosis

    for file in place.glob("*/diagnosis.json"):
        Diagnosis.from_document(json.loads(file.read_text(encoding="utf-8")))
        json.loads(file.with_name("time.json").read_text(encoding="utf-8"))
    for file in place.glob("*/failure.json"):
        raise AssertionError(file.read_text(encoding="utf-8"))


def write_recording(folder: Path, *joint_files: Path) -> None:
    """Three rests of an arm in small pictures named by their times; the joints' files tell of different postures."""
    import cv2

    folder.mkdir()
    times = np.arange(0.0, 4.5, 0.1)
    posture = np.minimum(times // 1.5, 2)
    for time, p in zip(times, posture, strict=True):
        picture = np.full((48, 64, 3), 90, np.uint8)
        cv2.circle(picture, (20 + 12 * int(p), 24), 6, (20, 30, 240), -1)
        cv2.imwrite(str(folder / f"{time:.1f}.png"), picture)
    for number, file in enumerate(joint_files):
        rows = [
            f"{t:.1f},{0.3 * p + 0.05 * number},{-0.2 * p},0.1" for t, p in zip(times, posture, strict=True)
        ]
        file.write_text("\n".join(["time_s,pan,lift,elbow", *rows]) + "\n")


def write_boards(folder: Path) -> None:
    """Eight pictures of a printed board, tilted and in all parts."""
    import cv2

    from board_drawing import chessboard_picture

    folder.mkdir()
    for k in range(8):
        c, s = np.cos(0.4 * k), np.sin(0.4 * k)
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.diag([1.0, -1.0, 1.0])
        tilt = np.array([[1.0, 0, 0], [0, 1.0, 0], [0.012 * np.cos(k), 0.012 * np.sin(k), 1.0]])
        scale = np.array([[24.0, 0, 200 + 20.0 * (k % 4)], [0, 24.0, 150 + 15.0 * (k % 3)], [0, 0, 1.0]])
        cv2.imwrite(str(folder / f"{k}.png"), chessboard_picture(7, 4, scale @ tilt @ turn, seed=k))
