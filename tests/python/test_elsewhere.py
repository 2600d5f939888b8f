"""What cannot be run here is made to fail as it would there: Windows' files, and its signals."""

from __future__ import annotations

import fcntl
import importlib.util
import io
import os
import shutil
import signal
import sys
from pathlib import Path
from typing import Any

import pytest

from mirror_posture import output_files
from mirror_posture.cli import streams
from mirror_posture.correct import lines
from mirror_posture.robots import interruption

pytestmark = pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="needs Linux's list of open files")


@pytest.fixture
def windows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Folders cannot be opened, what is open cannot be renamed, what is open for reading cannot be synced, no locks."""
    opened, replace, sync = os.open, os.replace, os.fsync

    def open_file(path: Any, flags: int, *more: Any, **options: Any) -> int:
        if os.path.isdir(path):
            raise PermissionError(13, "Permission denied", os.fspath(path))
        return opened(path, flags, *more, **options)

    def replace_closed(source: Any, target: Any) -> None:
        for path in (os.fspath(source), os.fspath(target)):
            for handle in os.listdir("/proc/self/fd"):
                try:
                    held = os.readlink(f"/proc/self/fd/{handle}")
                except OSError:
                    continue
                if held == os.path.realpath(path):
                    raise PermissionError(13, "The process cannot access the file: it is being used", path)
        replace(source, target)

    def sync_writable(handle: int) -> None:
        if fcntl.fcntl(handle, fcntl.F_GETFL) & os.O_ACCMODE == os.O_RDONLY:
            raise OSError(9, "Bad file descriptor")
        sync(handle)

    monkeypatch.setattr(output_files, "WINDOWS", True)
    monkeypatch.setattr(output_files, "fcntl", None)
    monkeypatch.setattr(output_files, "_exchange", lambda part, place: False)
    monkeypatch.setattr(shutil, "_use_fd_functions", False)
    monkeypatch.setattr(os, "open", open_file)
    monkeypatch.setattr(os, "replace", replace_closed)
    monkeypatch.setattr(os, "fsync", sync_writable)


def test_files_and_folders_are_written(windows: None, tmp_path: Path) -> None:
    for text in ("first", "second"):
        output_files.write_file(tmp_path / "a.json", text)
        assert (tmp_path / "a.json").read_text() == text
        with output_files.new_folder(tmp_path / "out", ("*.txt",)) as part:
            (part / "a.txt").write_text(text)
            (part / "pictures").mkdir()
        assert (tmp_path / "out" / "a.txt").read_text() == text
    (tmp_path / "out" / "theirs").write_text("stays")
    with output_files.new_folder(tmp_path / "out", ("*.txt",)) as part:
        (part / "b.txt").write_text("third")
    assert {file.name for file in (tmp_path / "out").iterdir()} == {"b.txt", "theirs", "pictures"}
    assert {file.name for file in tmp_path.iterdir()} == {"a.json", "out"}


def test_a_correction_is_recorded(windows: None, tmp_path: Path) -> None:
    file = tmp_path / "frames.csv"
    lines.append(file, ["frame", "a, b"], [[1, 0.1]])
    assert file.read_text() == 'frame,"a, b"\n1,0.1\n'
    lines.append_bytes(file, b"2,0.")
    lines.cut_last_line(file)
    assert file.read_text() == 'frame,"a, b"\n1,0.1\n'


def test_this_windows_is_strict(windows: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As on Linux it would fail there: so the tests above can fail."""
    monkeypatch.setattr(output_files, "WINDOWS", False)
    with pytest.raises(Exception, match="cannot be written"):
        output_files.write_file(tmp_path / "a.json", "text")


def test_signals_that_a_system_lacks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(signal, "SIGHUP")
    monkeypatch.setattr(signal, "SIGBREAK", 21, raising=False)
    # A copy of the module: others hold the classes of the one that is loaded.
    spec = importlib.util.spec_from_file_location("interruption_there", interruption.__file__)
    assert spec is not None and spec.loader is not None
    there = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(there)
    assert there.ENDING == (signal.SIGTERM, 21)


def test_a_console_that_lacks_a_letter_is_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    raw = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(raw, encoding="cp1252"))
    monkeypatch.setattr(sys, "stderr", io.TextIOWrapper(io.BytesIO(), encoding="cp1252"))
    out = streams.make_patient()
    out.write("1 ± 2 °, ≈ σ")
    assert streams.end(out) is None
    assert raw.getvalue().decode("cp1252") == "1 ± 2 °, ? ?"
