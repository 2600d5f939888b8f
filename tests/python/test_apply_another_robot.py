"""Files of another robot's are refused with what they lack, and nothing is written."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import mirror_posture as mp
from mirror_posture import MirrorPostureError
from mirror_posture.diagnosis import Diagnosis
from mirror_posture.diagnosis.applied import OwnFile, apply_diagnosis, write_own_files
from session_folder import write_folder
from small_arm import run
from test_apply_patch import MJCF, found
from test_apply_xacro import CONTROL

AT_ELBOW = ("joint_offset", "joint:elbow", {"offset_rad": 0.02})
AT_SHOULDER = ("joint_offset", "joint:shoulder", {"offset_rad": 0.02})
NOWHERE = ("camera_focal", "camera", {"scale_error": 0.01})
OTHERS = {"elbow": "knee", "shoulder": "hip", "wrist": "ankle", "hand": "foot", "neck": "waist"}


def lerobot(*motors: str) -> str:
    """A calibration file of LeRobot's with these motors."""
    one = {"id": 1, "drive_mode": 0, "homing_offset": 100, "range_min": 758, "range_max": 3292}
    return json.dumps(dict.fromkeys(motors, one), indent=4)


def another(text: str) -> str:
    """A file of another robot: other names of all joints."""
    for name, other in OTHERS.items():
        text = text.replace(f'"{name}"', f'"{other}"')
    return text


def files(folder: Path, option: str) -> tuple[Path, Path]:
    """The own file of the session's robot and the one of another, each what the option takes."""
    text = {"mjcf": MJCF, "lerobot": lerobot("shoulder", "elbow"), "ros2_control": CONTROL}[option]
    mine, others = folder / f"mine.{option}", folder / f"others.{option}"
    mine.write_text(text)
    others.write_text(another(text))
    return mine, others


def applied(session: mp.Session, diagnosis: Diagnosis, out: Path, option: str, own: Path) -> list[OwnFile]:
    """What `apply` writes into a copy of the file."""
    written: list[OwnFile] = []

    def also(part: Path) -> None:
        written.extend(write_own_files(session, diagnosis, part, **{option: own}))  # type: ignore[arg-type]

    apply_diagnosis(session, diagnosis, out, also=also)
    return written


@pytest.mark.parametrize("option", ["mjcf", "lerobot", "ros2_control"])
@pytest.mark.parametrize("cause", [AT_ELBOW, NOWHERE], ids=["elbow", "camera"])
def test_a_file_of_another_robot_is_refused(option: str, cause: tuple, tmp_path: Path) -> None:
    """Before: exit code 0, \"not written\" or nothing told, and a copy of the other robot's file."""
    if option == "mjcf":
        pytest.importorskip("mujoco")
    session = mp.load_session(write_folder(tmp_path / "session"))
    mine, others = files(tmp_path, option)
    what = "motor" if option == "lerobot" else "joint"
    lacks = f"{what} elbow" if cause is AT_ELBOW else f"{what} shoulder, {what} elbow"
    with pytest.raises(MirrorPostureError) as refused:
        applied(session, found(cause), tmp_path / "better", option, others)
    told = str(refused.value)
    assert told.startswith(f"{others}: has no {lacks}, of the session's robot; its {what}s: ")
    assert "hip, knee" in told and "is it another robot's? Give the file of this robot" in told
    assert "\n" not in told and not (tmp_path / "better").exists()
    [written] = applied(session, found(cause), tmp_path / "better", option, mine)
    assert len(written.told) == (cause is AT_ELBOW)


def test_a_controllers_file_may_be_of_a_part_and_a_model_is_of_the_whole_robot(tmp_path: Path) -> None:
    session = mp.load_session(write_folder(tmp_path / "session"))
    both = found(AT_ELBOW, AT_SHOULDER)
    part = tmp_path / "part.json"
    part.write_text(lerobot("elbow", "gripper"))
    [written] = applied(session, both, tmp_path / "motors", "lerobot", part)
    assert written.told[0].endswith("homing_offset of elbow: 100 to 87")
    assert "no motor 'shoulder'; the file has elbow, gripper" in written.told[1]
    pytest.importorskip("mujoco")
    model = tmp_path / "part.xml"
    model.write_text(MJCF.replace('"shoulder"', '"hip"'))
    with pytest.raises(MirrorPostureError, match="has no joint shoulder, of the session's robot"):
        applied(session, both, tmp_path / "model", "mjcf", model)


def test_names_that_are_expressions_of_xacro_are_told_with_what_to_do(tmp_path: Path) -> None:
    session = mp.load_session(write_folder(tmp_path / "session"))
    own = tmp_path / "control.xacro"
    own.write_text(CONTROL.replace('"elbow"', '"${prefix}elbow"'))
    [written] = applied(session, found(AT_ELBOW), tmp_path / "better", "ros2_control", own)
    assert "no joint 'elbow' in <ros2_control>" in written.told[0] and "must grow by" in written.told[0]


def test_a_model_of_the_other_kind_names_its_option(tmp_path: Path) -> None:
    """Before: a URDF as MJCF was copied, with exit code 0; an MJCF as URDF was one of a robot without joints."""
    session = mp.load_session(write_folder(tmp_path / "session"))
    pytest.importorskip("mujoco")
    with pytest.raises(
        MirrorPostureError, match=r"got <robot>, needed an MJCF .*; a URDF is given as --urdf"
    ):
        applied(session, found(AT_ELBOW), tmp_path / "a", "mjcf", session.robot_file)
    (mjcf := tmp_path / "mine.xml").write_text(MJCF)
    with pytest.raises(
        MirrorPostureError, match=r"got <mujoco>, needed a URDF .*; an MJCF is given as --mjcf"
    ):
        applied(session, found(AT_ELBOW), tmp_path / "b", "urdf", mjcf)


def test_the_session_that_is_corrected_is_not_replaced(tmp_path: Path) -> None:
    """Before, its own model, its plan and its overlays were gone."""
    session = mp.load_session(write_folder(tmp_path / "session"))
    before = session.robot_file.read_bytes()
    with pytest.raises(MirrorPostureError, match="is the session that is read, and would be replaced"):
        apply_diagnosis(session, found(AT_ELBOW), session.folder, overwrite=True)
    assert session.robot_file.read_bytes() == before
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("years")
    with pytest.raises(MirrorPostureError, match="holds files and is no session: --overwrite would delete"):
        apply_diagnosis(session, found(AT_ELBOW), tmp_path / "mine", overwrite=True)
    assert (tmp_path / "mine" / "thesis.tex").is_file()


@pytest.mark.parametrize(
    ("words", "told"),
    [(("--motors", "dynamixel"), "add --lerobot FILE"), (("--xacro-arg", "a=b"), "add --urdf FILE")],
)
def test_options_of_a_file_that_is_not_given(words: tuple[str, str], told: str, tmp_path: Path) -> None:
    """Before, they were taken without a word."""
    session = write_folder(tmp_path / "session")
    refused = run("apply", session, tmp_path / "diagnosis.json", "--out", tmp_path / "better", *words, code=1)
    assert told in " ".join(refused.stderr.split())
