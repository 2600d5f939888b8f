"""The measuring commands from end to end, each as a person or a program calls it, bad input included."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow.csv
import pyarrow.parquet
import pytest
from typer.testing import CliRunner

from document_commands import python_of
from mirror_posture import cli, load_session, render
from mirror_posture.session import write_session
from session_folder import DATA, write_folder

RUNNER = CliRunner()


def run(*arguments: object, code: int = 0):
    result = RUNNER.invoke(cli.app, [str(argument) for argument in arguments])
    assert result.exit_code == code, f"{result.exit_code}: {result.output}\n{result.exception!r}"
    return result


@pytest.fixture(scope="module", autouse=True)
def fewer_rays() -> Iterator[None]:
    """Fewer rays: what the commands say and write is asked for here, and pictures in full, with their ghosts, are drawn by other tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            render, "PictureOptions", partial(render.PictureOptions, samples=1, edge_samples=2, ghosts=False)
        )
        yield


@pytest.fixture(scope="module")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("rendered") / "session"
    text = run(
        "render", folder, "--postures", 1, "--yaw", 0, "--yaw", 12, "--offset", "r_shoulder_roll=2.5"
    ).output
    assert "2 pictures" in text and f"mirror-posture detect {folder}" in text
    return folder


@pytest.fixture(scope="module")
def detected(rendered: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("detected") / "session"
    document = json.loads(run("detect", rendered, "--out", folder, "--json").stdout)
    assert document["boards"] == 2 and document["balls"] >= 6
    return folder


def test_the_python_of_readme_measures(rendered: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(rendered.parent)
    (block,) = python_of("README.md")
    names: dict[str, Any] = {}
    exec(block.replace("my-session", rendered.name), names)
    markers = names["found"].markers
    assert (
        markers.point_in_root_m.shape
        == markers.model_in_root_m.shape
        == (len(markers.covariance_in_root_m2), 3)
    )
    assert np.linalg.norm(markers.point_in_root_m - markers.model_in_root_m, axis=1).max() > 2e-3


def test_rendering_keeps_what_is_there(rendered: Path) -> None:
    assert "is there already" in run("render", rendered, code=1).stderr
    assert "JOINT=DEGREES" in run("render", rendered / "x", "--offset", "r_elbow", code=1).stderr
    assert "nose" in run("render", rendered / "x", "--offset", "nose=3", code=1).stderr
    assert not (rendered / "x").exists()


def test_detection_writes_a_table_a_report_and_overlays(detected: Path) -> None:
    session = load_session(detected)
    assert session.detected and session.mirror_view.board_seen.all()
    assert session.mirror_view.marker_std_px is not None and session.warnings == ()
    report = json.loads((detected / "detections.json").read_text())
    assert report["0"]["boards"][0]["residual_rms_px"] < 0.2
    overlay = cv2.imread(str(detected / "overlays" / "0000.png"))
    assert overlay is not None and overlay.std() > 10
    assert "--overwrite" in run("detect", detected, code=1).stderr


def test_a_stop_keeps_the_pictures_that_were_done(
    rendered: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from mirror_posture.detect import into_session

    monkeypatch.setattr(into_session, "CHUNK", 1)
    whole, calls = into_session.detect_pictures, []

    def stop_at_the_second(*arguments, **options):
        if calls:
            raise KeyboardInterrupt
        calls.append(1)
        return whole(*arguments, **options)

    monkeypatch.setattr(into_session, "detect_pictures", stop_at_the_second)
    result = run("detect", rendered, "--out", tmp_path / "new", code=130)
    partial = tmp_path / "new.partial.csv"
    assert "1 picture was done" in result.stderr and str(partial) in result.stderr
    assert set(pyarrow.csv.read_csv(partial)["frame"].to_pylist()) == {0}
    assert not (tmp_path / "new").exists()


def test_measuring_writes_what_it_was_asked_for(detected: Path, tmp_path: Path) -> None:
    files = {ending: tmp_path / f"markers.{ending}" for ending in ("csv", "parquet", "json")}
    for file in files.values():
        run("measure", detected, "--out", file)
    table = pyarrow.csv.read_csv(files["csv"])
    same = pyarrow.parquet.read_table(files["parquet"])
    assert table.column_names == same.column_names
    np.testing.assert_array_equal(table["x_m"].to_numpy(), same["x_m"].to_numpy())
    document = json.loads(files["json"].read_text())
    assert document["estimator"] == "maximum-likelihood" and len(document["markers"]) == len(table)
    hand = table.filter(pyarrow.compute.equal(table["marker"], "r_hand"))
    # The hidden 2.5° of the shoulder, at some 100 mm from it.
    assert 0.003 < hand["distance_m"][0].as_py() < 0.006
    assert hand["std_x_m"][0].as_py() < 0.001

    text = run("measure", detected, "--plot", tmp_path / "plot.png", "--overlays", tmp_path / "drawn").output
    assert "r_hand" in text and "By marker, mm" in text
    assert cv2.imread(str(tmp_path / "plot.png")) is not None
    assert sorted(file.name for file in (tmp_path / "drawn").iterdir()) == ["0000.png", "0001.png"]


def test_all_estimators_are_compared(detected: Path) -> None:
    document = json.loads(run("measure", detected, "--estimator", "all", "--json").stdout)
    assert list(document["estimators"]) == [
        "pose",
        "pose-snapped",
        "point-pair",
        "maximum-likelihood",
        "joint",
    ]


def test_pictures_without_detections_are_detected_first(rendered: Path) -> None:
    result = run("measure", rendered)
    assert "looking for the board" in result.stdout and "r_hand" in result.stdout
    assert not (rendered / "detections.csv").exists()


def test_wrong_options_of_measure_are_named(detected: Path, tmp_path: Path) -> None:
    assert "point-pair" in run("measure", detected, "--estimator", "eq2", code=1).stderr
    assert ".parquet" in run("measure", detected, "--out", tmp_path / "m.xls", code=1).stderr
    (tmp_path / "mount.json").write_text("{}")
    assert "is no calibration" in run("measure", detected, "--mount", tmp_path / "mount.json", code=1).stderr
    assert "no such file" in run("measure", detected, "--mount", tmp_path / "none.json", code=1).stderr


def test_nothing_to_measure_exits_with_3(tmp_path: Path) -> None:
    folder = write_folder(tmp_path, detections="frame,target,index,u,v\n")
    assert "no frame shows the board" in run("measure", folder, code=3).stderr


def test_detections_go_into_the_sessions_own_folder_however_it_is_named(
    rendered: Path, tmp_path: Path
) -> None:
    """Before, `--out` with the session's own name and `--overwrite` replaced the whole folder, notes and plans with it."""
    write_session(load_session(rendered), tmp_path / "own")
    (tmp_path / "own" / "plan").mkdir()
    run("detect", tmp_path / "own", "--out", tmp_path / "own", "--no-overlays")
    assert (tmp_path / "own" / "plan").is_dir() and (tmp_path / "own" / "detections.csv").is_file()


def test_bad_pictures_are_refused_or_masked(rendered: Path, tmp_path: Path) -> None:
    write_session(load_session(rendered), tmp_path / "one")
    good = cv2.imread(str(rendered / "images" / "000.png"))
    (tmp_path / "one" / "images" / "001.png").write_bytes(b"\x89PNG\r\n\x1a\nbroken")
    cv2.imwrite(str(tmp_path / "one" / "images" / "000.png"), np.full_like(good, 90))
    document = json.loads(run("detect", tmp_path / "one", "--json", code=3).stdout)
    reasons = {(entry["frame"], entry["what"]): entry["reason"] for entry in document["refused"]}
    assert "001.png" in reasons[(1, "picture")] and (0, "board") in reasons

    write_session(load_session(rendered), tmp_path / "small")
    for name in ("000.png", "001.png"):
        cv2.imwrite(str(tmp_path / "small" / "images" / name), cv2.resize(good, (400, 300)))
    said = run("detect", tmp_path / "small", "--json", code=1).stderr
    assert said.count("400 × 300") == 1 and said.count("800 × 600") == 1

    (tmp_path / "small" / "images" / "000.png").unlink()
    assert "images/000.png is missing" in run("detect", tmp_path / "small", code=1).stderr


def test_too_few_views_are_no_calibration(detected: Path) -> None:
    assert "view" in run("calibrate", detected, code=1).stderr


@pytest.mark.skipif(not (DATA / "sessions").is_dir(), reason=f"the data is not there: {DATA}")
def test_calibration_finds_a_camera_that_sits_elsewhere(tmp_path: Path) -> None:
    folder = DATA / "sessions" / "dev-017"
    cause = json.loads((folder / "answer.json").read_text())["causes"][0]
    document = json.loads(run("calibrate", folder, "--out", tmp_path / "mount.json", "--json").stdout)
    assert document["turn_rad"] == pytest.approx(
        math.hypot(*(cause[f"r{axis}_rad"] for axis in "xyz")), abs=1e-3
    )
    before = json.loads(run("measure", folder, "--json").stdout)["summary"]
    after = json.loads(run("measure", folder, "--mount", tmp_path / "mount.json", "--json").stdout)["summary"]
    assert after[0]["distance_rms_m"] < 0.6 * before[0]["distance_rms_m"]


def test_the_demonstration_names_what_it_made(tmp_path: Path) -> None:
    document = json.loads(run("demo", "--out", tmp_path / "out", "--postures", 1, "--json").stdout)
    assert document["marker_error_rms_m"]["maximum-likelihood"] < 0.0005
    assert document["model_gap_rms_m"] > 0.001
    # One posture is too little for a cause; the correction needs no more.
    assert document["diagnosis"]["verdict"] in ("insufficient", "partial", "explained")
    looks = document["correction"]["distance_m"]
    assert document["correction"]["stop"] == "converged"
    assert max(looks[0].values()) > 0.002 > 0.001 > max(looks[-1].values())
    for path in document["made"].values():
        assert Path(path).exists(), path
