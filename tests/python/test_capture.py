"""Capture: a folder, a film and a live source into a session; the page over HTTP and in a browser; nothing lost on kill -9."""

from __future__ import annotations

import http.client
import json
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from urllib.parse import urlsplit

import cv2
import numpy as np
import pyarrow.csv
import pytest

from mirror_posture import MirrorPostureError, load_session
from mirror_posture.capture import Capture, CaptureOptions, Recorder, Stage, open_source, sources
from mirror_posture.capture.server import CaptureServer
from mirror_posture.capture.sources import STALE_PICTURES, CameraSource, Shot, shown_source
from mirror_posture.plan import PlannedFrame, read_plan
from mirror_posture.render import EMBEDDED_FOLDER, PictureOptions, View, render_session
from mirror_posture.robots import Arrival, Nominal
from small_arm import run

POSTURES = [{"r_elbow": 0.3, "r_shoulder_roll": 0.6}, {"r_elbow": 0.8, "r_shoulder_roll": 0.9}]


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two pictures of the embedded robot, 0000.png and 0001.png."""
    session = tmp_path_factory.mktemp("drawn") / "s"
    # The smallest number of rays: of what they show no more than the board is looked for.
    render_session(
        session, POSTURES, [View()], options=PictureOptions(samples=1, edge_samples=1, ghosts=False)
    )
    folder = session.parent / "pictures"
    folder.mkdir()
    for number in range(2):
        shutil.copy(session / "images" / f"{number:03d}.png", folder / f"{number:04d}.png")
    return folder


@pytest.fixture
def session(tmp_path: Path) -> Path:
    folder = tmp_path / "session"
    shutil.copytree(EMBEDDED_FOLDER, folder, ignore=shutil.ignore_patterns("__*"))
    (folder / "plan").mkdir()
    rows = "".join(f"{i},{i},{p['r_elbow']},{p['r_shoulder_roll']}\n" for i, p in enumerate(POSTURES))
    (folder / "plan" / "postures.csv").write_text("frame,posture,r_elbow,r_shoulder_roll\n" + rows)
    (folder / "plan" / "views.csv").write_text("frame,view\n0,0\n1,1\n")
    return folder


def frames(session: Path) -> dict[str, list]:
    table = pyarrow.csv.read_csv(session / "frames.csv")
    return {name: table[name].to_pylist() for name in table.column_names}


class Film:
    """A source: each picture shown for some shots, with a blurred move in between; ends, or goes on with the last for ever."""

    stills, live = False, True

    def __init__(self, pictures: list[np.ndarray], shots: int = 8, ends: bool = True) -> None:
        self._shots: list[np.ndarray] = []
        random = np.random.default_rng(0)
        for picture in pictures:
            moving = cv2.blur(np.roll(picture, 60, axis=1), (31, 1))
            self._shots += [np.roll(moving, 15 * k, axis=1) for k in range(3)]
            noise = [random.normal(0, 1.0, picture.shape) for _ in range(2)]
            self._shots += [np.clip(picture + noise[k % 2], 0, 255).astype(np.uint8) for k in range(shots)]
        self._ends, self._at, self.closed = ends, 0, False

    def read(self) -> Shot | None:
        if self._at >= len(self._shots) and self._ends:
            return None
        picture = self._shots[min(self._at, len(self._shots) - 1)]
        self._at += 1
        return Shot(picture, 0.2 * self._at)

    def close(self) -> None:
        self.closed = True


def plan() -> list[PlannedFrame]:
    return [PlannedFrame(i, i, i, dict(posture)) for i, posture in enumerate(POSTURES)]


def test_a_folder_becomes_a_session(session: Path, pictures: Path, tmp_path: Path) -> None:
    (folder := tmp_path / "more").mkdir()
    for number in range(2):
        shutil.copy(pictures / f"{number:04d}.png", folder)
    told = json.loads(run("capture", session, "--source", folder, "--json").stdout)
    assert told["taken"] == [0, 1] and told["skipped"] == {}
    rows = frames(session)
    assert rows["r_elbow"] == [0.3, 0.8] and rows["image"] == ["images/0000.png", "images/0001.png"]
    loaded = load_session(session)
    assert not loaded.detected and loaded.warnings == ()
    # The same pictures, to the bit.
    assert np.array_equal(
        cv2.imread(str(session / "images/0001.png")), cv2.imread(str(pictures / "0001.png"))
    )
    # It goes on where it ended: nothing is left to do; and does not take what is there for another plan.
    assert "going on: 2 of 2" in run("capture", session, "--source", folder).stdout
    (session / "plan" / "postures.csv").write_text("frame,posture,r_elbow\n0,0,0.3\n")
    assert "another plan" in " ".join(run("capture", session, "--source", folder, code=1).stderr.split())


def test_what_is_left_and_what_a_stop_keeps_is_told(
    session: Path, pictures: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder := tmp_path / "more").mkdir()
    shutil.copy(pictures / "0000.png", folder)
    told = run("capture", session, "--source", folder).stdout
    assert "1 posture is not taken" in told and "the same command continues with the one that is left" in told

    def stop(_capture: Capture) -> bool:
        raise KeyboardInterrupt

    monkeypatch.setattr(Capture, "step", stop)
    kept = " ".join(run("capture", session, "--source", folder, code=130).stderr.split())
    assert "1 of 2 pictures are kept in" in kept and "the same command continues" in kept
    kept = " ".join(run("capture", session, "--source", folder, "--overwrite", code=130).stderr.split())
    assert kept == "error: stopped"


def test_a_plan_whose_pictures_are_half_taken_is_not_replaced(session: Path) -> None:
    table = session / "plan" / "postures.csv"
    rows, before = read_plan(table, Nominal.load(session).robot), table.read_bytes()
    Recorder(session, rows).add(rows[0], np.zeros((48, 64, 3), np.uint8), 0.0, {})
    told = " ".join(run("plan", session, "--mirror-size", "50x50", code=1).stderr.split())
    assert "1 of 2 pictures of this plan are taken" in told and "--overwrite" in told, told
    assert table.read_bytes() == before


def test_a_picture_without_a_board_is_left_out_and_named(
    session: Path, pictures: Path, tmp_path: Path
) -> None:
    (folder := tmp_path / "more").mkdir()
    shutil.copy(pictures / "0000.png", folder / "0001.png")
    good = cv2.imread(str(pictures / "0000.png"))
    cv2.imwrite(str(folder / "0000.png"), np.full_like(good, 120))
    result = run("capture", session, "--source", folder)
    assert "frame 0 is left out: board" in " ".join(result.stderr.split())
    assert frames(session)["frame"] == [1]
    cv2.imwrite(str(folder / "0000.png"), good[::2, ::2])
    assert "calibrate the camera" in " ".join(
        run("capture", session, "--source", folder, "--overwrite", code=1).stderr.split()
    )


def test_digits_that_are_no_numbers_are_letters_of_a_name(tmp_path: Path) -> None:
    """Before, `a1².png` ended the capture as a fault of the program."""
    for name in ("a10.png", "a1².png", "a9.png"):
        cv2.imwrite(str(tmp_path / "picture.png"), np.zeros((48, 64, 3), np.uint8))
        (tmp_path / "picture.png").rename(tmp_path / name)
    source = open_source(str(tmp_path), None)
    assert [shot.name for shot in iter(source.read, None)] == ["a1².png", "a9.png", "a10.png"]


def test_bad_sources_say_what_is_needed(session: Path, tmp_path: Path) -> None:
    assert "webcam:0" in run("capture", session, "--source", "nothing", code=1).stderr
    for number in ("x", "²"):
        assert (
            "needed webcam:NUMBER" in run("capture", session, "--source", f"webcam:{number}", code=1).stderr
        )
    (tmp_path / "empty").mkdir()
    assert "holds no pictures" in run("capture", session, "--source", tmp_path / "empty", code=1).stderr
    (tmp_path / "film.mp4").write_text("no film")
    with pytest.raises(MirrorPostureError, match="no film"):
        open_source(str(tmp_path / "film.mp4"), None)
    assert "secret" not in shown_source("rtsp://me:secret@cam/1")


def test_a_plan_elsewhere_is_given_by_its_folder_or_its_table(session: Path, pictures: Path) -> None:
    """Before, only by its table, though other commands take its folder."""
    elsewhere = (session / "plan").rename(session.parent / "elsewhere")
    for plan in (elsewhere, elsewhere / "postures.csv"):
        run("capture", session, "--source", pictures, "--plan", plan, "--overwrite")
        assert frames(session)["frame"] == [0, 1]
    told = " ".join(run("capture", session, "--source", pictures, code=1).stderr.split())
    assert (
        f"{session / 'plan' / 'postures.csv'}: there is no such file; mirror-posture plan writes it" in told
    )


def test_a_plan_of_another_robot_is_named_with_what_its_columns_need(session: Path, pictures: Path) -> None:
    """Before, neither the file nor what to do."""
    file = session / "plan" / "postures.csv"
    file.write_text(file.read_text().replace("r_elbow", "elbow_flex"))
    told = " ".join(run("capture", session, "--source", pictures, code=1).stderr.split())
    assert f"{file}: got columns of elbow_flex, needed joints of this robot that move by themselves" in told
    assert (
        "r_elbow" in told
        and "is it the plan of another robot? Plan once more with mirror-posture plan" in told
    )


def test_a_film_tells_its_own_time(tmp_path: Path) -> None:
    file = tmp_path / "film.avi"
    film = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"MJPG"), 8.0, (64, 48))
    for shade in (0, 100, 200):
        film.write(np.full((48, 64, 3), shade, dtype=np.uint8))
    film.release()
    source = open_source(str(file), None)
    shots = [source.read() for _ in range(4)]
    source.close()
    assert shots[3] is None
    assert [shot.time_s for shot in shots[:3]] == pytest.approx([0.0, 0.125, 0.25])
    assert shots[2].name == "film.avi, picture 3"


def test_a_film_that_a_tag_turns_is_read_as_it_is_stored(tmp_path: Path) -> None:
    """As `import` reads it, and as the camera file describes it: before, OpenCV turned it by its tag."""
    av, file = pytest.importorskip("av"), tmp_path / "film.mp4"
    film = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"mp4v"), 8.0, (64, 48))
    for _ in range(3):
        film.write(np.full((48, 64, 3), 100, dtype=np.uint8))
    film.release()
    # A quarter turn in the track's header, in the place of no turn, as a phone writes it.
    one, none = (1 << 16).to_bytes(4, "big"), bytes(4)
    data, at = bytearray(file.read_bytes()), file.read_bytes().index(b"tkhd") + 4 + 40
    assert data[at : at + 20] == one + none * 3 + one
    data[at : at + 20] = none + one + none + (-(1 << 16)).to_bytes(4, "big", signed=True) + none
    file.write_bytes(data)
    with av.open(str(file)) as container:
        assert abs(next(container.decode(video=0)).rotation) == 90
    source = open_source(str(file), None)
    shot = source.read()
    source.close()
    assert shot is not None and shot.picture.shape == (48, 64, 3)


class Stream:
    """In place of OpenCV's reader of a stream: pictures that came while nobody read are there at once, the next one must be waited for."""

    def __init__(self, buffered: int) -> None:
        self._buffered, self._at = buffered, 0

    def isOpened(self) -> bool:
        return True

    def set(self, _what: int, _value: float) -> bool:
        return False

    def grab(self) -> bool:
        if self._at >= self._buffered:
            time.sleep(0.03)
        self._at += 1
        return True

    def retrieve(self) -> tuple[bool, np.ndarray]:
        return True, np.full((48, 64, 3), self._at, dtype=np.uint8)


def test_a_stream_gives_its_newest_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    """Before, the next one of its buffer, however old."""
    monkeypatch.setattr(sources.cv2, "VideoCapture", lambda _where: Stream(buffered=90))
    stream = CameraSource("rtsp://camera/1", None)
    assert [int(stream.read().picture[0, 0, 0]) for _ in range(2)] == [91, 92]


def test_a_film_is_taken_when_all_is_still_and_each_posture_once(session: Path, pictures: Path) -> None:
    shown = [cv2.imread(str(pictures / f"{i:04d}.png")) for i in range(2)]
    film = Film(shown, ends=False)
    capture = Capture(Nominal.load(session), plan(), film, Recorder(session, plan()), CaptureOptions(0.5))
    capture.step()
    assert capture.stage is Stage.WAITING and not capture.recorder.taken
    assert capture.do("start") == "going on"
    for _ in range(30):
        capture.step()
        if capture.stage is Stage.TURN_MIRROR:
            break
    # One posture, one picture; the second one stands before a mirror that must be turned first.
    assert list(capture.recorder.taken) == [0] and capture.stage is Stage.TURN_MIRROR
    sharp = cv2.imread(str(session / "images/0000.png")).astype(float)
    assert np.abs(sharp - shown[0]).mean() < 2.0, "not the moving one"
    capture.do("turned")
    for _ in range(30):
        if not capture.step():
            break
    assert capture.stage is Stage.FINISHED and frames(session)["frame"] == [0, 1]
    capture.close()
    assert film.closed


class Driver:
    """A robot that notes where it was sent, and may fail."""

    name, joint_names = "noted", ("r_elbow", "r_shoulder_roll")

    def __init__(self, fails_at: int = 99) -> None:
        self.sent: list[dict[str, float]] = []
        self.rests, self._fails_at = 0, fails_at

    def command(self, positions: dict[str, float]) -> Arrival:
        if len(self.sent) == self._fails_at:
            raise MirrorPostureError("servo 3 does not answer")
        self.sent.append(dict(positions))
        return Arrival(dict(positions), {"r_elbow": positions["r_elbow"] + 0.01}, 0.1)

    def rest(self) -> None:
        self.rests += 1


def test_a_driver_goes_from_row_to_row_and_rests_whatever_happens(session: Path, pictures: Path) -> None:
    still = [cv2.imread(str(pictures / "0000.png"))] * 4
    rows = [PlannedFrame(i, i, 0, dict(posture)) for i, posture in enumerate(POSTURES)]
    driver = Driver()
    capture = Capture(
        Nominal.load(session), rows, Film(still), Recorder(session, rows), CaptureOptions(0.5), driver
    )
    for _ in range(5):
        capture.step()
    assert driver.sent == [], "nothing moves before somebody starts it"
    capture.do("start")
    capture.do("skip")
    while capture.step():
        pass
    # Through the row that was left out: only from row to row the way is known to be free.
    assert driver.sent == POSTURES and driver.rests == 1 and list(capture.recorder.taken) == [1]
    assert capture.message == "the plan is through; 1 posture is not taken"
    assert frames(session)["measured:r_elbow"] == [pytest.approx(0.81)]

    broken = Driver(fails_at=0)
    (other := session.parent / "other").mkdir()
    capture = Capture(
        Nominal.load(session), rows, Film(still), Recorder(other, rows), CaptureOptions(0.5), broken
    )
    capture.do("start")
    while capture.step():
        pass
    assert capture.stage is Stage.FAILED and "servo 3" in capture.message and broken.rests == 1


def test_what_a_camera_buffered_before_a_command_is_not_taken_as_its_posture(
    session: Path, pictures: Path
) -> None:
    """Before, a picture of the old posture was recorded as the new one: it had been still for long."""

    class Buffering(Film):
        """What is read next was taken before the robot moved."""

        def __init__(self) -> None:
            old, new = (cv2.imread(str(pictures / f"{i:04d}.png")) for i in range(2))
            super().__init__([old], shots=10)
            self._shots += [old] * STALE_PICTURES + [new] * 20

    rows = [PlannedFrame(0, 0, 0, dict(POSTURES[1]))]
    film = Buffering()
    capture = Capture(
        Nominal.load(session), rows, film, Recorder(session, rows), CaptureOptions(0.5), Driver()
    )
    for _ in range(12):
        capture.step()
    capture.do("start")
    while capture.step():
        pass
    assert list(capture.recorder.taken) == [0]
    taken, new = (cv2.imread(str(f)) for f in (session / "images/0000.png", pictures / "0001.png"))
    assert np.array_equal(taken, new)


def test_the_time_goes_on_where_a_capture_is_continued(session: Path) -> None:
    """Before, it fell: 0, 10, 20, 2, 12."""
    rows = [PlannedFrame(i, i, 0, dict(POSTURES[i % 2])) for i in range(5)]
    picture = np.zeros((48, 64, 3), np.uint8)
    for part, begin_s in ((rows[:3], 5.0), (rows[3:], 2.0)):
        recorder = Recorder(session, rows)
        for number, row in enumerate(part):
            recorder.add(row, picture, begin_s + 10.0 * number, {})
    assert frames(session)["time_s"] == [0.0, 10.0, 20.0, 22.0, 32.0]


@pytest.fixture
def served(session: Path, pictures: Path):
    film = Film([cv2.imread(str(pictures / "0000.png"))], ends=False)
    capture = Capture(Nominal.load(session), plan(), film, Recorder(session, plan()), CaptureOptions(0.5))
    server = CaptureServer(capture)
    capture.step()
    yield capture, server
    server.close()
    capture.close()


def ask(
    server: CaptureServer,
    what: str,
    method: str = "GET",
    body: str | None = None,
    token: str | None = None,
    **headers: str,
):
    address = urlsplit(server.address)
    connection = http.client.HTTPConnection("127.0.0.1", address.port, timeout=10)
    path = address.path if token is None else f"/{token}/"
    connection.request(method, path + what, body, headers)
    answer = connection.getresponse()
    return answer.status, answer.read(), dict(answer.getheaders())


def test_the_page_answers_only_its_own(served) -> None:
    capture, server = served
    assert urlsplit(server.address).hostname == "127.0.0.1"
    status, page, headers = ask(server, "")
    assert status == 200 and b"<title>Capture" in page
    assert (
        "frame-ancestors 'none'" in headers["Content-Security-Policy"]
        and headers["Cache-Control"] == "no-store"
    )
    # Nothing is fetched from anywhere else.
    assert b"http://" not in page and b"https://" not in page
    assert ask(server, "live.jpg")[1].startswith(b"\xff\xd8")
    state = json.loads(ask(server, "state.json")[1])
    assert state["stage"] == "waiting" and state["board"] and state["next"]["joints_deg"]["r_elbow"] == 17.2
    for token in ("", "x" * 32, "%C3%A9"):
        assert ask(server, "state.json", token=token)[0] == 404
    # A foreign name that was made to point here, and a page of another site.
    assert ask(server, "state.json", Host="evil.example")[0] == 403
    port = urlsplit(server.address).port
    start = json.dumps({"action": "start"})
    assert ask(server, "do", "POST", start)[0] == 403
    assert ask(server, "do", "POST", start, Origin="http://evil.example")[0] == 403
    assert capture.stage is Stage.WAITING
    own = {"Origin": f"http://127.0.0.1:{port}"}
    assert ask(server, "do", "POST", "x" * 2000, **own)[0] == 400
    assert ask(server, "do", "POST", '{"action": "explode"}', **own)[0] == 400
    assert ask(server, "do", "POST", start, **own)[0] == 200
    assert capture.stage is Stage.MOVING


@pytest.mark.skipif(shutil.which("chromium") is None, reason="no chromium here")
def test_a_browser_shows_it(served, tmp_path: Path) -> None:
    capture, server = served
    capture.do("start")
    for _ in range(12):
        capture.step()
    assert list(capture.recorder.taken) == [0]
    done = subprocess.run(
        ["chromium", "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}", "--window-size=1280,900",
         "--virtual-time-budget=4000", "--dump-dom", server.address],
        capture_output=True, timeout=60, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-500:]
    assert (
        "Postures: 1 of 2 taken" in done.stdout
        and "✓ board" in done.stdout
        and "Turn the mirror" in done.stdout
    )
    assert "blob:http://127.0.0.1" in done.stdout, "the live picture"


CHILD = """
import sys, time
from pathlib import Path
sys.path.insert(0, {tests!r})
from test_capture import *
session, pictures = Path({session!r}), Path({pictures!r})
rows = [PlannedFrame(i, i, 0, dict(POSTURES[i % 2])) for i in range(200)]
picture = cv2.imread(str(pictures / "0000.png"))
recorder = Recorder(session, rows)
for row in rows:
    if row.frame in recorder.taken:
        continue
    recorder.add(row, picture, float(row.frame), {{}})
    print(row.frame, flush=True)
"""


def test_nothing_captured_is_lost_by_kill_9(session: Path, pictures: Path) -> None:
    """Killed at odd moments; whatever was told as taken is there, whole, and the next run goes on behind it."""
    text = CHILD.format(tests=str(Path(__file__).parent), session=str(session), pictures=str(pictures))
    told = -1
    for pause_s in (0.03, 0.011):
        child = subprocess.Popen([sys.executable, "-c", text], stdout=subprocess.PIPE, text=True)
        assert child.stdout is not None
        first = int(child.stdout.readline())
        assert first in (told + 1, told + 2), "a row may be on the disk that was not told any more"
        told = first
        threading.Timer(pause_s, child.send_signal, [signal.SIGKILL]).start()
        for line in child.stdout:
            told = int(line)
        child.wait()
        rows = frames(session)
        assert rows["frame"] == list(range(len(rows["frame"]))) and rows["frame"][-1] >= told
        for name in rows["image"]:
            assert cv2.imread(str(session / name)) is not None
