"""A capture that is gone on with, paused or begun anew: nothing is taken twice, and nothing of anybody else's is replaced."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pyarrow.csv
import pytest

from mirror_posture import MirrorPostureError, folder_lock
from mirror_posture.capture import Capture, CaptureOptions, Recorder, Stage, open_source
from mirror_posture.capture.made import Made
from mirror_posture.capture.sources import Shot
from mirror_posture.plan import PlannedFrame
from mirror_posture.render import EMBEDDED_FOLDER
from mirror_posture.robots import Nominal
from small_arm import run

POSTURES = 4
ROWS = [PlannedFrame(i, i, 0, {"r_elbow": 0.1 + 0.3 * i}) for i in range(POSTURES)]
GREY = np.full((48, 64, 3), 120, np.uint8)


@pytest.fixture
def session(tmp_path: Path) -> Path:
    folder = tmp_path / "session"
    shutil.copytree(EMBEDDED_FOLDER, folder, ignore=shutil.ignore_patterns("__*"))
    (folder / "plan").mkdir()
    rows = "".join(f"{row.frame},{row.posture},{row.commanded['r_elbow']}\n" for row in ROWS)
    (folder / "plan" / "postures.csv").write_text("frame,posture,r_elbow\n" + rows)
    return folder


def shown(posture: int) -> np.ndarray:
    """A picture of noise with a white patch that tells the posture."""
    noise = (np.random.default_rng(posture).random((120, 160, 3)) * 60).astype(np.uint8)
    picture = cv2.GaussianBlur(noise, (0, 0), 1.0)
    picture[20:60, 10 + 35 * posture : 35 + 35 * posture] = 255
    return picture


def posture_in(file: Path) -> int:
    picture = cv2.imread(str(file))
    return int(np.argmax([picture[40, 22 + 35 * posture].sum() for posture in range(POSTURES)]))


def taking(session: Path, source: object, rows: Sequence[PlannedFrame] = ROWS, ask: bool = False) -> Capture:
    """A capture that finds board and balls in every picture."""
    recorder = Recorder(session, rows)
    capture = Capture(Nominal.load(session), rows, source, recorder, CaptureOptions(0.5, 0, ask))  # type: ignore[arg-type]

    class Found:
        board_seen = marker_seen = np.ones(1, dtype=bool)
        reasons = ()

    def look(*_: object, **__: object) -> bool:
        capture.found = Found()  # type: ignore[assignment]
        return True

    capture._look = look  # type: ignore[method-assign]
    return capture


@pytest.fixture
def film(tmp_path: Path) -> Path:
    """Each posture stands for two seconds."""
    file = tmp_path / "film.avi"
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (160, 120))
    for posture in range(POSTURES):
        for _ in range(20):
            writer.write(shown(posture))
    writer.release()
    return file


def test_a_film_goes_on_behind_its_last_picture(session: Path, film: Path) -> None:
    """Before, from its beginning: the first posture's picture was stored as the third posture."""
    for stop in (1, 2, POSTURES):
        capture = taking(session, open_source(str(film), None))
        while len(capture.recorder.taken) < stop and capture.step():
            pass
        capture.close()
    assert [posture_in(session / f"images/{i:04d}.png") for i in range(POSTURES)] == [0, 1, 2, 3]
    # Its own time goes on too: two seconds a posture, and the first one without a change before it.
    times = pyarrow.csv.read_csv(session / "frames.csv")["time_s"].to_pylist()
    assert times == pytest.approx([0.0, 1.9, 3.9, 5.9], abs=0.15)
    # At its end there is nothing more, and nothing of its beginning is taken.
    capture = taking(session, open_source(str(film), None), [*ROWS, PlannedFrame(4, 4, 0, {"r_elbow": 1.4})])
    while capture.step():
        pass
    assert sorted(capture.recorder.taken) == [0, 1, 2, 3] and "1 posture is not taken" in capture.message


@pytest.mark.parametrize("second", ["1" + "0" * 400, "NaN", "null", '"2"'])
def test_notes_that_are_none_name_no_place_in_a_film(session: Path, second: str) -> None:
    (session / "capture.json").write_text(
        f'{{"frames": {{"0": {{"film": "a", "film_s": {second}}}, "1": 3}}}}'
    )
    assert Made(session).last_in("a", [0, 1]) is None


def test_another_film_begins_at_its_beginning(session: Path, film: Path) -> None:
    capture = taking(session, open_source(str(film), None))
    while len(capture.recorder.taken) < 2 and capture.step():
        pass
    capture.close()
    other = film.with_name("other.avi")
    shutil.copy(film, other)
    capture = taking(session, open_source(str(other), None))
    while len(capture.recorder.taken) < 3 and capture.step():
        pass
    assert posture_in(session / "images/0002.png") == 0


class Standing:
    """A camera before which nothing moves until it is told so."""

    stills, live = False, True

    def __init__(self) -> None:
        self.posture, self._time_s = 0, 0.0

    def read(self) -> Shot:
        self._time_s += 0.1
        return Shot(shown(self.posture), self._time_s)

    def close(self) -> None: ...


def test_a_pause_lets_nothing_be_taken_twice(session: Path) -> None:
    """Before, Pause and Go on took the next posture from the same standing picture."""
    camera = Standing()
    capture = taking(session, camera, ask=True)
    capture.do("start")
    for _ in range(20):
        capture.step()
    assert sorted(capture.recorder.taken) == [0]
    for action in ("pause", "start"):
        capture.do(action)
        for _ in range(20):
            capture.step()
    assert sorted(capture.recorder.taken) == [0]
    camera.posture = 1
    for _ in range(20):
        capture.step()
    assert sorted(capture.recorder.taken) == [0, 1] and posture_in(session / "images/0001.png") == 1


def test_a_pause_turns_no_mirror(session: Path) -> None:
    """Before, Go on was taken as the confirmation that the mirror is turned."""
    camera = Standing()
    rows = [ROWS[0], PlannedFrame(1, 1, 1, {"r_elbow": 0.4})]
    capture = taking(session, camera, rows, ask=True)
    capture.do("start")
    for _ in range(20):
        capture.step()
    assert capture.stage is Stage.TURN_MIRROR
    camera.posture = 1
    for action in ("pause", "start"):
        capture.do(action)
        for _ in range(20):
            capture.step()
    assert capture.stage is Stage.TURN_MIRROR and sorted(capture.recorder.taken) == [0]
    capture.do("turned")
    while capture.step():
        pass
    assert sorted(capture.recorder.taken) == [0, 1]


def test_again_drops_what_was_taken_last(session: Path) -> None:
    """Before, the highest frame, which an earlier run had taken."""
    for row in (ROWS[0], ROWS[3]):
        Recorder(session, ROWS).add(row, GREY, 1.0, {})
    capture = taking(session, Standing(), ask=True)
    capture.do("start")
    while 1 not in capture.recorder.taken:
        capture.step()
    assert capture.do("again") == "posture 1 is to be taken again"
    assert sorted(capture.recorder.taken) == [0, 3]


def test_overwrite_deletes_nothing_before_there_is_a_picture(session: Path, tmp_path: Path) -> None:
    """Before, frames and detections were gone when --robot was refused, or the first picture was none."""
    for row in ROWS[:2]:
        Recorder(session, ROWS).add(row, GREY, 1.0, {})
    (session / "detections.csv").write_text("frame,target,index,u,v\n0,r_hand,0,1,2\n")
    before = {file.name: file.read_bytes() for file in session.glob("*.csv")}
    (folder := tmp_path / "pictures").mkdir()
    cv2.imwrite(str(folder / "0000.png"), GREY)
    words = ("capture", session, "--source", folder, "--overwrite")
    told = run(*words, "--robot", "feetech", "--servos", "s.toml", code=1).stderr
    assert "only while a person watches" in " ".join(told.split())
    # Of another size than the camera's.
    assert "calibrate the camera" in " ".join(run(*words, code=1).stderr.split())
    assert {file.name: file.read_bytes() for file in session.glob("*.csv")} == before
    recorder = Recorder(session, ROWS, overwrite=True)
    recorder.add(ROWS[1], GREY, 0.0, {})
    assert not (session / "detections.csv").exists()
    assert pyarrow.csv.read_csv(session / "frames.csv")["frame"].to_pylist() == [1]
    recorder.close()
    # What goes on with it may replace the pictures that lost their rows, also those of a capture without notes.
    Recorder(session, ROWS).add(ROWS[0], GREY + 1, 0.0, {})
    (session / "capture.json").unlink()
    Recorder(session, ROWS, overwrite=True).add(ROWS[1], GREY, 0.0, {})
    Recorder(session, ROWS).add(ROWS[0], GREY, 0.0, {})
    assert pyarrow.csv.read_csv(session / "frames.csv")["frame"].to_pylist() == [0, 1]


def test_pictures_of_somebody_else_are_not_replaced(session: Path) -> None:
    """Before, without a word."""
    (images := session / "images").mkdir()
    cv2.imwrite(str(images / "0001.png"), GREY + 1)
    before = (images / "0001.png").read_bytes()
    told = " ".join(run("capture", session, "--source", images, code=1).stderr.split())
    assert "lies in the session's images/" in told and "move it out of it" in told
    elsewhere = images.parent / "elsewhere"
    shutil.copytree(images, elsewhere)
    told = " ".join(run("capture", session, "--source", elsewhere, code=1).stderr.split())
    assert "0001.png: is there already, no row of frames.csv names it and no capture made it" in told
    with pytest.raises(MirrorPostureError, match="move it out of images/"):
        Recorder(session, ROWS).add(ROWS[0], GREY, 0.0, {})
    assert (images / "0001.png").read_bytes() == before and not (session / "frames.csv").exists()
    # A link to a picture elsewhere is somebody's as well.
    with pytest.raises(MirrorPostureError, match="lies in the session's images/"):
        Recorder(session, ROWS).begin(images / "film.mp4")


def test_what_a_killed_capture_left_is_its_own_until_it_is_changed(session: Path) -> None:
    """Between a picture and its row, and after `again`, a picture has no row."""
    recorder = Recorder(session, ROWS)
    for row in ROWS[:2]:
        recorder.add(row, GREY, 0.0, {})
    recorder.drop(1)
    recorder.close()
    Recorder(session, ROWS).begin()
    (session / "capture.json").write_text("[3")
    with pytest.raises(MirrorPostureError, match="no capture made it"):
        Recorder(session, ROWS).begin()
    (session / "images/0001.png").unlink()
    other = Recorder(session, ROWS)
    other.add(ROWS[1], GREY, 0.0, {})
    other.drop(1)
    cv2.imwrite(str(session / "images/0001.png"), GREY + 1)
    other.close()
    with pytest.raises(MirrorPostureError, match="no capture made it"):
        Recorder(session, ROWS).begin()


HOLDER = """
import sys
from pathlib import Path
sys.path.insert(0, {tests!r})
from test_capture_continued import *
recorder = Recorder(Path({session!r}), ROWS)
recorder.add(ROWS[0], GREY, 0.0, {{}})
print("there", flush=True)
sys.stdin.read()
"""


@pytest.mark.skipif(folder_lock.fcntl is None, reason="no locks here")
def test_a_second_recorder_is_refused_as_long_as_the_first_one_lives(session: Path) -> None:
    """Before, each wrote its own rows over those of the other."""
    text = HOLDER.format(tests=str(Path(__file__).parent), session=str(session))
    child = subprocess.Popen(
        [sys.executable, "-c", text],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=dict(os.environ),
    )
    assert child.stdout is not None and child.stdout.readline() == "there\n"
    frames = (session / "frames.csv").read_bytes()
    told = " ".join(run("capture", session, "--source", session / "plan", code=1).stderr.split())
    assert "holds no pictures" in told
    with pytest.raises(
        MirrorPostureError, match=f"process {child.pid} on .* records into it; needed one recorder"
    ):
        Recorder(session, ROWS).add(ROWS[1], GREY, 0.0, {})
    # A look at what is taken is free.
    assert sorted(Recorder(session, ROWS).taken) == [0]
    assert (session / "frames.csv").read_bytes() == frames
    child.kill()
    child.wait()
    recorder = Recorder(session, ROWS)
    recorder.add(ROWS[1], GREY, 0.0, {})
    assert pyarrow.csv.read_csv(session / "frames.csv")["frame"].to_pylist() == [0, 1]
    recorder.close()
    assert not (session / folder_lock.LOCK).exists()
    with pytest.raises(MirrorPostureError, match="this recorder has ended"):
        recorder.add(ROWS[2], GREY, 0.0, {})


def test_of_two_recorders_of_one_program_the_newer_one_writes(session: Path) -> None:
    older, newer = Recorder(session, ROWS), Recorder(session, ROWS)
    older.add(ROWS[0], GREY, 0.0, {})
    # It was made before that picture was taken, and knows of it all the same.
    newer.add(ROWS[1], GREY, 0.0, {})
    with pytest.raises(MirrorPostureError, match="another one of this program goes on"):
        older.add(ROWS[2], GREY, 0.0, {})
    assert pyarrow.csv.read_csv(session / "frames.csv")["frame"].to_pylist() == [0, 1]


def test_without_locks_nothing_fails(session: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Windows has none, and some network file systems."""
    monkeypatch.setattr(folder_lock, "fcntl", None)
    recorder = Recorder(session, ROWS)
    recorder.add(ROWS[0], GREY, 0.0, {})
    recorder.close()
    assert not (session / folder_lock.LOCK).exists()

    class NoLocks:
        LOCK_EX = LOCK_NB = 0

        @staticmethod
        def flock(*_: object) -> None:
            raise OSError(95, "Operation not supported")

    monkeypatch.setattr(folder_lock, "fcntl", NoLocks)
    Recorder(session, ROWS).add(ROWS[1], GREY, 0.0, {})
    assert pyarrow.csv.read_csv(session / "frames.csv")["frame"].to_pylist() == [0, 1]


@pytest.mark.skipif(folder_lock.fcntl is None, reason="no locks here")
def test_a_lock_writes_through_no_link(session: Path, tmp_path: Path) -> None:
    (thesis := tmp_path / "thesis.txt").write_text("do not touch")
    (session / folder_lock.LOCK).symlink_to(thesis)
    with pytest.raises(MirrorPostureError, match="cannot be written"):
        Recorder(session, ROWS).begin()
    assert thesis.read_text() == "do not touch"


def test_options_of_robots_need_their_robot(session: Path, tmp_path: Path) -> None:
    """Before, --servos without --robot was passed over, and --robot-class won over the robot that was named."""
    words = ("capture", session, "--source", tmp_path)
    told = " ".join(run(*words, "--servos", tmp_path / "s.toml", code=1).stderr.split())
    assert "--servos: got no robot, needed dynamixel or feetech, which alone has this option" in told
    told = run(*words, "--robot", "feetech", "--servos", "s.toml", "--robot-class", "a:B", code=1).stderr
    assert "--robot-class: got feetech, needed own, which alone has this option" in " ".join(told.split())
