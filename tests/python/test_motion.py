"""A body in motion: sessions from pinocchio's dynamics with an integrator and actuators of their own, diagnosed in MuJoCo."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import mirror_posture as mp
from diagnosis_format import faults

mujoco = pytest.importorskip("mujoco")
pytest.importorskip("pinocchio")
pytest.importorskip("mirror_lab")

from mirror_lab.moving.make import make_case  # noqa: E402

SECONDS = 5.0


@pytest.fixture(scope="module")
def late(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, float]:
    folder = tmp_path_factory.mktemp("motion") / "late"
    answer = make_case(folder, "small", ["latency"], np.random.default_rng(7), SECONDS)
    return folder, answer["causes"][0]["latency_s"]


def test_a_late_camera_is_found_and_another_motion_is_predicted(
    late: tuple[Path, float], tmp_path: Path
) -> None:
    from mirror_posture.cli.app import app

    folder, latency_s = late
    model = folder / "model.xml"
    other = folder.parent / "late-unseen"
    run = CliRunner().invoke(
        app,
        [
            "diagnose",
            str(folder),
            "--model",
            str(model),
            "--check",
            str(other),
            "--out",
            str(tmp_path / "out"),
        ],
    )
    assert run.exit_code == 0, run.output
    tree = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert faults(tree) == []
    (cause,) = tree["causes"]
    assert (cause["effect"], cause["at"]) == ("latency", "camera")
    assert abs(cause["parameters"]["latency_s"]["value"] - latency_s) < 0.002
    assert tree["verdict"] == "explained"
    assert cause["stability"] == 1.0
    # A late camera is nothing to encoders: within their ticks they read what the model as it is does.
    assert tree["encoder_witness"]
    assert all(e["before"] == e["after"] < 1.5e-3 and not e["named"] for e in tree["encoder_witness"])
    page = (tmp_path / "out" / "report.html").read_text()
    assert "What this motion would have hidden" in page and "shift the pictures&#39; time stamps" in page
    assert page.count('aria-label="Bars: the gap') == 1 and len(page) < 3_000_000
    (checked,) = tree["gap"]["checked"]
    assert checked["after_m"] < 0.3 * checked["before_m"]
    assert "latency at camera" in (tmp_path / "out" / "model.xml").read_text()
    assert (tmp_path / "out" / "report.html").stat().st_size > 20_000
    mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "model.xml"))


def test_a_motion_shows_what_is_larger_than_its_limits_and_hides_what_is_smaller(
    late: tuple[Path, float],
) -> None:
    """The images moved by hand as each cause would: three times its limit is found at its place, a tenth of it is not found."""
    from mirror_simulation.motion.problem import Problem
    from mirror_simulation.motion.search import search
    from mirror_simulation.motion.shown import limits

    problem = Problem(mp.load_session(late[0]), late[0] / "model.xml")
    joint = next(name for name in problem.scales if name.endswith("elbow"))
    # Of all joints one: each costs simulations.
    problem.hypotheses = {
        key: one for key, one in problem.hypotheses.items() if key[1] in (f"joint:{joint}", "camera", "board")
    }
    found = search(problem, 1)
    told = {(entry["effect"], entry["at"]): entry["parameters"] for entry in limits(problem, found)}
    assert ("latency", "camera") in found.best.causes and ("latency", "camera") not in told
    size = told["gear_ratio", f"joint:{joint}"]["scale_error"]
    assert size is not None and 1e-5 < size < 0.05
    shown: dict[float, set[tuple[str, str]]] = {}
    for times in (3.0, 0.1):
        there = {**found.best.causes, ("gear_ratio", f"joint:{joint}"): (times * size,)}
        images = problem.view.image_px
        problem.view.image_px = images + problem.errors_px(found.best.causes) - problem.errors_px(there)
        again = search(problem, 2, start=found.best.causes)
        shown[times] = set(again.best.causes) - set(found.best.causes)
        problem.view.image_px = images
    assert shown == {3.0: {("gear_ratio", f"joint:{joint}")}, 0.1: set()}


def test_twins_below_the_noise_stay_ambiguous_and_a_move_is_told_that_parts_them(
    late: tuple[Path, float],
) -> None:
    """The images moved by hand as a late servo would: of one far below the noise several laws say the same, of a large one none does."""
    from mirror_simulation.motion.alternatives import rivals_of
    from mirror_simulation.motion.next_moves import next_moves, postures
    from mirror_simulation.motion.problem import Problem
    from mirror_simulation.motion.search import search

    problem = Problem(mp.load_session(late[0]), late[0] / "model.xml")
    joint = f"joint:{next(name for name in problem.scales if name.endswith('elbow'))}"
    problem.hypotheses = {
        key: one for key, one in problem.hypotheses.items() if key[1] == joint or key[0] == "latency"
    }
    first = search(problem, 1)
    images, twins = (
        problem.view.image_px,
        {("servo_lag", joint), ("viscous_friction", joint), ("servo_gain", joint)},
    )
    told = {}
    for lag_s in (0.002, 0.06):
        there = {**first.best.causes, ("servo_lag", joint): (lag_s,)}
        problem.view.image_px = images + problem.errors_px(first.best.causes) - problem.errors_px(there)
        found = search(problem, 2, start=first.best.causes)
        (new,) = set(found.best.causes) - set(first.best.causes)
        rivals = rivals_of(problem, found, new)
        told[lag_s] = dict(rivals.others) | {new: rivals.probability}
        if lag_s == 0.002:
            (move,) = next_moves(problem, found, {new: rivals}, [])
            assert f"joint:{move.joint}" == joint and move.pictures > 0
            assert [p[move.joint] for p in postures([move])] == [
                move.start[move.joint],
                move.end[move.joint],
            ]
    problem.view.image_px = images
    weak, strong = told[0.002], told[0.06]
    assert sum(weak.get(key, 0.0) for key in twins) > 0.9 and max(weak.values()) < 0.8
    assert weak["servo_lag", joint] > 0.05
    assert strong["servo_lag", joint] > max(0.75, max(weak.values()))


def test_encoders_see_a_late_servo_and_no_wrong_zero(late: tuple[Path, float]) -> None:
    from mirror_simulation.motion.encoders import encoder_witness
    from mirror_simulation.motion.problem import Problem

    problem = Problem(mp.load_session(late[0]), late[0] / "model.xml")
    joint = next(name for name in problem.scales if name.endswith("elbow"))
    told = {
        effect: {e["joint"]: e for e in encoder_witness(problem, {(effect, f"joint:{joint}"): (0.03,)})}
        for effect in ("servo_lag", "joint_offset")
    }
    assert told["servo_lag"][joint]["after"] > 5.0 * told["servo_lag"][joint]["before"]
    assert told["joint_offset"][joint]["after"] == told["joint_offset"][joint]["before"]
    assert told["servo_lag"][joint]["named"]


def test_columns_are_the_differences_of_residuals(late: tuple[Path, float]) -> None:
    from mirror_simulation.motion.problem import Problem

    problem = Problem(mp.load_session(late[0]), late[0] / "model.xml")
    joint = next(name for name in problem.scales if name.endswith("elbow"))
    seen = problem.view.seen
    for key in (
        ("viscous_friction", f"joint:{joint}"),
        ("joint_compliance", f"joint:{joint}"),
        ("latency", "camera"),
        ("marker_mount", f"marker:{problem.session.marker_names[0]}"),
        ("board_mount", "board"),
    ):
        of, columns = problem.columns({}, [key])
        step = problem.hypotheses[key].step
        assert [slot for _, slot in of] == list(range(len(step))), key
        for k, (_, slot) in enumerate(of):
            values = tuple(0.5 * s if i == slot else 0.0 for i, s in enumerate(step))
            base, moved = problem.residuals([{}, {key: values}])
            assert base is not None and moved is not None
            exact = 2.0 * (base - moved)[seen]
            told = columns[..., k][seen]
            # Of this motion 7 at least, the residuals' own unit.
            assert np.linalg.norm(exact) > 1.0, (key, slot)
            assert np.linalg.norm(told - exact) < 0.05 * np.linalg.norm(exact) + 1e-9, (key, slot)


def test_a_spring_may_be_off_its_straight_line_by_no_more_than_a_tenth(late: tuple[Path, float]) -> None:
    from mirror_simulation.motion.problem import Problem
    from mirror_simulation.motion.springs import stiffening_columns

    problem = Problem(mp.load_session(late[0]), late[0] / "model.xml")
    joint = f"joint:{next(name for name in problem.scales if name.endswith('elbow'))}"
    key, give = ("joint_compliance", joint), 0.02 / problem.scales[joint.partition(":")[2]].torque
    _, columns = problem.columns({key: (give,)}, [key])
    whole = columns[..., 0] * give / problem.hypotheses[key].step[0]
    off = stiffening_columns(problem, {key: (give,)})[..., 0]
    assert np.all(np.abs(off) <= 0.1 * np.abs(whole) + 1e-6 * np.abs(whole).max())
    share = np.linalg.norm(off) / np.linalg.norm(whole)
    assert 0.02 < share < 0.1
    assert stiffening_columns(problem, {("latency", "camera"): (0.01,)}).shape[-1] == 0


def test_limits_of_torque_are_tried_where_they_act(late: tuple[Path, float]) -> None:
    """A servo jerks once where the log begins in the middle of a motion: of a limit just below that jerk nothing is seen."""
    from mirror_simulation.motion.problem import Problem

    problem = Problem(mp.load_session(late[0]), late[0] / "model.xml")
    rollouts = problem.rollouts
    for name, scale in problem.scales.items():
        torque = np.abs(rollouts.servo_torque(rollouts.nominal())[:, rollouts.joints.index(name)])
        acts = [float((torque > size).mean()) for size in scale.torque_sizes]
        assert acts == sorted(acts, reverse=True) and 0.01 < acts[-1] < 0.03 < acts[0], name
        assert np.allclose(np.diff(np.log(scale.torque_sizes)), -np.log(0.95))


def test_limbs_that_feel_nothing_of_each_other_are_simulated_together(late: tuple[Path, float]) -> None:
    from mirror_simulation.motion.problem import Problem

    rollouts = Problem(mp.load_session(late[0]), late[0] / "model.xml").rollouts
    assert sorted(np.concatenate(rollouts.branches)) == list(range(len(rollouts.joints)))
    left, right = (next(n for n in rollouts.joints if n.endswith(f"{side}_elbow")) for side in "lr")
    causes = [
        {("coulomb_friction", f"joint:{left}"): (0.05,), ("servo_lag", f"joint:{left}"): (0.02,)},
        {("servo_gain", f"joint:{right}"): (0.5, 0.2)},
    ]
    before = rollouts.count
    together = rollouts.motions(causes)
    assert rollouts.count == before + 1
    nominal = rollouts.nominal().position
    for name, cause, motion in zip((left, right), causes, together, strict=True):
        ((*parts,),) = rollouts._run([cause])
        alone = np.empty_like(nominal)
        for branch in parts:
            assert branch is not None
            alone[:, branch.columns] = branch.position
        assert motion is not None
        assert np.abs(alone - motion.position).max() < 1e-9
        assert np.abs(motion.position - nominal)[:, rollouts.joints.index(name)].max() > 1e-3


def test_encoders_tell_for_how_long_a_falling_limb_had_stood(late: tuple[Path, float]) -> None:
    """A limb stands at its first command for a time that nobody tells, and its servo cannot hold it."""
    from dataclasses import replace

    from mirror_simulation.motion.recording import recording_of
    from mirror_simulation.motion.rollouts import STEP_S, Rollouts

    recording = recording_of(mp.load_session(late[0]))
    plain = Rollouts(recording, late[0] / "model.xml", exact=False)
    joint = next(name for name in plain.joints if name.endswith("l_elbow"))
    torque = np.abs(plain.servo_torque(plain.nominal())[:, plain.joints.index(joint)])
    weak = {("torque_limit", f"joint:{joint}"): (0.2 * float(np.quantile(torque, 0.98)),)}
    assert plain._falls(weak) == () and plain.falling_joint() is None
    controls = plain._controls(weak)[-len(plain.time_s) :]
    for stood in (111, 203):
        told = np.concatenate([np.repeat(controls[:1], stood, axis=0), controls])
        (run,) = plain._pool.run([plain._changed(weak)], plain._pool.at_rest(plain.commands[0])[None], [told])
        true = run[stood - 1 : -1][:, plain._pool.positions_at(np.arange(len(plain.joints)))]
        log = recording.states.time_s
        tick = 2.0 * np.pi / 4096.0
        read = np.stack([np.interp(log, plain.time_s, q) for q in true.T], axis=1)
        states = replace(recording.states, measured_names=plain.joints, measured=np.round(read / tick) * tick)
        rollouts = Rollouts(replace(recording, states=states), late[0] / "model.xml", exact=False)
        assert rollouts.falling_joint() == joint
        (found,), (blind,) = rollouts.motions([weak]), plain.motions([weak])
        assert found is not None and blind is not None
        assert np.abs(found.position - true).max() < 0.005 < 0.1 < np.abs(blind.position - true).max(), stood
        assert STEP_S == 0.002 and rollouts.stood_longer(weak) is None


def test_what_is_no_motion_is_said(late: tuple[Path, float], tmp_path: Path) -> None:
    from dataclasses import replace

    from mirror_simulation.motion import is_moving
    from mirror_simulation.motion.problem import Problem
    from mirror_simulation.motion.recording import recording_of, shutter

    session = mp.load_session(late[0])
    assert is_moving(session) and not session.warnings
    still = replace(session, states=None)
    assert not is_moving(still)
    with pytest.raises(mp.MirrorPostureError, match=r"states\.csv"):
        recording_of(still)
    with pytest.raises(mp.MirrorPostureError, match="exposure_s"):
        shutter({"shutter": {"exposure_s": -1.0}})
    with pytest.raises(mp.MirrorPostureError, match="no position servos"):
        Problem(session)
    recording = recording_of(session)
    exposure_s, readout_s = shutter(session.metadata)
    spread = np.ptp(recording.marker_time_s - np.asarray(session.frames.time_s)[:, None])
    assert spread <= readout_s + 1e-9 and recording.board_time_s.min() >= 0.5 * exposure_s


@pytest.mark.parametrize("missing", ["mirror_posture.motion", "mujoco"])
def test_without_the_distribution_or_mujoco_a_motion_is_refused_in_one_line(
    late: tuple[Path, float], monkeypatch: pytest.MonkeyPatch, missing: str
) -> None:
    from mirror_posture.cli import plugins
    from mirror_posture.cli.app import app

    class Broken:
        name = "motion"

        def load(self) -> None:
            raise ModuleNotFoundError("No module named 'mujoco'", name="mujoco")

    # Not the class of the entry points: a package may have replaced it by a backport's.
    points = (Broken(),) if missing == "mujoco" else ()
    monkeypatch.setattr(plugins, "entry_points", lambda group: points)
    done = CliRunner().invoke(app, ["diagnose", str(late[0]), "--model", str(late[0] / "model.xml")])
    assert done.exit_code == 1
    (line,) = done.stderr.strip().splitlines()
    assert "is a session in motion; pip install 'mirror-posture[mujoco]'" in line


def test_options_that_a_motion_has_not_are_refused(late: tuple[Path, float], tmp_path: Path) -> None:
    """Before they were passed over, and a fleet took each picture of the motion for a still posture."""
    from mirror_posture.cli.app import app

    words = ["diagnose", str(late[0]), "--model", str(late[0] / "model.xml"), "--out", str(tmp_path / "out")]
    for option, value in (
        ("--without", "latency"),
        ("--withhold", "marker:hand"),
        ("--rerun", str(tmp_path / "a.rrd")),
        ("--scheduler", "tcp://127.0.0.1:9"),
    ):
        done = CliRunner().invoke(app, [*words, option, value])
        assert done.exit_code == 1, option
        told = " ".join(done.stderr.split())
        assert (
            f"{option}: {late[0]} is a session in motion" in told
            and "needed sessions of still postures" in told
        )
    assert not (tmp_path / "out").exists()


def test_a_motion_that_diverges_is_none_and_leaves_no_file(
    late: tuple[Path, float], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from mirror_simulation.motion.problem import Problem

    rollouts = Problem(mp.load_session(late[0]), late[0] / "model.xml").rollouts
    joint = next(name for name in rollouts.joints if name.endswith("elbow"))
    monkeypatch.chdir(tmp_path)
    assert rollouts.motions([{("reflected_inertia", f"joint:{joint}"): (-50.0,)}]) == [None]
    assert not list(tmp_path.iterdir())
