"""Outputs are whole or not at all: kills, full disks, two writers, readers that stop."""

from __future__ import annotations

import os
import random
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from mirror_posture import MirrorPostureError
from mirror_posture.output_files import MIXED, is_whole, new_file, new_folder, write_file

WRITER = """
import sys
from pathlib import Path
from mirror_posture.output_files import new_folder, write_file
place, text = Path(sys.argv[1]), sys.argv[2]
print("ready", flush=True)
while True:
    write_file(place / "file.txt", text * 100_000)
    with new_folder(place / "folder", ("*.txt",)) as part:
        for name in ("a.txt", "b.txt"):
            (part / name).write_text(text * 10_000)
"""


def start(place: Path, text: str) -> subprocess.Popen[bytes]:
    process = subprocess.Popen([sys.executable, "-c", WRITER, str(place), text], stdout=subprocess.PIPE)
    assert process.stdout is not None and process.stdout.readline() == b"ready\n"
    return process


def whole(place: Path) -> set[str]:
    """The writers whose output stands there; fails for half of a file or for files of two."""
    found = set()
    if (place / "file.txt").exists():
        text = (place / "file.txt").read_text()
        assert len(text) == 100_000 and len(set(text)) == 1
        found.add(text[0])
    if (place / "folder").exists():
        texts = [(place / "folder" / name).read_text() for name in ("a.txt", "b.txt")]
        assert [len(text) for text in texts] == [10_000] * 2 and len(set("".join(texts))) == 1
    return found


def test_killed_at_any_moment(tmp_path: Path) -> None:
    chance = random.Random(3)
    for round_ in range(6):
        process = start(tmp_path, "ab"[round_ % 2])
        time.sleep(chance.uniform(0.0, 0.06))
        process.send_signal(signal.SIGKILL)
        process.wait()
        whole(tmp_path)
    # What the killed ones left is gone after the next one.
    write_file(tmp_path / "file.txt", "x")
    with new_folder(tmp_path / "folder", ("*.txt",)):
        pass
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file.txt", "folder"]


def test_two_writers(tmp_path: Path) -> None:
    both = [start(tmp_path, text) for text in "ab"]
    try:
        seen = set()
        end = time.monotonic() + 1.0
        while time.monotonic() < end:
            # Between two files of one folder the other writer may exchange it: only a single file is one reading.
            try:
                text = (tmp_path / "file.txt").read_text()
            except FileNotFoundError:
                continue
            assert len(text) == 100_000 and len(set(text)) == 1
            seen.add(text[0])
    finally:
        for process in both:
            process.kill()
            process.wait()
    whole(tmp_path)
    assert seen


def test_an_exception_leaves_the_old(tmp_path: Path) -> None:
    write_file(tmp_path / "file", "old")
    with pytest.raises(ValueError), new_file(tmp_path / "file") as part:
        part.write_text("new")
        raise ValueError
    with new_folder(tmp_path / "folder") as folder:
        (folder / "a").write_text("old")
    with pytest.raises(KeyboardInterrupt), new_folder(tmp_path / "folder") as folder:
        (folder / "a").write_text("new")
        raise KeyboardInterrupt
    assert (tmp_path / "file").read_text() == (tmp_path / "folder" / "a").read_text() == "old"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "folder"]


def test_what_an_earlier_run_wrote_goes_and_the_rest_stays(tmp_path: Path) -> None:
    place = tmp_path / "out"
    for name in ("1.png", "2.png"):
        with new_folder(place, ("[0-9]*.png",)) as part:
            (part / name).write_text(name)
    assert [path.name for path in place.iterdir()] == ["2.png"]
    (place / "notes.txt").write_text("mine")
    with new_folder(place, ("[0-9]*.png",)) as part:
        (part / "3.png").write_text("3")
    assert sorted(path.name for path in place.iterdir()) == ["3.png", "notes.txt"] and is_whole(place)


def test_others_files_stay_and_a_mixture_is_marked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place = tmp_path / "out"
    place.mkdir()
    (place / "notes.txt").write_text("mine")
    replace = os.replace

    def killed(*paths: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "replace", killed)
    with pytest.raises(KeyboardInterrupt), new_folder(place, ("*.png",)) as part:
        (part / "1.png").write_text("1")
    assert (place / MIXED).exists() and not is_whole(place)
    monkeypatch.setattr(os, "replace", replace)
    with new_folder(place, ("*.png",)) as part:
        (part / "1.png").write_text("1")
    assert is_whole(place) and (place / "notes.txt").read_text() == "mine"


def test_the_folder_in_which_one_stands_stays_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    inode = tmp_path.stat().st_ino
    with new_folder(".", ("*.txt",)) as part:
        (part / "a.txt").write_text("a")
    assert Path("a.txt").read_text() == "a" and tmp_path.stat().st_ino == inode


def test_a_full_disk_names_the_file_and_leaves_nothing(tmp_path: Path) -> None:
    write_file(tmp_path / "file.json", "old")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        with pytest.raises(MirrorPostureError, match=r"file\.json: cannot be written"):
            write_file(tmp_path / "file.json", "x" * 10_000)
        with pytest.raises(MirrorPostureError, match=r"folder: cannot be written"):
            with new_folder(tmp_path / "folder") as part:
                (part / "a").write_text("x" * 10_000)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, ignored)
    assert [path.name for path in tmp_path.iterdir()] == ["file.json"]
    assert (tmp_path / "file.json").read_text() == "old"


COMMAND = [sys.executable, "-m", "mirror_posture", "check", "--json"]


def test_a_reader_that_stops_is_no_error(tmp_path: Path) -> None:
    from session_folder import write_folder

    command = " ".join([*COMMAND, str(write_folder(tmp_path / "s"))])
    run = subprocess.run(f"{command} | true; echo ${{PIPESTATUS[0]}}", shell=True, executable="/bin/bash",
                         capture_output=True, text=True)  # fmt: skip
    assert run.stderr == "" and run.stdout.strip() == "0"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_a_full_standard_output_is_one_clear_error(tmp_path: Path) -> None:
    from session_folder import write_folder

    with open("/dev/full", "w") as full:
        run = subprocess.run(
            [*COMMAND, str(write_folder(tmp_path / "s"))], stdout=full, stderr=subprocess.PIPE, text=True
        )
    assert run.returncode == 1
    assert (
        run.stderr.startswith("error: standard output: cannot be written (No space left")
        and run.stderr.count("\n") == 1
    )
