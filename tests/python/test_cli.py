"""The command line as a user meets it: help, exit codes, one-line errors, JSON."""

from __future__ import annotations

import importlib
import json
import pkgutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest
from typer.testing import CliRunner

import mirror_lab.commands
import mirror_simulation.commands
from mirror_posture import cli
from mirror_posture.cli import commands
from session_folder import DETECTIONS, replaced, write_folder

MODULES = [
    importlib.import_module(f"{package.__name__}.{found.name}")
    for package in (commands, mirror_lab.commands, mirror_simulation.commands)
    for found in pkgutil.iter_modules(package.__path__)
    if not found.name.startswith("_") and found.name != "robots"
]


def words_of(module: ModuleType) -> list[str]:
    """What a person types for each command of a module: its name, and for a group the names under it."""
    name = module.__name__.rpartition(".")[2].replace("_", "-")
    if not hasattr(module, "group"):
        return [name]
    return [
        f"{name} {command.name or command.callback.__name__}" for command in module.group.registered_commands
    ]


COMMANDS = [words for module in MODULES for words in words_of(module)]
RUNNER = CliRunner()


def run(*arguments: object, code: int = 0, env: dict[str, str] | None = None):
    result = RUNNER.invoke(cli.app, [str(argument) for argument in arguments], env=env)
    assert result.exit_code == code, f"{result.exit_code}: {result.output}\n{result.exception!r}"
    return result


def test_the_help_names_every_command() -> None:
    text = run("--help").output
    assert "Exit codes" in text
    for command in COMMANDS:
        assert command.split()[0] in text


@pytest.mark.parametrize(
    ("command", "extra"), [("simulate", "mujoco"), ("blind", "lab"), ("reproduce", "lab")]
)
def test_a_command_of_another_distribution_says_what_installs_it(
    command: str, extra: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from mirror_posture.cli import lazy_commands

    own = {name: lazy_commands._own_module(name) for name in lazy_commands._own_names()}
    monkeypatch.setattr(lazy_commands, "_all_modules", lambda: own)
    said = run(command, code=1).stderr
    assert f"pip install 'mirror-posture[{extra}]'" in said and len(said.splitlines()) == 1
    assert "No such command" in run("simulat", code=2).stderr


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_teaches(command: str) -> None:
    text = run(*command.split(), "--help", env={"COLUMNS": "200"}).output
    assert f"mirror-posture {command}" in text, "needed an example that can be copied"
    assert "--json" in text


def test_a_good_session_is_summarised(tmp_path: Path) -> None:
    text = run("check", write_folder(tmp_path)).output
    assert "hand, elbow_ball" in text
    document = json.loads(run("check", tmp_path, "--json").stdout)
    assert document["frames"] == 3 and document["markers_in_mirror"] == 2


def test_an_error_is_one_line_on_stderr(tmp_path: Path) -> None:
    folder = write_folder(tmp_path, detections=replaced(DETECTIONS, "12,13", "12,x"))
    result = run("check", folder, code=1)
    assert result.stdout == ""
    assert result.stderr.strip().count("\n") == 0
    assert "detections.csv, row 5 (line 6), column 'v'" in result.stderr


def test_an_error_is_a_document_where_json_was_asked_for(tmp_path: Path) -> None:
    folder = write_folder(tmp_path, detections=replaced(DETECTIONS, "12,13", "12,x"))
    error = json.loads(run("check", folder, "--json", code=1).stdout)["error"]
    assert error["file"] == "detections.csv" and error["row"] == 5 and error["column"] == "v"
    assert error["exit_code"] == 1


def test_brackets_in_a_message_are_shown(tmp_path: Path) -> None:
    assert "[mirror]" in run("check", tmp_path / "[mirror]", code=1).stderr


def test_wrong_calls_exit_with_2() -> None:
    run("no-such-command", code=2)
    run("check", "--no-such-option", code=2)


def test_debug_shows_the_traceback(tmp_path: Path) -> None:
    code = "import sys; from mirror_posture.cli import main; sys.argv[0] = 'mirror-posture'; main()"
    command = [sys.executable, "-c", code, "--debug", "check", str(tmp_path / "nowhere")]
    shown = subprocess.run(command, capture_output=True, text=True)
    assert "Traceback" in shown.stderr and "SessionError" in shown.stderr


def test_a_stop_from_the_keyboard_exits_with_130(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(folder: Path) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("mirror_posture.session.load_session", stop)
    # Nothing was written, and nothing is said to be kept.
    assert run("check", tmp_path, code=130).stderr.strip() == "error: stopped"
    assert "kept" not in run("--help").output


def test_a_stop_says_what_is_kept_where_something_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def write_and_stop(folder: Path, *_: object, **__: object) -> None:
        folder.mkdir(parents=True)
        (folder / "00.png").write_bytes(b"")
        raise KeyboardInterrupt

    monkeypatch.setattr("mirror_posture.render.render_session", write_and_stop)
    said = run("demo", "--out", tmp_path / "out", code=130).stderr
    assert f"the steps that were finished are kept in {tmp_path / 'out'}" in said

    class Closed:
        def close(self) -> None:
            pass

    monkeypatch.setattr("mirror_posture.capture.sources.open_source", lambda *_: Closed())
    monkeypatch.setattr(
        "mirror_posture.capture.board_pictures.take_board_pictures",
        lambda _source, _board, folder, *_: write_and_stop(folder),
    )
    words = (
        "--corners",
        "7x4",
        "--square-mm",
        "20",
        "--out",
        tmp_path / "camera.yaml",
        "--source",
        "webcam:0",
    )
    said = run("calibrate-camera", tmp_path / "pictures", *words, code=130).stderr
    assert f"the pictures are kept in {tmp_path / 'pictures'}" in said


def test_a_fault_of_the_program_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fault(folder: Path) -> None:
        raise ZeroDivisionError("two\nlines")

    monkeypatch.setattr("mirror_posture.session.load_session", fault)
    result = run("check", tmp_path, code=4)
    assert "ZeroDivisionError: two lines" in result.stderr and "--debug" in result.stderr


def test_a_command_starts_without_what_it_may_not_need() -> None:
    heavy = "{'numpy', 'cv2', 'pyarrow', 'matplotlib', 'mujoco'}"
    code = f"import sys, mirror_posture.cli; print(sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
