"""Sessions in motion on models of the user's: gains that the compiler computes, mounts that are turned, what is left out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mirror_posture as mp
from session_folder import replaced
from test_simulate_models import SERVOS, model_of, session_of

mujoco = pytest.importorskip("mujoco")


def rollouts_of(session: mp.Session, model: Path) -> Any:
    """The simulator of a motion of the small arm."""
    from mirror_posture.session.types import States
    from mirror_simulation.motion.recording import Recording
    from mirror_simulation.motion.rollouts import Rollouts

    time = np.linspace(0.0, 0.5, 20)
    states = States(time, ("shoulder", "elbow"), 0.3 * np.stack([np.sin(time), np.sin(2.0 * time)], axis=1))
    recording = Recording(session, states, time[:, None] * np.ones((1, 2)), time)
    return Rollouts(recording, model, exact=False)


def test_gains_of_a_servo_given_by_its_damping_ratio_are_written(tmp_path: Path) -> None:
    """Before: the file's ratio was taken for the damping, and the patched model's was off by its factor and its sign."""
    from mirror_simulation.motion.patched import patched_model

    servos = SERVOS.replace('kp="2000" kv="20"', 'kp="200" dampratio="1"')
    rollouts = rollouts_of(session_of(tmp_path / "session"), model_of(tmp_path, servos))
    # Fitted parameters of half the stiffness at the same damping.
    causes = {("servo_gain", "joint:shoulder"): (1.0, 1.0), ("reflected_inertia", "joint:elbow"): (0.01,)}
    patched = mujoco.MjModel.from_xml_string(patched_model(rollouts, causes))
    simulated = rollouts._changed(causes)
    for servo in ("ps", "pe"):
        here, there = simulated.actuator(servo), patched.actuator(servo)
        assert np.allclose(there.gainprm[0], here.gainprm[0], rtol=1e-4)
        assert np.allclose(there.biasprm[:3], here.biasprm[:3], rtol=1e-4)
    before = rollouts.model.actuator("ps")
    assert before.biasprm[2] < -0.1
    assert np.isclose(patched.actuator("ps").biasprm[2], before.biasprm[2], rtol=1e-4)
    assert np.isclose(patched.actuator("ps").gainprm[0], 0.5 * before.gainprm[0])


@pytest.fixture(scope="module")
def late(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short motion from the judge's own simulator."""
    pytest.importorskip("pinocchio")
    pytest.importorskip("mirror_lab")
    from mirror_lab.moving.make import make_case

    folder = tmp_path_factory.mktemp("motion") / "late"
    make_case(folder, "small", ["latency"], np.random.default_rng(7), 4.5)
    return folder


def test_a_marker_is_displaced_in_the_frame_of_its_mount(late: Path, tmp_path: Path) -> None:
    """Before: in its own frame, so that a turn of the mount in the URDF turned the displacement too."""
    from mirror_simulation.motion.problem import Problem

    session = mp.load_session(late)
    text = session.robot_file.read_text()
    at = text.index('name="r_hand_marker_mount"')
    turned = text[:at] + replaced(text[at:], 'rpy="0 0 0"', 'rpy="0.7 -0.4 1.9"')
    other = replace(session, robot=mp.Robot.from_urdf_text(turned))
    causes = {("marker_mount", "marker:r_hand"): (0.004, -0.002, 0.003)}
    one, two = (Problem(s, late / "model.xml") for s in (session, other))
    seen = one.view.seen & two.view.seen
    moved = np.abs(one.errors_px(causes) - one.errors_px({}))[seen].max()
    assert moved > 1.0
    assert np.allclose(one.errors_px(causes)[seen], two.errors_px(causes)[seen], atol=1e-6)


def test_what_is_left_out_is_listed_with_its_deviations(late: Path) -> None:
    """Before: without `deviations`, which the format lists."""
    from mirror_simulation.motion.alternatives import Rivals
    from mirror_simulation.motion.diagnose import covariance
    from mirror_simulation.motion.problem import Problem
    from mirror_simulation.motion.report import document
    from mirror_simulation.motion.search import search

    problem = Problem(mp.load_session(late), late / "model.xml")
    problem.hypotheses = {key: one for key, one in problem.hypotheses.items() if key[0] == "latency"}
    f, m = (int(index[20]) for index in np.nonzero(problem.view.seen))
    problem.view.image_px[f, m] += (30.0, -40.0)
    problem.leave_out_false({})
    found = search(problem, 1)
    rivals = {key: Rivals(0.9, ()) for key in found.best.causes}
    tree = document(problem, found, rivals, covariance(problem, found))
    left_out = {(entry["frame"], entry["target"]): entry for entry in tree["data"]["left_out"]}
    assert left_out and all(entry["deviations"] > 0.0 for entry in left_out.values())
    moved = left_out[int(problem.session.frames.frame[f]), problem.session.marker_names[m]]
    scale = found.noise_scale * problem.view.noise_px
    # By 50 px, in units of an image's noise and its mirror's.
    assert 0.2 * 50.0 / scale < moved["deviations"] < 1.2 * 50.0 / scale


def test_a_false_image_makes_no_other_of_its_picture_false(late: Path) -> None:
    from mirror_simulation.motion.diagnose import _false
    from mirror_simulation.motion.problem import Problem
    from mirror_simulation.motion.search import search

    problem = Problem(mp.load_session(late), late / "model.xml")
    problem.hypotheses = {key: one for key, one in problem.hypotheses.items() if key[0] == "latency"}
    several = np.flatnonzero(problem.view.seen.sum(axis=1) > 1)
    moved = np.zeros_like(problem.view.seen)
    for f in several[5:-5:7]:
        moved[f, int(np.flatnonzero(problem.view.seen[f])[0])] = True
    problem.view.image_px[moved] += (30.0, -40.0)
    problem.leave_out(moved)
    found = search(problem, 1)
    problem.leave_out(np.zeros_like(moved))
    assert moved.sum() > 3
    assert (_false(problem, found) == moved).all()
