"""What a recording has and the robot has no use for: columns that are no joints, a camera that was never calibrated."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from init_once import initialised
from mirror_posture import load_session
from test_import import HEIGHT, POSTURES, URDF, WIDTH, run, write_mcap, write_pictures


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "arm.urdf").write_text(URDF)
    words = ["--camera", "base", "--camera-at", "0,0,0.3", "--board", "base", "--board-at", "0,0,0.1"]
    words += ["--marker", "hand=m@0.1,0,0", "--picture", f"{WIDTH}x{HEIGHT}"]
    return initialised(tmp_path / "arm.urdf", tmp_path / "session", *words)


def test_a_camera_that_is_not_calibrated_is_none(folder: Path, tmp_path: Path) -> None:
    """Before, K of zeros, as drivers publish it, ended the import though the session has its camera file."""
    before = (folder / "camera.yaml").read_bytes()
    words = write_mcap(tmp_path, [0.0] * 9, "")
    document = json.loads(run("import", words[0], folder, *words[1:], "--json").stdout)
    assert f"{words[0]}, topic /cam/camera_info: the camera is not calibrated" in document["warnings"][0]
    assert document["frames"] == len(POSTURES) and (folder / "camera.yaml").read_bytes() == before
    wrong = write_mcap(tmp_path, [300.0, 0.0, 160.0, 0.0, -1.0, 120.0, 0.0, 0.0, 1.0])
    told = " ".join(run("import", wrong[0], folder, *wrong[1:], "--overwrite", code=1).stderr.split())
    assert "topic /cam/camera_info: camera_matrix: got focal lengths" in told


def test_columns_that_are_left_out_decide_nothing(folder: Path, tmp_path: Path) -> None:
    """Before: a counter or a voltage never rests, and neither did the log."""
    words = write_pictures(tmp_path)
    plain = json.loads(run("import", words[0], folder, *words[1:], "--json").stdout)
    log = Path(words[2])
    head, *rows = log.read_text().splitlines()
    log.write_text(
        "\n".join(
            [
                f"seq,{head},battery_v",
                *(f"{n},{row},{12.5 + 0.1 * np.sin(3 * n)}" for n, row in enumerate(rows)),
            ]
        )
    )
    told = json.loads(run("import", words[0], folder, *words[1:], "--overwrite", "--json").stdout)
    assert "left out: seq, battery_v" in told["warnings"][0]
    assert told["frames"] == len(POSTURES) and told["offset_s"] == plain["offset_s"]
    assert load_session(folder).frames.joint_names == ("a", "b")
    np.testing.assert_allclose(load_session(folder).frames.commanded, POSTURES, atol=1e-6)
