"""The laboratory's files: whole or not at all, and nothing left of killed runs; what another run is writing stays."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from mirror_lab.blind.whole_file import UNFINISHED, whole_folder, write_whole

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")


def killed_while_writing(place: Path) -> None:
    child = os.fork()
    if child == 0:
        os.fsync = lambda _: os.kill(os.getpid(), 9)  # type: ignore[assignment]
        write_whole(place / "a.json", "new")
    os.waitpid(child, 0)
    child = os.fork()
    if child == 0:
        with whole_folder(place / "case") as part:
            (part / "x").write_text("new")
            os.kill(os.getpid(), 9)
    os.waitpid(child, 0)


def test_kills_leave_the_old_and_the_next_run_nothing_else(tmp_path: Path) -> None:
    write_whole(tmp_path / "a.json", "old")
    with whole_folder(tmp_path / "case") as part:
        (part / "x").write_text("old")
    killed_while_writing(tmp_path)
    assert len(list(tmp_path.glob(f".*{UNFINISHED}"))) == 2
    assert (tmp_path / "a.json").read_text() == (tmp_path / "case" / "x").read_text() == "old"
    write_whole(tmp_path / "a.json", "newer")
    with whole_folder(tmp_path / "case") as part:
        (part / "y").write_text("newer")
        # Another writer of the same name takes nothing away from this one.
        with whole_folder(tmp_path / "case") as other:
            (other / "y").write_text("other")
        assert (part / "y").exists()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.json", "case"]
    assert [path.name for path in (tmp_path / "case").iterdir()] == ["y"]
    assert (tmp_path / "case" / "y").read_text() == "newer"
