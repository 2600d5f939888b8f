"""What a person gives by mistake: files for folders, other endings, other units; refused in one line with the fix."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from session_folder import write_folder
from small_arm import run, setup

MIRROR = ("--camera", "camera.yaml", "--board", "7x4")


def in_one_line(*arguments: object, code: int = 1) -> str:
    """What a refused command says, without the breaks of lines."""
    return " ".join(run(*arguments, code=code).stderr.split())


@pytest.mark.parametrize(
    "words",
    [("check",), ("plan",), ("capture",), ("measure",), ("render", "drawn", "--template"), ("correct", "twin", "--out", "o", "--session")],
    ids=lambda words: words[0],
)  # fmt: skip
def test_a_file_where_a_session_is_needed(words: tuple[str, ...], tmp_path: Path) -> None:
    """Before, three of them: "session.toml: cannot be read (Not a directory); needed a text file in UTF-8"."""
    (file := tmp_path / "file").write_text("no session")
    joint = ("--joint", "r_elbow=3") if words[0] == "correct" else ()
    told = in_one_line(*words, file, *joint)
    assert f"{file}: is no folder; a session is one folder with a session.toml in it" in told


@pytest.mark.parametrize(
    ("option", "name", "needed"),
    [
        ("--plot", "plot.txt", ".png or .svg or .pdf"),
        ("--out", "table.xls", ".csv or .parquet or .json"),
        ("--page", "page.txt", ".html"),
    ],
)
def test_other_endings_are_refused_before_anything_is_measured(
    option: str, name: str, needed: str, tmp_path: Path
) -> None:
    """Before, a plot's was a fault of the program, after all was measured; a page was written as any file."""
    told = in_one_line("measure", write_folder(tmp_path / "session"), option, tmp_path / name)
    assert f"{option}: got '{tmp_path / name}', needed a file that ends with {needed}" in told
    assert not (tmp_path / name).exists()


def test_pages_and_sheets_have_their_endings(tmp_path: Path) -> None:
    session = write_folder(tmp_path / "session")
    assert "ends with .html" in in_one_line("check", session, "--page", tmp_path / "page.txt")
    assert "ends with .pdf" in in_one_line("board", tmp_path / "board.txt")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["session"]


def test_a_file_that_is_no_robot_is_told_before_anything_is_asked(tmp_path: Path) -> None:
    """Before, links and places were asked for first."""
    (file := tmp_path / "frames.csv").write_text("frame,posture\n0,0\n")
    told = run("init", file, tmp_path / "s", code=1, input="")
    assert "needed a URDF or xacro (<robot>) or an MJCF (<mujoco>)" in " ".join(told.stderr.split())
    assert "Link that carries" not in told.output + told.stderr


def test_a_table_that_is_no_number_is_no_fault_of_the_program(tmp_path: Path) -> None:
    """Before, exit code 4, after the whole plan was made."""
    told = in_one_line("plan", setup(tmp_path), "--table", "nan")
    assert "table_m: got nan, needed a finite height in the root's frame, m" in told


@pytest.mark.parametrize("words", [("--yaw", "100"), ("--distance", "0"), ("--distance", "nan")])
def test_mirrors_that_show_nothing_are_not_drawn(words: tuple[str, str], tmp_path: Path) -> None:
    """Before, a mirror that looks away was drawn, with exit code 0."""
    assert f"'{words[0]}'" in in_one_line("render", tmp_path / "drawn", *words, code=2)


def test_lengths_of_the_command_mirror_are_in_m(tmp_path: Path) -> None:
    assert "--square: got 14 m, needed 0 to below 0.5 m: is it in mm?" in in_one_line(
        "mirror", "a.png", *MIRROR, "--square", 14
    )
    assert "--glass: got 3 m, needed 0 to below 0.05 m: is it in mm?" in in_one_line(
        "mirror", "a.png", *MIRROR, "--square", 0.014, "--glass", 3
    )


def test_a_mirror_of_no_picture_says_what_a_picture_must_show(tmp_path: Path) -> None:
    """Before, an empty table; a folder was "no regular file"."""
    session = write_folder(tmp_path / "session")
    words = ("--camera", session / "camera.yaml", "--board", "7x4", "--square", 0.014)
    told = in_one_line("mirror", tmp_path / "missing.png", *words, code=3)
    assert "a picture must show the whole board twice, directly and in the mirror" in told
    (folder := tmp_path / "empty").mkdir()
    assert f"{folder}: holds no pictures" in in_one_line("mirror", folder, *words)


def test_a_model_that_is_not_there(tmp_path: Path) -> None:
    """Before: "MuJoCo cannot load it: [Errno None] is no regular file"."""
    pytest.importorskip("mujoco")
    told = in_one_line("simulate", write_folder(tmp_path / "session"), "--model", tmp_path)
    assert f"{tmp_path}: there is no such file; needed an MJCF or a URDF" in told


def test_nothing_to_run_is_told(tmp_path: Path) -> None:
    """Before, exit code 0 and not a word."""
    pytest.importorskip("mirror_lab")
    pytest.importorskip("mujoco")
    assert "has no session (case-0000, ...): make some with `moving make`" in in_one_line(
        "moving", "run", tmp_path
    )
    assert "`moving make` and `moving run` write them" in in_one_line("moving", "score", tmp_path)


def test_a_file_where_a_new_folder_is_to_be(tmp_path: Path) -> None:
    """Before: "File exists", and not what to do."""
    pytest.importorskip("mirror_lab")
    (file := tmp_path / "file").write_text("no folder")
    told = in_one_line("blind", "make", file, "--cases", 1, "--workers", 1)
    assert f"{file}: is a file, or lies in one, needed a folder; give another name" in told


def test_the_next_command_reads_the_plan_that_was_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before, it was the one for the session's own plan, wherever the plan had been written."""
    import mirror_posture.cli.commands.plan as command
    import mirror_posture.plan

    monkeypatch.setattr(mirror_posture.plan, "make_plan", lambda *_, **__: SimpleNamespace())
    monkeypatch.setattr(mirror_posture.plan, "write_plan", lambda *_: None)
    monkeypatch.setattr(mirror_posture.plan.table, "document", lambda _: {})
    monkeypatch.setattr(command, "say_plan", lambda *_: None)
    session = setup(tmp_path)
    assert f"next: mirror-posture capture {session}\n" in run("plan", session).output
    told = run("plan", session, "--out", tmp_path / "other").output
    assert f"next: mirror-posture capture {session} --plan {tmp_path / 'other'}\n" in told


def test_a_demonstration_replaces_no_session_of_a_persons_own(tmp_path: Path) -> None:
    """Before, a folder named session in --out was deleted."""
    session = write_folder(tmp_path / "session")
    told = in_one_line("demo", "--out", tmp_path)
    assert f"{session}: is there already, and no demonstration wrote it; give another --out" in told
    assert (session / "detections.csv").is_file()


@pytest.mark.parametrize("address", ["scheduler", "tcp://10.0.0.1", "http://10.0.0.1:8786", ""])
def test_what_is_no_address_of_a_scheduler(address: str, tmp_path: Path) -> None:
    """Before, Dask tried it for half a minute and ended with a traceback."""
    told = in_one_line("diagnose", write_folder(tmp_path / "session"), "--scheduler", address)
    assert f"--scheduler: got {address!r}, needed tcp://HOST:PORT or tls://HOST:PORT" in told
    assert "warning" not in told
