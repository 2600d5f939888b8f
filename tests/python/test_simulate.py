"""The staircase: bodies made by the judge's own simulator, whose true causes close the gap in the product's."""

from __future__ import annotations

import functools
import json
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from typer.testing import CliRunner

import mirror_posture as mp
from mirror_posture.diagnosis.parts import Cause, Estimate, Gap
from mirror_posture.diagnosis.result import Diagnosis

mujoco = pytest.importorskip("mujoco")
pytest.importorskip("mirror_lab")

WITH_PICTURES = "frame,posture,image,shoulder,elbow\n0,0,images/0.png,0.1,0.2\n"
SIMULATED = ("gear_ratio", "link_length", "axis_tilt")


Made = Callable[[str, int], tuple[Path, list[Cause]]]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """A session with one cause, from the judge's simulator, and the true cause; of each kind one is made, and no test writes to it."""
    return functools.cache(lambda effect, seed: _made(tmp_path_factory.mktemp(effect), effect, seed))


def _made(folder: Path, effect: str, seed: int) -> tuple[Path, list[Cause]]:
    from mirror_posture.cli.app import app

    made = CliRunner().invoke(
        app,
        f"blind make {folder} --cases 1 --seed {seed} --robot small --least 1 --most 1 --effect {effect} "
        "--frames 24 30 --workers 1".split(),
    )
    assert made.exit_code == 0, made.output
    answer = json.loads((folder / "answers" / "case-0000.json").read_text())
    causes = [
        Cause(
            cause["effect"],
            cause["at"],
            1.0,
            {
                name: Estimate(value, 0.0)
                for name, value in cause.items()
                if name.endswith(("_rad", "_m", "_error", "_per_nm"))
            },
        )
        for cause in answer["causes"]
    ]
    return folder / "case-0000", causes


def _diagnosis(causes: list[Cause]) -> Diagnosis:
    return Diagnosis("explained", "", tuple(causes), (), Gap(0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("effect", "seed"), [(effect, seed) for seed, effect in enumerate(SIMULATED, start=4)]
)
def test_the_true_cause_closes_the_gap_in_the_simulator(made: Made, effect: str, seed: int) -> None:
    from mirror_simulation.simulate import simulate

    session, causes = made(effect, seed)
    simulation = simulate(session, found=_diagnosis(causes))
    before, after = (stair.gap.rms_px for stair in simulation.stairs)
    assert before is not None and after is not None
    noise = mp.load_session(session).noise.pixel_std_px or 0.3
    # Both axes, and what the mirror's fit adds; the seeds are of sessions without outliers.
    assert after < 2.2 * noise, f"{effect}: {before:.3f} -> {after:.3f} px at a noise of {noise:.3f}"
    assert after < before


def test_a_body_that_is_shifted_is_off_by_its_shift_in_metres(made: Made) -> None:
    from mirror_simulation.simulate import simulated_gap
    from mirror_simulation.simulate.staircase import with_causes

    folder, causes = made("joint_offset", 11)
    session = mp.load_session(folder)
    changed, _, rest = with_causes(session, None, causes)
    before = simulated_gap(changed.session, rest)
    assert before.rms_m is not None and before.rms_m < 0.002
    # All bodies but camera and board: each marker is then 20 mm off, in the root's frame.
    shift_m = np.array([0.0, 0.012, 0.016])
    for marker in session.markers:
        rest.root_from_link[marker.link] = rest.root_from_link[marker.link].copy()
        rest.root_from_link[marker.link][:, :3, 3] += shift_m
    after = simulated_gap(changed.session, rest)
    assert after.measured == before.measured
    # A little less where one view only shows a marker, whose depth it does not tell.
    assert after.rms_m is not None and 0.85 * 0.02 < after.rms_m < 1.1 * 0.02, after.rms_m


def test_a_spring_closes_most_of_the_gap_of_a_spring_that_stiffens(made: Made) -> None:
    from mirror_simulation.simulate import simulate

    session, causes = made("joint_compliance", 3)
    before, after = (stair.gap.rms_px for stair in simulate(session, found=_diagnosis(causes)).stairs)
    assert before is not None and after is not None and after < 0.4 * before


def test_a_wrong_cause_does_not(made: Made) -> None:
    from mirror_simulation.simulate import simulate

    session, causes = made("joint_offset", 11)
    wrong = [
        Cause(c.effect, c.at, 1.0, {"offset_rad": Estimate(-c.parameters["offset_rad"].value, 0.0)})
        for c in causes
    ]
    simulation = simulate(session, found=_diagnosis(wrong))
    before, after = (stair.gap.rms_px for stair in simulation.stairs)
    assert before is not None and after is not None and after > 1.3 * before


def test_the_users_own_model_keeps_its_geoms_and_is_told_where_it_differs(made: Made, tmp_path: Path) -> None:
    from mirror_simulation.simulate import simulate

    session, causes = made("joint_compliance", 3)
    loaded = mp.load_session(session)
    spec = mujoco.MjSpec.from_file(str(loaded.robot_file))
    spec.compiler.fusestatic = False
    joint = causes[0].at.partition(":")[2]
    body = spec.joint(joint).parent
    body.add_geom(name="shell", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.01, 0, 0], mass=0.0)
    spec.compile()
    own = tmp_path / "own.xml"
    own.write_text(spec.to_xml())
    simulation = simulate(session, model=own, found=_diagnosis(causes))
    tree = ElementTree.fromstring(simulation.model_xml)
    assert tree.findall(".//geom[@name='shell']")
    assert f"joint_compliance at {causes[0].at}" in simulation.model_xml
    assert mujoco.MjModel.from_xml_string(simulation.model_xml).joint(f"{joint}_spring")
    assert not [note for note in simulation.notes if "different robots" in note]


def test_the_command_writes_the_staircase_and_names_a_missing_joint(made: Made, tmp_path: Path) -> None:
    from mirror_posture.cli.app import app

    session, _ = made("joint_offset", 11)
    done = CliRunner().invoke(app, ["simulate", str(session), "--out", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    tree = json.loads((tmp_path / "out" / "simulation.json").read_text())
    assert [step["added"] for step in tree["steps"]] == [None]
    assert np.isfinite(tree["steps"][0]["rms_px"])
    assert (tmp_path / "out" / "staircase.png").stat().st_size > 5000
    other = tmp_path / "other.xml"
    other.write_text(
        "<mujoco><worldbody><body name='b'><joint name='hinge'/><geom size='0.1'/></body></worldbody></mujoco>"
    )
    refused = CliRunner().invoke(app, ["simulate", str(session), "--model", str(other)])
    assert refused.exit_code == 1
    assert "has no joint" in refused.output and "hinge" in refused.output


def test_a_session_in_which_nothing_is_seen_is_refused_with_the_command_that_detects(tmp_path: Path) -> None:
    """Before: tables of dashes and exit code 0."""
    from session_folder import write_folder
    from small_arm import run

    pictures = write_folder(
        tmp_path / "pictures",
        detections=None,
        frames=WITH_PICTURES,
        points="frame,marker,x,y,z\n0,hand,0.1,0.2,0.3\n",
    )
    (pictures / "images").mkdir()
    (pictures / "images" / "0.png").write_bytes(b"")
    told = run("simulate", pictures, code=1).stderr
    assert "nothing is detected yet" in told and f"`mirror-posture detect {pictures}`" in told
    blank = write_folder(tmp_path / "blank", detections="frame,target,index,u,v\n")
    told = run("simulate", blank, code=3).stderr
    assert "no frame shows a marker together with the board" in told
    assert f"`mirror-posture check {blank}`" in told


def test_halves_that_are_too_small_to_diagnose_are_refused(made: Made) -> None:
    """Before: a gap of two postures, each of which told nothing of the other."""
    from dataclasses import replace

    from mirror_simulation.simulate.held_out import held_out_gap

    folder, _ = made("joint_offset", 11)
    session = mp.load_session(folder)
    kept = np.isin(session.frames.posture, np.unique(session.frames.posture)[:2])
    seen = session.mirror_view
    few = replace(
        session,
        mirror_view=replace(
            seen, board_seen=seen.board_seen & kept[:, None], marker_seen=seen.marker_seen & kept[:, None]
        ),
    )
    with pytest.raises(mp.MirrorPostureError, match="in one half of the session, too few to diagnose"):
        held_out_gap(few)


def test_optics_and_a_board_on_another_body_than_the_camera_can_be_held(made: Made) -> None:
    from mirror_simulation.simulate.causes import add_cause
    from mirror_simulation.simulate.changed import Changed
    from mirror_simulation.simulate.held_out import first_half
    from mirror_simulation.simulate.model import build, element_of

    folder, _ = made("joint_offset", 11)
    session = mp.load_session(folder)
    assert session.camera is not None and session.board is not None and session.camera_link is not None

    def added(effect: str, at: str, **values: float) -> Changed:
        changed = Changed(build(session), session, {})
        parameters = {name: Estimate(value, 0.0) for name, value in values.items()}
        assert add_cause(changed, Cause(effect, at, 1.0, parameters))
        return changed

    lens = added("camera_focal", "camera", scale_error=0.01).session.camera
    assert lens is not None and np.isclose(lens.fx_px, 1.01 * session.camera.fx_px)
    lens = added("camera_center", "camera", du_px=3.0, dv_px=-1.0).session.camera
    assert lens is not None and np.allclose(
        np.subtract(lens.center_px, session.camera.center_px), [3.0, -1.0]
    )
    lens = added("lens_distortion", "camera", dk1=0.01).session.camera
    assert lens is not None and np.isclose(lens.distortion[0], session.camera.distortion[0] + 0.01)
    # The board is on the chest, the camera on the head, which the neck turns: only the board moves.
    moved = added("board_mount", "board", dz_m=0.004).simulator.spec
    still = build(session).spec
    board, camera = session.board.link, session.camera_link
    shift = np.subtract(element_of(moved, board).pos, element_of(still, board).pos)
    assert np.isclose(np.linalg.norm(shift), 0.004)
    assert np.allclose(element_of(moved, camera).pos, element_of(still, camera).pos)
    # The two halves of the held-out gap keep postures whole.
    first = first_half(session)
    of_posture = {posture: set() for posture in session.frames.posture.tolist()}
    for posture, half in zip(session.frames.posture.tolist(), first.tolist(), strict=True):
        of_posture[posture].add(half)
    assert all(len(halves) == 1 for halves in of_posture.values()) and 0.3 < first.mean() < 0.7
