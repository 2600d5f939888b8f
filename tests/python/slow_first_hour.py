"""The stranger's hour, small (16 s of a processor; run by hand, `pytest tests/python/slow_first_hour.py`): an arm of boxes, fourteen postures, from init to diagnose."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from mirror_posture import cli
from small_arm import MOUNTS, URDF

pytest.importorskip("mujoco")

from mirror_posture.shapes.mujoco_picture import opengl_is_there


@pytest.mark.skipif(not opengl_is_there(), reason="no OpenGL here: set MUJOCO_GL to egl or osmesa")
def test_from_a_urdf_to_its_diagnosis(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from strangers_hour import Body, hour

    def here(folder: Path, words: tuple[str, ...]) -> tuple[int, str, str]:
        monkeypatch.chdir(folder)
        done = CliRunner().invoke(cli.app, list(words))
        return done.exit_code, done.stdout, done.stderr

    monkeypatch.setattr("mirror_posture.plan.run.DRAWN", 3000)
    words = [*MOUNTS[: MOUNTS.index("--picture")], "--picture", "640x480", "--focal-px", "520"]
    body = Body(
        "",
        words,
        ["--postures", "14", "--views", "2", "--mirror-size", "50x50"],
        {"lift": 0.05},
        {"elbow": 0.05},
    )
    urdf = tmp_path / "small_arm.urdf"
    urdf.write_text(URDF)
    document, told = hour(tmp_path / "hour", body, "folder", urdf, {}, here, short=True)
    assert told.count == 4
    found = {(cause["effect"], cause["at"]): cause for cause in document["causes"]}
    assert body.truth() <= set(found), sorted(found)
    lift = found["joint_offset", "joint:lift"]["parameters"]["offset_rad"]
    elbow = found["gear_ratio", "joint:elbow"]["parameters"]["scale_error"]
    assert lift["value"] == pytest.approx(0.05, abs=max(4 * lift["std"], 0.004))
    assert elbow["value"] == pytest.approx(0.05, abs=max(4 * elbow["std"], 0.003))
