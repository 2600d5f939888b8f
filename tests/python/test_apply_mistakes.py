"""Whole mistakes, written back: the model or the table has them undone; what no file can hold says what to do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mirror_posture as mp
from mirror_posture.diagnosis import Cause, Diagnosis, Estimate, Gap, formatting, vocabulary
from mirror_posture.diagnosis.applied import apply_diagnosis
from mirror_posture.diagnosis.applied.mistakes import BY_HAND_ONLY
from mirror_posture.diagnosis.applied.urdf import Urdf
from session_folder import URDF, write_folder


def found(effect: str, at: str, **values: float) -> Diagnosis:
    """A diagnosis with this cause."""
    cause = Cause(effect, at, 0.99, {name: Estimate(value, 0.0) for name, value in values.items()})
    return Diagnosis("explained", "", (cause,), (), Gap(1.0, 0.0, 0.0))


def test_an_axis_turned_round_moves_the_other_way(tmp_path: Path) -> None:
    session = mp.load_session(write_folder(tmp_path / "session"))
    joint = session.frames.joint_names[0]
    applied = apply_diagnosis(session, found("axis_sign", f"joint:{joint}"), tmp_path / "better")
    assert applied.written[0].file == "robot.urdf"
    before = Urdf((session.robot_file).read_text(encoding="utf-8")).axis(joint)
    after = Urdf((applied.folder / "robot.urdf").read_text(encoding="utf-8")).axis(joint)
    np.testing.assert_allclose(after, -before)


def test_columns_are_exchanged_and_scaled(tmp_path: Path) -> None:
    session = mp.load_session(write_folder(tmp_path / "session"))
    first, second = session.frames.joint_names[:2]
    swap = found("joints_swapped", f"joint:{first}<->joint:{second}")
    better = mp.load_session(apply_diagnosis(session, swap, tmp_path / "swapped").folder)
    np.testing.assert_array_equal(better.frames.commanded[:, :2], session.frames.commanded[:, [1, 0]])
    unit = found("joint_unit", f"joint:{first}", factor=0.5)
    better = mp.load_session(apply_diagnosis(session, unit, tmp_path / "scaled").folder)
    np.testing.assert_allclose(better.frames.commanded[:, 0], 0.5 * session.frames.commanded[:, 0])


def test_degrees_of_all_joints_leave_joints_that_slide_as_they_are(tmp_path: Path) -> None:
    sliding = URDF.replace('name="shoulder" type="revolute"', 'name="shoulder" type="prismatic"')
    session = mp.load_session(write_folder(tmp_path / "session", robot=sliding))
    unit = found("joint_unit", "robot", factor=0.5)
    better = mp.load_session(apply_diagnosis(session, unit, tmp_path / "scaled").folder)
    assert session.frames.joint_names == ("shoulder", "elbow")
    np.testing.assert_array_equal(better.frames.commanded[:, 0], session.frames.commanded[:, 0])
    np.testing.assert_allclose(better.frames.commanded[:, 1], 0.5 * session.frames.commanded[:, 1])


def test_a_camera_of_another_crop_and_size_gets_its_numbers(tmp_path: Path) -> None:
    session = mp.load_session(write_folder(tmp_path / "session"))
    crop = found("camera_resolution", "camera", factor=0.5, du_px=-3.0, dv_px=7.0)
    better = mp.load_session(apply_diagnosis(session, crop, tmp_path / "better").folder).camera
    was = session.camera
    assert was is not None and better is not None
    assert (better.fx_px, better.fy_px) == pytest.approx((0.5 * was.fx_px, 0.5 * was.fy_px))
    assert (better.cx_px, better.cy_px) == pytest.approx((0.5 * was.cx_px - 3.0, 0.5 * was.cy_px + 7.0))


@pytest.mark.parametrize("effect", BY_HAND_ONLY)
def test_what_no_file_holds_says_what_to_do(effect: str, tmp_path: Path) -> None:
    assert effect in vocabulary.MISTAKES
    session = mp.load_session(write_folder(tmp_path / "session"))
    applied = apply_diagnosis(session, found(effect, "camera"), tmp_path / "better")
    assert applied.written[0].file is None
    assert applied.written[0].what == formatting.BY_HAND[effect]


def test_places_of_two_are_told_plainly() -> None:
    assert formatting.place_in_words("joint:a<->joint:b") == "a and b"
    assert formatting.place_with_article("marker:m<-link:l") == "marker m on link l"


def with_encoders(folder: Path, factor: float, of: tuple[str, str] = ("shoulder", "elbow")) -> mp.Session:
    """A session whose encoders read `factor` times the commands of these joints, from a zero of their own."""
    rows = ["frame,posture,shoulder,elbow,measured:shoulder,measured:elbow"]
    for index in range(6):
        told = {"shoulder": -0.1 * index, "elbow": 0.3 * (-1) ** index}
        read = [factor * told[name] + 0.02 for name in of]
        rows.append(f"{index},{index},{told['shoulder']},{told['elbow']},{read[0]},{read[1]}")
    return mp.load_session(write_folder(folder, frames="\n".join(rows) + "\n"))


def test_encoders_that_agree_with_the_command_share_its_mistake(tmp_path: Path) -> None:
    """Before: they stayed, and the corrected session was refused where the units then differed."""
    session = with_encoders(tmp_path / "session", 1.0)
    unit = apply_diagnosis(
        session, found("joint_unit", "joint:elbow", factor=np.pi / 180), tmp_path / "scaled"
    )
    better = mp.load_session(unit.folder).frames
    np.testing.assert_allclose(better.measured, session.frames.measured * [1.0, np.pi / 180])
    assert unit.written[0].what.endswith(", and measured:elbow")
    swap = found("joints_swapped", "joint:shoulder<->joint:elbow")
    swapped = apply_diagnosis(session, swap, tmp_path / "swapped")
    better = mp.load_session(swapped.folder).frames
    read = {name: better.measured[:, index] for index, name in enumerate(better.measured_names)}
    np.testing.assert_array_equal(read["shoulder"], session.frames.measured[:, 1])
    np.testing.assert_array_equal(read["elbow"], session.frames.measured[:, 0])
    assert "and measured:shoulder, measured:elbow" in swapped.written[0].what


def test_encoders_that_read_otherwise_than_the_command_stay(tmp_path: Path) -> None:
    session = with_encoders(tmp_path / "unit", 0.1)
    unit = apply_diagnosis(session, found("joint_unit", "robot", factor=0.1), tmp_path / "scaled")
    np.testing.assert_array_equal(mp.load_session(unit.folder).frames.measured, session.frames.measured)
    session = with_encoders(tmp_path / "swapped", 1.0, ("elbow", "shoulder"))
    swap = found("joints_swapped", "joint:shoulder<->joint:elbow")
    better = mp.load_session(apply_diagnosis(session, swap, tmp_path / "better").folder).frames
    assert better.measured_names == session.frames.measured_names
    np.testing.assert_array_equal(better.measured, session.frames.measured)
