"""`mirror-posture correct` as anybody would call it: files, words, exit codes, Ctrl-C, resuming."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import cv2
import pytest
from typer.testing import CliRunner

from mirror_posture import load_session
from mirror_posture.cli import app

TARGET = ("--joint", "r_shoulder_pitch=-30,r_shoulder_roll=50", "--joint", "r_elbow=0.785rad")
HIDDEN = ("--hide", "joint_offset@joint:r_elbow:offset_rad=0.06")
FAST = (*TARGET, *HIDDEN, "--no-pictures")


def run(*words: object, code: int = 0):  # type: ignore[no-untyped-def]
    ended = CliRunner().invoke(app, [str(word) for word in words])
    assert ended.exit_code == code, f"{ended.exit_code}: {ended.output}\n{ended.exception!r}"
    return ended


def test_a_twin_is_corrected_and_everything_is_in_the_folder(tmp_path: Path) -> None:
    out = tmp_path / "corrected"
    ended = run("correct", "twin", "--out", out, *FAST)
    told = " ".join(ended.output.split())
    assert re.search(
        r"converged: every marker is within 1\.00 mm of its target \(measured (0\.\d\d(, | and | mm away))+, at most (0\.\d\d(, | and | mm with))+ "
        r"the measurement's uncertainty\); wrong in at most 1 % of corrections",
        told,
    ), told
    tree = json.loads((out / "outcome.json").read_text())
    assert tree["stop"]["kind"] == "converged"
    data = tree["data"]
    assert data["pictures_given"] == data["pictures_used"] == tree["views"] > 2
    assert data["looks_given"] == data["looks_used"] == len(tree["looks"]) and data["left_out"] == []
    assert (
        "pictures, " in ended.output
        and f"used: {data['looks_used']} of {data['looks_given']} looks" in ended.output
    )
    assert tree["best_command"]["r_elbow"] == pytest.approx(0.785 - 0.06, abs=0.01)
    assert cv2.imread(str(out / "convergence.png")).shape[1] > 800
    session = load_session(out)
    assert session.detected and session.warnings == () and len(session.frames) == tree["views"]
    # A folder that is there is not written over.
    assert "is there already" in run("correct", "twin", "--out", out, *FAST, code=1).stderr


def test_json_is_one_document_and_a_target_out_of_reach_exits_with_three(tmp_path: Path) -> None:
    ended = run("correct", "twin", "--out", tmp_path / "a", *FAST, "--hold", "r_elbow", "--json", code=3)
    tree = json.loads(ended.stdout)
    assert tree["stop"]["kind"] == "stalled" and tree["stop"]["evidence"]["cause"] == "out_of_reach"
    assert "no posture of the free joints" in tree["stop"]["sentence"]
    assert tree["looks"][0]["markers"][0]["marker"] == "r_hand"


def test_a_target_from_a_file_and_views_of_ones_own(tmp_path: Path) -> None:
    file = tmp_path / "posture.toml"
    file.write_text("r_shoulder_pitch = -0.5\nr_shoulder_roll = 0.9\nr_elbow = 0.7\n")
    out = tmp_path / "a"
    words = ("--view", "0,0", "--view", "15", "--view", "-5,9", "--gain", 0.5, "--jacobian", "broyden")
    run("correct", "twin", "--out", out, "--target", file, *HIDDEN, "--no-pictures", *words)
    assert load_session(out).frames.commanded[0, 2] == -0.5


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("twin", *TARGET, "--hide", "joint_offset"), "EFFECT@PLACE"),
        (("twin",), "no target"),
        (("twin", "--joint", "r_elbow"), "JOINT=DEGREES"),
        (("twin", "--joint", "r_elbo=3"), "r_elbow"),
        (("twin", "--joint", "r_elbow=300"), "r_elbow"),
        (("robbie", *TARGET), "by-hand"),
        (("by-hand", *TARGET), "--inbox"),
        (("feetech", *TARGET), "--servos"),
        (("own", *TARGET, "--robot-class", "nowhere:Robot"), "nowhere"),
        (("own", *TARGET, "--robot-class", "builtins:str"), "lacks command"),
        (("twin", *TARGET, "--estimator", "guess", "--no-pictures"), "maximum-likelihood"),
        (("twin", *TARGET, "--jacobian", "guess", "--no-pictures"), "broyden"),
        (("twin", *TARGET, "--view", "x", "--no-pictures"), "YAW,PITCH"),
        (("twin", *TARGET, "--resume"), "no correction"),
    ],
)
def test_bad_input_is_one_clear_line(tmp_path: Path, words: tuple[str, ...], said: str) -> None:
    ended = run("correct", "--out", tmp_path / "a", *words, code=1)
    assert said in ended.stderr and ended.stderr.startswith("error: "), ended.stderr
    assert not (tmp_path / "a").exists(), "a folder in the way of the next try"


def test_what_a_resumed_correction_cannot_take_over_is_refused(tmp_path: Path) -> None:
    """Before, all options but the robot were dropped without a word: `--resume --looks 40` changed nothing."""
    out = tmp_path / "a"
    words = ("correct", "twin", "--out", out, *FAST, "--looks", "1", "--gain", "0.3")
    run(*words, code=3)
    before = (out / "frames.csv").read_bytes()
    told = run("correct", "twin", "--out", out, "--resume", "--looks", "40", "--gain", "0.8", code=1).stderr
    assert "was begun with --gain 0.3, not 0.8, and with --looks 1, not 40; leave that away" in " ".join(
        told.split()
    )
    told = run("correct", "by-hand", "--out", out, "--resume", code=1).stderr
    assert "was begun with robot twin, not by-hand" in " ".join(told.split())
    assert (out / "frames.csv").read_bytes() == before
    # What is the same, or is not said, is taken over.
    for said in (words, ("correct", "twin", "--out", out)):
        assert "going on with" in run(*said, "--resume", code=3).output


# What was begun in the background ignores the interrupt, what was begun by nohup the hang-up.
HEARD = (
    "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
    "signal.signal(getattr(signal, 'SIGHUP', signal.SIGTERM), signal.SIG_DFL); "
)


def test_a_signal_that_ends_the_program_rests_first(tmp_path: Path) -> None:
    name = "SIGHUP"
    out = tmp_path / "stopped"
    words = ["correct", "own", "--robot-class", "slow_robot:SlowRobot", "--out", str(out), *TARGET]
    path = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    child = subprocess.Popen(
        [
            sys.executable,
            "-c",
            HEARD + "from mirror_posture.cli import main; main()",
            *words,
            "--gain",
            "0.3",
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=dict(os.environ) | {"PYTHONPATH": path, "SLOW_ROBOT_WAITS_AT": "4"},
    )
    assert child.stderr is not None and child.stderr.readline().startswith("look 1")
    child.send_signal(getattr(signal, name))
    said, errors = child.communicate(timeout=60)
    assert child.returncode == 130, errors
    assert "at rest" in said and f"interrupted: {name}" in said
    assert len(load_session(out).frames) >= 3


def test_markers_that_a_look_does_not_see_share_one_text(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from types import SimpleNamespace

    from matplotlib.figure import Figure

    from mirror_posture.correct.figures import plot_convergence

    texts: list[list[str]] = []
    monkeypatch.setattr(
        Figure, "savefig", lambda figure, *_, **__: texts.append([t.get_text() for t in figure.axes[0].texts])
    )
    names = ("hand", "elbow", "head")
    for unseen in (names[1:2], names[1:], tuple(f"a_marker_with_a_long_name_{k}" for k in range(3))):
        known = ("hand", *unseen)
        markers = [
            SimpleNamespace(
                marker=name, distance_m=None if name in unseen else 0.01, below_m=0.012, doubt=None
            )
            for name in known
        ]
        outcome = SimpleNamespace(
            looks=[SimpleNamespace(look=1, markers=markers)],
            markers=known,
            stop=SimpleNamespace(sentence="ended"),
        )
        plot_convergence(outcome, tmp_path / "convergence.png", 0.003)  # type: ignore[arg-type]
    told = [[text for text in ones if "not seen" in text] for ones in texts]
    assert told == [["elbow not seen"], ["elbow, head not seen"], ["3 markers not seen"]]


def test_ctrl_c_rests_exits_with_130_and_resume_goes_on(tmp_path: Path) -> None:
    out = tmp_path / "stopped"
    program = [sys.executable, "-c", HEARD + "from mirror_posture.cli import main; main()"]
    words = [
        "correct",
        "own",
        "--robot-class",
        "slow_robot:SlowRobot",
        "--out",
        str(out),
        *TARGET,
        "--gain",
        "0.3",
    ]
    here = str(Path(__file__).parent)
    environment = dict(os.environ) | {"PYTHONPATH": os.pathsep.join([here, os.environ.get("PYTHONPATH", "")])}
    child = subprocess.Popen(
        [*program, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment | {"SLOW_ROBOT_WAITS_AT": "7"},
    )
    assert child.stderr is not None and child.stdout is not None
    told = [child.stderr.readline(), child.stderr.readline()]
    assert told[1].startswith("look 2"), told
    child.send_signal(signal.SIGINT)
    said, errors = child.communicate(timeout=60)
    assert child.returncode == 130, errors
    assert "at rest" in said and "interrupted" in said
    before = load_session(out)
    assert len(before.frames) >= 6
    ended = subprocess.run(
        [*program, *words, "--resume"],
        capture_output=True,
        text=True,
        env=environment,
        timeout=120,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    assert "going on with" in ended.stdout and "converged" in ended.stdout
    session = load_session(out)
    assert len(session.frames) > len(before.frames) and session.warnings == ()
