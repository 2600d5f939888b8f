"""What a correction's folder keeps: the robot's body, the views, its one writer, and that it has ended."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from correct_child import HIDDEN, OPTIONS, POSTURE
from mirror_lab.robots import TwinOptions, TwinRobot
from mirror_posture import MirrorPostureError, folder_lock, load_session
from mirror_posture.correct import CorrectOptions, Recorder, correct, make_target, propose_views, viewpoints
from mirror_posture.correct.planner import reach_m
from mirror_posture.robots import Nominal
from mirror_posture.robots.nominal import EMBEDDED_FOLDER
from mirror_posture.shapes.triangles import box, write_stl
from test_correct_command import FAST, run

ROBOT = TwinOptions(pictures=False)
NOSE_M = 0.3


@pytest.fixture
def nosed(tmp_path: Path) -> Nominal:
    """The embedded robot with a nose of a mesh, which reaches towards the mirror beyond all else."""
    folder = tmp_path / "nosed"
    shutil.copytree(EMBEDDED_FOLDER, folder, ignore=shutil.ignore_patterns("__*"))
    (folder / "parts").mkdir()
    write_stl(box(np.array([NOSE_M, 0.04, 0.04])), folder / "parts" / "nose.stl")
    shape = '<geometry><mesh filename="parts/nose.stl"/></geometry>'
    nose = (
        f'<link name="nose"><visual>{shape}</visual></link><joint name="nose_mount" type="fixed"><parent link="base_link"/>'
        f'<child link="nose"/><origin xyz="{0.05 + NOSE_M / 2} 0 0"/></joint></robot>'
    )
    file = folder / "robot.urdf"
    file.write_text(file.read_text().replace("</robot>", nose))
    return Nominal.load(folder)


def test_the_robots_meshes_are_kept(nosed: Nominal, tmp_path: Path) -> None:
    """Before, only its URDF: a correction that was gone on with proposed a mirror inside the robot."""
    whole = make_target(nosed, POSTURE, CorrectOptions())
    joints = nosed.robot.position_names
    Recorder.start(tmp_path / "run", nosed, joints)
    kept = make_target(Nominal.load(tmp_path / "run"), POSTURE, CorrectOptions())
    assert reach_m(whole) > NOSE_M and reach_m(kept) == pytest.approx(reach_m(whole), abs=0.01)
    assert propose_views(kept, 3)[0].distance_m > NOSE_M
    # Those that are simplified already are kept as they are, time and again.
    Recorder.start(tmp_path / "second", Nominal.load(tmp_path / "run"), joints)
    copies = [next((tmp_path / name / "meshes").iterdir()) for name in ("run", "second")]
    assert copies[0].name == copies[1].name and copies[0].read_bytes() == copies[1].read_bytes()


def test_the_proposed_views_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A correction that is gone on with looks from where it looked before, whatever is found of its robot now."""
    options = CorrectOptions(step=OPTIONS.step, stop=OPTIONS.stop)
    robot = TwinRobot(HIDDEN, ROBOT)

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    recorder = Recorder.start(tmp_path / "run", robot.nominal, robot.joint_names)
    assert correct(robot, POSTURE, options, recorder=recorder, on_look=stop).stop.kind == "interrupted"
    recorder, header = Recorder.resume(tmp_path / "run")
    assert recorder.proposed is not None and recorder.proposed.count == 5
    assert [view.distance_m for view in recorder.proposed.views] == [
        one[2] for one in header["proposed"]["views"]
    ]

    def proposed(*_: object, **__: object) -> None:
        raise AssertionError("proposed once more")

    monkeypatch.setattr(viewpoints, "propose_views", proposed)
    assert correct(TwinRobot(HIDDEN, ROBOT), POSTURE, options, recorder=recorder).converged
    # Another question has another answer.
    recorder, _ = Recorder.resume(tmp_path / "run")
    with pytest.raises(AssertionError, match="once more"):
        correct(TwinRobot(HIDDEN, ROBOT), POSTURE, CorrectOptions(views_a_look=4), recorder=recorder)
    file = tmp_path / "run" / "correction.json"
    file.write_text(file.read_text().replace('"count": 5', '"count": null'))
    with pytest.raises(MirrorPostureError, match="proposed: got what are no views"):
        Recorder.resume(tmp_path / "run")


def test_a_resume_that_is_refused_leaves_a_finished_session_finished(tmp_path: Path) -> None:
    """Before, the session counted as one that is being recorded, for good."""
    out = tmp_path / "run"
    run("correct", "twin", "--out", out, *FAST)
    assert not load_session(out).warnings
    before = {file.name: file.read_bytes() for file in out.iterdir() if file.is_file()}
    assert "leave that away" in " ".join(
        run("correct", "twin", "--out", out, "--resume", "--gain", "0.1", code=1).stderr.split()
    )
    assert {file.name: file.read_bytes() for file in out.iterdir() if file.is_file()} == before
    assert not load_session(out).warnings
    # A robot that then cannot be opened comes after this.
    recorder, _ = Recorder.resume(out)
    recorder.close()
    assert not load_session(out).warnings


HOLDER = """
import sys
from mirror_posture.correct import Recorder
recorder, _ = Recorder.resume(sys.argv[1])
print("there", flush=True)
sys.stdin.read()
"""


@pytest.mark.skipif(folder_lock.fcntl is None, reason="no locks here")
def test_a_recording_has_one_writer(tmp_path: Path) -> None:
    """Before, two that went on with one folder wrote one frame twice, and no command read it any more."""
    robot = TwinRobot(HIDDEN, ROBOT)
    out = tmp_path / "run"
    Recorder.start(out, robot.nominal, robot.joint_names).close()
    child = subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(out)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert child.stdout is not None and child.stdout.readline() == "there\n"
    with pytest.raises(MirrorPostureError, match=f"process {child.pid} on .* records into it"):
        Recorder.resume(out)
    child.kill()
    child.wait()
    older, _ = Recorder.resume(out)
    newer, _ = Recorder.resume(out)
    look = robot.look()
    newer.capture(look, 0)
    with pytest.raises(MirrorPostureError, match="another one of this program goes on"):
        older.capture(look, 0)
    assert len(load_session(out).frames) == 1
    newer.close()
    assert not (out / folder_lock.LOCK).exists()


@pytest.mark.parametrize(
    ("told", "said"),
    [
        (None, "command_for_posture: got None, needed a command"),
        ([], r"command_for_posture: got \[\], needed a command"),
        ({"elbow": 0.1}, "got joint 'elbow', and twin has .*r_elbow"),
        ({"r_elbow": "0.1"}, "got '0.1' for joint 'r_elbow', needed a finite number"),
        ([{"r_elbow": float("nan")}, {}], "got nan for joint 'r_elbow'"),
    ],
)
def test_a_first_command_that_is_none_is_refused(told: object, said: str) -> None:
    """Before, a TypeError, or a joint of another name that was passed over: the robot began elsewhere than it was told to."""
    with pytest.raises(MirrorPostureError, match=said):
        correct(TwinRobot((), ROBOT), POSTURE, command_for_posture=lambda _: told)  # type: ignore[arg-type,return-value]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ("--servos", "nowhere.toml"),
            "--servos: got twin, needed dynamixel or feetech, which alone has this option",
        ),
        (("--inbox", "nowhere"), "--inbox: got twin, needed by-hand"),
        (("--camera", "0"), "--camera: got twin, needed dynamixel or feetech"),
        (("--robot-class", "a:B"), "--robot-class: got twin, needed own"),
        (("--turn-by", "r_hip_yaw=0", "--turn-by", "r_hip_yaw=100mm"), "r_hip_yaw turns: needed an angle"),
    ],
)
def test_what_would_be_passed_over_is_refused(tmp_path: Path, words: tuple[str, ...], said: str) -> None:
    """Before, without a word; --robot-class won over the robot that was named, and 100 mm of a hip were 0.1 rad."""
    told = " ".join(run("correct", "twin", "--out", tmp_path / "a", *FAST, *words, code=1).stderr.split())
    assert said in told and not (tmp_path / "a").exists()
