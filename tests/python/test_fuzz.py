"""Every border that Python reads, on its corpus and on some mutations: a value or one clear line. `fuzz.py` runs many."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from fuzz import fuzz
from fuzz_targets import CORPUS, TARGETS
from mirror_posture import MirrorPostureError, Robot
from mirror_posture.cli.commands._robots import read_posture
from mirror_posture.cli.commands.measure import _read_mount
from mirror_posture.detect import read_picture
from mirror_posture.diagnosis.result import Diagnosis
from mirror_posture.output_files import MIXED
from mirror_posture.robots import Nominal
from mirror_posture.robots.servo_config import load_config
from mirror_posture.session import load_camera_info
from session_folder import SESSION, replaced, write_folder

RUNS = 120


@pytest.mark.parametrize("name", TARGETS)
def test_mutated_inputs(name: str) -> None:
    # Of bags each takes a fiftieth of a second: types are parsed, databases opened.
    runs = RUNS // 4 if name.startswith("rosbag") else RUNS
    ends = fuzz(name, runs, seed=5)
    # A run in which nothing gets through, or nothing is refused, tests nothing.
    assert ends["taken"] >= 3 and ends["refused"] > runs / 4, ends


NAMED_FILES = {
    "servos.toml": lambda file: load_config(file, Nominal.load()),
    "target.toml": read_posture,
    "mount.json": _read_mount,
    "camera.yaml": load_camera_info,
    "robot.urdf": Robot.from_urdf,
    "picture.png": read_picture,
    "diagnosis.json": Diagnosis.load,
}


@pytest.mark.parametrize("name", NAMED_FILES)
def test_files_that_somebody_names_are_regular_and_bounded(name: str, tmp_path: Path) -> None:
    file = tmp_path / name
    os.mkfifo(file)
    with pytest.raises(MirrorPostureError, match="no regular file"):
        NAMED_FILES[name](file)
    file.unlink()
    with file.open("wb") as stream:
        stream.truncate(2_000_000_000)
    with pytest.raises(MirrorPostureError, match="needed at most"):
        NAMED_FILES[name](file)
    file.unlink()
    with pytest.raises(MirrorPostureError, match=r"no such file|missing"):
        NAMED_FILES[name](file)


def test_a_mesh_beyond_all_bounds_is_none(tmp_path: Path) -> None:
    from mirror_posture.shapes.triangles import read_triangles

    with (tmp_path / "a.stl").open("wb") as stream:
        stream.truncate(2_000_000_000)
    assert read_triangles(tmp_path / "a.stl") is None


@pytest.mark.parametrize("key", ["robot", "camera"])
def test_no_command_follows_a_session_out_of_its_folder(key: str, tmp_path: Path) -> None:
    name = {"robot": "robot.urdf", "camera": "camera.yaml"}[key]
    folder = write_folder(
        tmp_path / "session", session=replaced(SESSION, f'{key} = "{name}"', f'{key} = "../{name}"')
    )
    (folder / name).rename(tmp_path / name)
    with pytest.raises(MirrorPostureError, match="needed a path inside the session's folder"):
        Nominal.load(folder)
    folder = write_folder(tmp_path / "linked")
    (folder / name).unlink()
    (folder / name).symlink_to(tmp_path / name)
    with pytest.raises(MirrorPostureError, match="that no link leads out of"):
        Nominal.load(folder)


def test_hostile_diagnoses(tmp_path: Path) -> None:
    file = tmp_path / "diagnosis.json"
    file.write_text("[" * 100_000)
    with pytest.raises(MirrorPostureError, match="cannot be read as JSON"):
        Diagnosis.load(file)
    file.write_bytes((CORPUS / "diagnosis_json" / "explained.json").read_bytes())
    assert Diagnosis.load(tmp_path).verdict == "explained"
    (tmp_path / MIXED).touch()
    with pytest.raises(MirrorPostureError, match="was cut off"):
        Diagnosis.load(tmp_path)
