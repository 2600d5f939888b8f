"""Commands that add to what is there, killed: a correction and a capture. What was told of, or stood there, is there still, and is gone on with."""

from __future__ import annotations

import os
import random
import shutil
import signal
import sys
import time
import traceback
from pathlib import Path

from killed_jobs import start


def kill_correction(chance: random.Random, below: Path) -> str:
    """A correction that is killed, and gone on with by the next one: every picture that it told of is there, readable."""
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
            (below / "stderr").write_text(traceback.format_exc())
            os._exit(99)
        os._exit(0)
    time.sleep(chance.uniform(0.0, 0.6))
    os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    assert os.WIFSIGNALED(status) or os.waitstatus_to_exitcode(status) == 0, (
        f"could not be gone on with: {(below / 'stderr').read_text()}"
    )
    told = [int(line) for line in log.read_text().split("\n")[:-1] if line.isdigit()]
    if (folder / "frames.csv").exists() and (told or told_before):
        found = len(load_session(folder).frames)
        assert found >= max([told_before, *told]), f"{found} frames of {max([told_before, *told])} are left"
    return "ended before the kill" if not os.WIFSIGNALED(status) else "what was told of is there"


ROWS = 12
"""Of the plan that is captured."""


class Capturing:
    """`capture` of a folder of pictures, whose frames must stay there through any number of kills."""

    def __init__(self, below: Path) -> None:
        from mirror_posture.render import EMBEDDED_FOLDER, PictureOptions, View, render_session

        self.below, self.session, self.pictures = below, below / "captured", below / "to capture"
        postures = [{"r_elbow": 0.3, "r_shoulder_roll": 0.6}]
        child = os.fork()
        if child == 0:
            quick = PictureOptions(samples=1, edge_samples=1, ghosts=False)
            render_session(below / "one picture", postures, [View()], options=quick)
            os._exit(0)
        assert os.waitpid(child, 0)[1] == 0
        self.pictures.mkdir()
        for number in range(ROWS):
            shutil.copy(below / "one picture/images/000.png", self.pictures / f"{number:04d}.png")
        shutil.copytree(EMBEDDED_FOLDER, self.session, ignore=shutil.ignore_patterns("__*"))
        (self.session / "plan").mkdir()
        rows = "".join(f"{i},{i},{0.3 + 0.01 * i},0.6\n" for i in range(ROWS))
        (self.session / "plan/postures.csv").write_text("frame,posture,r_elbow,r_shoulder_roll\n" + rows)
        (self.session / "plan/views.csv").write_text(
            "frame,view\n" + "".join(f"{i},0\n" for i in range(ROWS))
        )

    def rows(self) -> int:
        """Frames that stand in the table, each with its picture, whole."""
        import cv2
        import pyarrow.csv

        file = self.session / "frames.csv"
        if not file.exists():
            return 0
        names = pyarrow.csv.read_csv(file)["image"].to_pylist()
        assert all(cv2.imread(str(self.session / name)) is not None for name in names), "a picture is missing"
        return len(names)

    def kill(self, chance: random.Random, number: int) -> str:
        before = self.rows()
        if before == ROWS:
            (self.session / "frames.csv").unlink()
            before = 0
        child = start(["capture", self.session, "--source", self.pictures, "--no-page"], self.below)
        time.sleep(chance.uniform(0.0, 2.5))
        file = self.session / "frames.csv"
        told = max(before, len(file.read_text().splitlines()) - 1 if file.exists() else 0)
        os.kill(child, number)
        _, status = os.waitpid(child, 0)
        ended = not os.WIFSIGNALED(status) and os.waitstatus_to_exitcode(status) in (0, 3)
        assert ended or os.WIFSIGNALED(status) or os.waitstatus_to_exitcode(status) in (130, 143), (
            f"capture: {(self.below / 'stderr').read_text()}"
        )
        assert self.rows() >= told, f"{self.rows()} frames of {told} are left"
        return "ended before the kill" if ended else "what was told of is there"
