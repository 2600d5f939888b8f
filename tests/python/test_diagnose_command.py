"""`mirror-posture diagnose` and `apply` as anybody would call them: files, page, witness, exit codes."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from mirror_posture.cli import app
from session_folder import DATA

SESSION = DATA / "sessions" / "dev-016"
needs_data = pytest.mark.skipif(not SESSION.is_dir(), reason=f"{SESSION} is not there")


def run(*words: object) -> tuple[int, str]:
    ended = CliRunner().invoke(app, [str(word) for word in words])
    return ended.exit_code, ended.output


@needs_data
def test_diagnose_writes_json_and_a_page_that_needs_no_network(tmp_path: Path) -> None:
    code, said = run("diagnose", SESSION, "--out", tmp_path / "out", "--withhold", "marker:r_hand")
    assert code == 0, said
    assert "r_upper_arm_yaw" in said and "°" in said
    tree = json.loads((tmp_path / "out" / "diagnosis.json").read_text(encoding="utf-8"))
    assert tree["verdict"] == "explained"
    (witness,) = tree["witness"]
    assert witness["marker"] == "r_hand" and witness["after_m"] < 0.5 * witness["before_m"]
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "r_upper_arm_yaw" in page and page.count("<svg") >= 3
    # Addresses that are names of XML vocabularies load nothing.
    loaded = re.findall(r'(?:src|href)="(?!#)([^"]+)"|url\((?!#)([^)]+)\)|@import', page)
    assert not [entry for entry in loaded if "http" in "".join(entry)]
    ids = re.findall(r' id="([^"]+)"', page)
    assert len(ids) == len(set(ids)), "two drawings share an id: one would borrow the other's shapes"
    assert {file.name for file in (tmp_path / "out" / "pictures").iterdir()} >= {"gap.png", "robot.png"}


@needs_data
def test_apply_takes_what_diagnose_wrote(tmp_path: Path) -> None:
    assert run("diagnose", SESSION, "--out", tmp_path / "out")[0] == 0
    code, said = run("apply", SESSION, tmp_path / "out", "--out", tmp_path / "better", "--json")
    assert code == 0, said
    assert json.loads(said[said.index("{") :])["written"][0]["file"] == "robot.urdf"
    code, said = run("apply", SESSION, tmp_path / "out", "--out", tmp_path / "better")
    assert code == 1 and "better" in said


@needs_data
@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["--without", "gremlins"], "gremlins"),
        (["--without", "stition"], "needed one of stiction, "),
        (["--withhold", "marker:foot"], "marker:r_hand"),
        (["--withhold", "l_hnd"], "needed one of marker:l_hand, "),
    ],
)
def test_what_cannot_be_meant_is_one_line_with_the_valid_names(words: list[str], named: str) -> None:
    code, said = run("diagnose", SESSION, *words)
    assert code == 1 and named in said


@needs_data
def test_of_several_sessions_the_one_with_an_error_is_told(tmp_path: Path) -> None:
    folder = tmp_path / "broken"
    shutil.copytree(SESSION, folder)
    (folder / "frames.csv").write_text("frame\n0,1\n", encoding="utf-8")
    code, said = run("diagnose", folder, SESSION)
    assert code == 1 and str(folder) in said.replace("\n", "") and "frames.csv" in said, said


@needs_data
def test_sessions_of_one_name_are_refused_before_one_replaces_the_other(tmp_path: Path) -> None:
    for part in ("a", "b"):
        shutil.copytree(SESSION, tmp_path / part / "run")
    out = tmp_path / "out"
    code, said = run("diagnose", tmp_path / "a" / "run", tmp_path / "b" / "run", "--out", out)
    told = said.replace("\n", "")
    assert code == 1 and not out.exists(), said
    assert f"would both be in {out / 'run'}" in told and "rename one" in told, said
