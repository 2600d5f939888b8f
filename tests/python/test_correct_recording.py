"""A correction's recording: whole at every moment, whatever kills the process, and gone on with."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from correct_child import HIDDEN, OPTIONS, POSTURE
from mirror_lab.robots import TwinOptions, TwinRobot
from mirror_posture import MirrorPostureError, load_session, measure
from mirror_posture.correct import CorrectOptions, Recorder, correct, recorder
from mirror_posture.render import PictureOptions
from mirror_posture.robots import Look, Nominal

CHILD = Path(__file__).parent / "correct_child.py"


def run_child(folder: Path, kill_after_s: float | None = None, kill_at: int | None = None) -> tuple[int, str]:
    """Runs the child until it ends or is killed (after a time, or at a picture); how many pictures it told of, its stop."""
    child = subprocess.Popen(
        [sys.executable, str(CHILD), str(folder)], stdout=subprocess.PIPE, text=True, env=dict(os.environ)
    )
    assert child.stdout is not None
    told, stop, began = 0, "", time.monotonic()
    for line in child.stdout:
        words = line.split()
        if words[0] == "stop":
            stop = words[1]
        else:
            told = int(words[0])
            if kill_at is not None and told >= kill_at:
                time.sleep(random.random() * 0.02)
                child.send_signal(signal.SIGKILL)
                break
        if kill_after_s is not None and time.monotonic() - began > kill_after_s:
            child.send_signal(signal.SIGKILL)
            break
    child.wait(60)
    return told, stop


def test_killed_at_random_moments_nothing_is_lost_and_it_goes_on_to_the_end(tmp_path: Path) -> None:
    """Several kills in one recording; after each the session loads, with all that was told of."""
    random.seed(5)
    folder = tmp_path / "killed"
    told, stop = 0, ""
    for kill in (2, 5, 9, 14):
        told, stop = run_child(folder, kill_at=kill)
        assert not stop
        session = load_session(folder)
        assert len(session.frames) >= told
        assert session.mirror_view.board_seen.all(axis=1).all()
        assert not [w for w in session.warnings if "recorded" not in w]
    told, stop = run_child(folder)
    assert stop == "converged"
    session = load_session(folder)
    assert len(session.frames) >= told and not session.warnings
    result = json.loads((folder / "outcome.json").read_text())
    assert result["stop"]["kind"] == "converged"
    # Every look is in the record, those before the kills too, and the session measures like any other.
    assert [look["look"] for look in result["looks"]] == list(range(1, len(result["looks"]) + 1))
    found = measure(session)
    # A kill may leave a posture with one view, which gives no position.
    hand = (found.markers.marker == 0) & (found.markers.views >= 2)
    assert found.markers.measured[hand].all() and hand.sum() >= len(result["looks"])


def test_it_goes_on_as_if_it_had_not_been_stopped(tmp_path: Path) -> None:
    """Stopped after a whole look: the same commands as without the stop."""
    robot = TwinRobot(HIDDEN, TwinOptions(pictures=False))
    whole = correct(robot, POSTURE, OPTIONS)

    class Stops(TwinRobot):
        count = 0

        def _look(self) -> Look:
            self.count += 1
            if self.count == 7:
                raise KeyboardInterrupt
            return super()._look()

    first = Stops(HIDDEN, TwinOptions(pictures=False))
    recorder = Recorder.start(tmp_path / "a", first.nominal, first.joint_names)
    stopped = correct(first, POSTURE, OPTIONS, recorder=recorder)
    assert stopped.stop.kind == "interrupted" and len(stopped.looks) == 2
    recorder, _ = Recorder.resume(tmp_path / "a")
    second = TwinRobot(HIDDEN, TwinOptions(pictures=False, seed=9))
    resumed = correct(second, POSTURE, OPTIONS, recorder=recorder)
    assert resumed.converged
    # Two looks measured before the stop lead to the same third command, to the last bit.
    assert [dict(look.command) for look in resumed.looks[:3]] == [
        dict(look.command) for look in whole.looks[:3]
    ]
    assert resumed.looks[:2] == stopped.looks


@pytest.mark.parametrize("name", ["frames.csv", "detections.csv", "readings.jsonl"])
def test_a_half_written_last_line_is_no_line(tmp_path: Path, name: str) -> None:
    robot = TwinRobot(HIDDEN, TwinOptions(pictures=False))
    recorder = Recorder.start(tmp_path / "s", robot.nominal, robot.joint_names)
    options = CorrectOptions(stop=OPTIONS.stop, step=OPTIONS.step)

    class Stop(Exception):
        pass

    def stop(report: object) -> None:
        if getattr(report, "look", 0) == 2:
            raise Stop

    with pytest.raises(Stop):
        correct(robot, POSTURE, options, recorder=recorder, on_look=stop)
    file = tmp_path / "s" / name
    data = file.read_bytes()
    lines = data.splitlines(keepends=True)
    for cut in (1, len(lines[-1]) // 2, len(lines[-1]) - 1):
        file.write_bytes(b"".join(lines[:-1]) + lines[-1][: len(lines[-1]) - cut])
        before = load_session(tmp_path / "s")
        assert len(before.frames) in (5, 6)
    recorder, _ = Recorder.resume(tmp_path / "s")
    outcome = correct(TwinRobot(HIDDEN, TwinOptions(pictures=False)), POSTURE, options, recorder=recorder)
    assert outcome.converged
    session = load_session(tmp_path / "s")
    assert np.array_equal(session.frames.frame, np.arange(len(session.frames)))
    assert session.warnings == ()


def test_pictures_are_recorded_whole_and_detected_again(tmp_path: Path) -> None:
    """Stopped between a picture and its image points: the picture is there, and is detected when it goes on."""

    class Cut(Recorder):
        count = 0

        def detected(self, frame: int, look: Look) -> None:
            Cut.count += 1
            if Cut.count == 2:
                raise KeyboardInterrupt
            super().detected(frame, look)

    quick = PictureOptions(samples=1, edge_samples=2, ghosts=False)
    robot = TwinRobot(HIDDEN, TwinOptions(pictures=True, camera=quick))
    recorder = Cut.start(tmp_path / "p", robot.nominal, robot.joint_names)
    outcome = correct(robot, POSTURE, OPTIONS, recorder=recorder)
    assert outcome.stop.kind == "interrupted" and not outcome.looks
    session = load_session(tmp_path / "p")
    assert len(session.frames) == 2 and not session.mirror_view.board_seen[1].any()
    assert all(file is not None and file.is_file() for file in session.image_files)
    recorder, _ = Recorder.resume(tmp_path / "p")
    assert load_session(tmp_path / "p").mirror_view.board_seen.all()
    assert all(look.points is not None and look.points.board_seen.all() for look in recorder.past().looks)


def test_a_folder_that_is_taken_or_holds_no_recording_is_refused(tmp_path: Path) -> None:
    robot = TwinRobot((), TwinOptions(pictures=False))
    (tmp_path / "x").mkdir()
    (tmp_path / "x" / "thesis.txt").write_text("do not touch")
    with pytest.raises(MirrorPostureError, match="--resume"):
        Recorder.start(tmp_path / "x", robot.nominal, robot.joint_names)
    with pytest.raises(MirrorPostureError, match="no correction"):
        Recorder.resume(tmp_path / "x")
    assert (tmp_path / "x" / "thesis.txt").read_text() == "do not touch"


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_killed_while_it_begins_it_begins_again(tmp_path: Path) -> None:
    nominal = Nominal.load()
    folder = tmp_path / "run"
    child = os.fork()
    if child == 0:
        # Between two of its files.
        recorder.metadata_tree = lambda *_: os.kill(os.getpid(), 9)  # type: ignore[assignment]
        Recorder.start(folder, nominal, ["r_elbow"])
        os._exit(0)
    assert os.WIFSIGNALED(os.waitpid(child, 0)[1])
    assert not folder.exists()
    Recorder.start(folder, nominal, ["r_elbow"])
    assert [path.name for path in tmp_path.iterdir()] == ["run"]
