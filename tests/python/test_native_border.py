"""The native layer: no panic whatever it is given, Ctrl-C at once, threads and forks."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the tracked session needs mirror_lab's robots")

import broken_sessions
import killed_commands
import native_calls
from mirror_posture import load_session
from mirror_posture.diagnosis import diagnose
from tracked_session import write_tracked


@pytest.mark.filterwarnings("ignore")
def test_mutated_calls_end_without_a_panic() -> None:
    ends = native_calls.run(1500, seed=7)
    # A run in which nothing gets through, or nothing is refused, tests nothing.
    assert ends["answer"] > 150 and ends["MirrorPostureError"] > 300 and ends["TypeError"] > 20


@pytest.fixture(scope="module")
def tracked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tracked(
        tmp_path_factory.mktemp("tracked") / "session", 3, lambda q: {**q, "r_elbow": q["r_elbow"] + 0.02}
    )


def test_broken_sessions_end_in_an_error_or_an_answer(tracked: Path, tmp_path: Path) -> None:
    ends = broken_sessions.run([tracked], 24, 5, tmp_path)
    assert not [(end.what, end.faults, end.text) for end in ends if end.faults]
    assert {end.code for end in ends} >= {0, 1}


def test_killed_commands_leave_whole_results(tmp_path: Path) -> None:
    # A folder that is exchanged, and a file; those that take seconds are for a run by hand.
    # How many strike a command at work depends on the machine: so many that some do on any.
    seen = killed_commands.run(60, 5, tmp_path, ("import", "board"), enough=3)
    assert sum(counts["the old"] + counts["the new"] for counts in seen.values()) >= 3


CHILD = """
import signal, sys, time
# A shell in the background has its children ignore the interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)
import numpy as np
from mirror_posture import load_session
from mirror_posture.diagnosis.recording import to_core
session = load_session(sys.argv[1])
recording = to_core(session)
print("ready", flush=True)
try:
    # Seconds in one call. A core that passes the interrupt over ends it, and the interrupt comes late.
    recording.diagnose([], 6, [("again", recording, [])] * 2000, [], False)
    print("ended by itself", flush=True)
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""


DRAWS = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
from mirror_posture.render import PictureOptions, View, render_session
print("ready", flush=True)
try:
    # One picture of minutes.
    render_session(sys.argv[1] + "-drawn", [{}], [View()], options=PictureOptions(samples=64, edge_samples=64))
    print("ended by itself", flush=True)
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""


def cpu_s(process: int) -> float:
    """The processor's time that a process has taken for itself: neither other work on the machine adds to it, nor what the system takes to
    find memory (of a virtual machine seconds for a batch of mirrors)."""
    stat = Path(f"/proc/{process}/stat")
    if not stat.exists():
        return time.monotonic()
    return int(stat.read_text().rpartition(")")[2].split()[11]) / os.sysconf("SC_CLK_TCK")


@pytest.mark.parametrize("text", [CHILD, DRAWS], ids=["diagnose", "render"])
def test_ctrl_c_is_answered_at_once(tracked: Path, text: str) -> None:
    child = subprocess.Popen([sys.executable, "-c", text, str(tracked)], stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None and child.stdout.readline() == "ready\n"
    time.sleep(0.4)
    begun = cpu_s(child.pid)
    child.send_signal(signal.SIGINT)
    assert child.stdout.readline() == "interrupted\n"
    took = cpu_s(child.pid) - begun
    assert child.wait() == 0
    # It takes 0.1 s of a core; the diagnosis takes 7 s of the cores together, the picture minutes.
    assert took < 3.0, took


BATCHES = """
import os, signal
import numpy as np
import native_calls
from mirror_posture import _core
signal.signal(signal.SIGINT, signal.default_int_handler)
calls = {name: (function, args) for name, function, args, _ in native_calls.calls()}
def many(name, count, *places):
    function, args = calls[name]
    count = round(count * os.cpu_count())
    return function, [np.repeat(a, count, axis=0) if k in places else a for k, a in enumerate(args)]
# Each takes 3 s and more, on all cores of a quiet machine.
batches = {
    "second camera": many("calibrate_second_camera", 500, 4, 5, 6),
    "triangulation": many("triangulate", 150_000, 1, 2),
    "mirrors": many("estimate_mirrors", 80_000, 0),
    "balls": many("measure_balls", 2_000, 1, 2),
    "views": many("check_views", 500, 3, 4, 5, 6, 7),
}
for name, (function, args) in batches.items():
    print(name, flush=True)
    try:
        function(*args)
        print("ended by itself", flush=True)
    except KeyboardInterrupt:
        print("interrupted", flush=True)
"""


def test_ctrl_c_ends_long_batches_at_once() -> None:
    child = subprocess.Popen(
        [sys.executable, "-c", BATCHES], stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parent
    )
    assert child.stdout is not None
    for name in ("second camera", "triangulation", "mirrors", "balls", "views"):
        assert child.stdout.readline() == f"{name}\n"
        time.sleep(0.3)
        begun = cpu_s(child.pid)
        child.send_signal(signal.SIGINT)
        assert child.stdout.readline() == "interrupted\n", name
        took = cpu_s(child.pid) - begun
        # Some hundredths of each core, once the arguments are read; the whole takes 3 s of each and more.
        assert took < 1.5 * (os.cpu_count() or 1), (name, took)
    assert child.wait() == 0


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_forked_child_diagnoses_too(tracked: Path) -> None:
    session = load_session(tracked)
    before = diagnose(session, most_causes=1).to_json()
    child = os.fork()
    if child == 0:
        os._exit(0 if diagnose(session, most_causes=1).to_json() == before else 1)
    end = time.monotonic() + 60.0
    while time.monotonic() < end:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            assert os.waitstatus_to_exitcode(status) == 0
            return
        time.sleep(0.02)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    pytest.fail("the child waits for threads that it does not have")


def test_threads_diagnose_alike(tracked: Path) -> None:
    session = load_session(tracked)
    with ThreadPoolExecutor(3) as pool:
        texts = list(pool.map(lambda _: diagnose(session, most_causes=1).to_json(), range(3)))
    assert len(set(texts)) == 1


def test_shapes_are_named() -> None:
    from mirror_posture import MirrorPostureError

    _, record, args, _ = next(call for call in native_calls.calls() if call[0] == "GapRecording")
    args[5] = np.zeros((2, 2))
    with pytest.raises(
        MirrorPostureError, match=r"commanded: got an array of shape \[2, 2\], needed \[6, 2\]"
    ):
        record(*args)
