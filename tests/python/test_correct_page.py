"""docs/correcting.md: its Python runs as it stands, and its commands are ones that the program takes."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

from mirror_posture.cli import app

PAGE = Path(__file__).parents[2] / "docs" / "correcting.md"


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)


def test_the_python_of_the_page_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (block,) = blocks("python")
    exec(compile(block, str(PAGE), "exec"), {})
    assert "converged" in capsys.readouterr().out
    assert (tmp_path / "corrected" / "outcome.json").is_file()


def test_the_commands_of_the_page_are_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Twins are run without pictures; the others must fail for want of the robot, not of an option."""
    monkeypatch.chdir(tmp_path)
    lines = [line for block in blocks("sh") for line in block.replace("\\\n", " ").splitlines() if line]
    assert len(lines) == 4
    for line in lines:
        words = shlex.split(line)[1:]
        if "twin" in words:
            words.append("--no-pictures")
        ended = CliRunner().invoke(app, words)
        assert ended.exit_code == (0 if "twin" in words else 1), ended.output
        if "twin" not in words:
            assert "posture.toml" in ended.stderr
