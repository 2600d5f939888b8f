"""The judges' commands from end to end, small: `blind make|run|score`, `moving make|run|score`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from mirror_posture.cli.app import app

pytest.importorskip("mirror_lab")


def run(line: str, code: int = 0) -> str:
    done = CliRunner().invoke(app, line.split())
    if "this command is not installed" in done.output:
        pytest.skip("joins with the installed mirror-posture-lab")
    assert done.exit_code == code, done.output
    return done.output


def test_what_the_judge_cannot_judge_is_not_made(tmp_path: Path) -> None:
    assert "pairing" in run(f"blind make {tmp_path / 'set'} --setup by-hand --effect pairing", code=1)
    assert not (tmp_path / "set").exists()


def test_one_blind_case_is_made_and_scored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    small = "--cases 1 --robot small --least 1 --most 1 --effect gear_ratio --frames 24 30 --workers 1"
    run(f"blind make blind-set --seed 3 {small}")
    assert (tmp_path / "blind-set" / "case-0000" / "seal.json").is_file()
    (cause,) = json.loads((tmp_path / "blind-set" / "answers" / "case-0000.json").read_text())["causes"]
    value = {"scale_error": {"value": cause["scale_error"], "std": 1e-4}}
    named = {
        "effect": cause["effect"],
        "at": cause["at"],
        "probability": 0.99,
        "parameters": value,
        "alternatives": [],
    }
    gap = {"closed": 0.99, "closed_ci95": [0.97, 1.0]}
    result = tmp_path / "blind-results" / "case-0000" / "diagnosis.json"
    result.parent.mkdir(parents=True)
    told = {
        "format": "mirror-posture/diagnosis",
        "version": 1,
        "verdict": "explained",
        "causes": [named],
        "where": [],
        "gap": gap,
    }
    result.write_text(json.dumps(told))
    # What is diagnosed already is not diagnosed again.
    run("blind run blind-set blind-results --workers 1")
    assert json.loads(result.read_text()) == told
    text = run("blind score blind-set blind-results --out blind-score")
    assert "1 session;" in text and (tmp_path / "blind-score" / "score.html").is_file()


def test_one_motion_is_made_and_scored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("mujoco")
    pytest.importorskip("pinocchio")
    monkeypatch.chdir(tmp_path)
    run("moving make moving --cases 1 --robot small --seconds 4 --seed 1 --most 0")
    case = tmp_path / "moving" / "case-0000"
    assert (case / "model.xml").is_file() and (tmp_path / "moving" / "case-0000-unseen").is_dir()
    out = tmp_path / "moving" / "results" / "case-0000"
    out.mkdir(parents=True)
    gap = {
        "noise_floor_m": 0.001,
        "checked": [{"session": "case-0000-unseen", "before_m": 0.001, "after_m": 0.001}],
    }
    (out / "diagnosis.json").write_text(json.dumps({"verdict": "none", "causes": [], "gap": gap}))
    # What is diagnosed already is not diagnosed again.
    run("moving run moving")
    assert "case-0000" in run("moving score moving")
