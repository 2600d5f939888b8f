"""Moving sessions: options that contradict each other, another set in the same folder, results of other sessions."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from mirror_posture.cli.app import app

pytest.importorskip("mujoco")
pytest.importorskip("pinocchio")
pytest.importorskip("mirror_lab")

from mirror_lab.blind.seal import seal
from mirror_lab.moving import make


def run(line: str, code: int) -> str:
    done = CliRunner().invoke(app, line.split())
    if "this command is not installed" in done.output:
        pytest.skip("joins with the installed mirror-posture-lab")
    assert done.exit_code == code, done.output
    return " ".join(done.output.split())


def _quickly(folder: Path, kind: str, effects: list[str], rng: Any, seconds: float, sealed_in: Path) -> None:
    """A session without data, in place of half a minute of motion."""
    folder.mkdir(parents=True, exist_ok=True)
    seal({"id": folder.name, "causes": []}, sealed_in / f"{folder.name}.json", folder / "seal.json")


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(make, "make_case", _quickly)


def test_numbers_of_causes_that_cannot_be_are_refused(tmp_path: Path, quick: None) -> None:
    told = run(f"moving make {tmp_path / 'm'} --cases 1 --least 3 --most 2", 1)
    assert "needed a least number up to the largest" in told
    told = run(f"moving make {tmp_path / 'm'} --cases 1 --least 2 --most 2 --effect latency", 1)
    assert "needed at most 1, since a session has each effect once" in told
    assert not (tmp_path / "m").exists()


def test_another_set_is_refused_and_a_stopped_one_is_finished(tmp_path: Path, quick: None) -> None:
    folder = tmp_path / "m"
    run(f"moving make {folder} --cases 1 --seed 1", 0)
    sealed = (folder / "case-0000" / "seal.json").read_bytes()
    run(f"moving make {folder} --cases 2 --seed 1", 0)
    assert (folder / "case-0000" / "seal.json").read_bytes() == sealed, "what is made is not made again"
    assert (folder / "case-0001" / "seal.json").is_file()
    assert "seed 1, got 2; use another folder" in run(f"moving make {folder} --cases 2 --seed 2", 1)
    assert "use another folder" in run(f"moving make {folder} --cases 2 --seed 1 --effect latency", 1)


def test_results_of_other_sessions_are_refused(tmp_path: Path, quick: None) -> None:
    folder = tmp_path / "m"
    run(f"moving make {folder} --cases 1 --seed 1", 0)
    result = folder / "results" / "case-0000" / "diagnosis.json"
    # It has no data: it fails, and its seal is stored.
    run(f"moving run {folder}", 0)
    assert not result.exists()
    result.parent.mkdir(parents=True)
    gap = {"noise_floor_m": 0.001, "checked": []}
    result.write_text(json.dumps({"verdict": "none", "causes": [], "gap": gap}))
    run(f"moving score {folder}", 0)
    _quickly(folder / "case-0000", "", [], None, 0.0, folder / "answers")
    for command in ("run", "score"):
        told = run(f"moving {command} {folder}", 1)
        assert "is the result of another session" in told and "use another folder" in told
