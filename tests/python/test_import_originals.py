"""An import and the pictures that are there: somebody's originals stay, and few are held in memory at a time."""

from __future__ import annotations

import hashlib
import json
import os
import weakref
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from init_once import initialised
from mirror_posture import MirrorPostureError, cli
from mirror_posture.camera import Camera
from mirror_posture.importing import JointLog, Recording, import_recording
from mirror_posture.session import load_camera_info

POSTURES = (0.0, 0.4, -0.3)
URDF = (
    '<robot name="r"><link name="base"/><link name="l"/><joint name="a" type="revolute"><parent link="base"/><child link="l"/>'
    '<axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint></robot>'
)


def run(*arguments: object, code: int = 0):
    result = CliRunner().invoke(cli.app, [str(argument) for argument in arguments])
    assert result.exit_code == code, f"{result.exit_code}: {result.output}\n{result.exception!r}"
    return result


@pytest.fixture
def session(tmp_path: Path) -> Path:
    (tmp_path / "arm.urdf").write_text(URDF)
    words = ["--camera", "base", "--camera-at", "0,0,0.3", "--board", "base", "--board-at", "0,0,0.1"]
    words += ["--marker", "hand=l@0.1,0,0", "--picture", "64x48"]
    return initialised(tmp_path / "arm.urdf", tmp_path / "s", *words)


def picture(shade: int) -> np.ndarray:
    return np.random.default_rng(shade).integers(0, 255, (48, 64, 3), dtype=np.uint8)


def write_pictures(folder: Path, log: Path) -> tuple[object, ...]:
    """One picture a second, named as an import names its own, and a log with a rest around each."""
    folder.mkdir(exist_ok=True)
    for number in range(len(POSTURES)):
        cv2.imwrite(str(folder / f"{number:04d}.png"), picture(number))
    rows = [f"{second + part},{value}" for second, value in enumerate(POSTURES) for part in (-0.4, 0.0, 0.4)]
    log.write_text("time_s,a\n" + "\n".join(rows) + "\n")
    (folder / "times.csv").write_text(
        "image,time_s\n" + "".join(f"{n:04d}.png,{n}\n" for n in range(len(POSTURES)))
    )
    return ("--joints", log, "--offset-s", "0")


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


@pytest.mark.parametrize("overwrite", [False, True])
def test_pictures_in_the_place_of_an_import_are_no_source(
    session: Path, tmp_path: Path, overwrite: bool
) -> None:
    """Before, an import replaced the originals that it was reading."""
    words = write_pictures(session / "images", tmp_path / "joints.csv")
    before = contents(session / "images")
    more = ("--overwrite",) if overwrite else ()
    told = " ".join(run("import", session / "images", session, *words, *more, code=1).stderr.split())
    assert "lies in the session's images/" in told and "move it out of there" in told
    assert contents(session / "images") == before and not (session / "frames.csv").exists()


@pytest.mark.parametrize("overwrite", [False, True])
@pytest.mark.parametrize("frames", [False, True])
def test_pictures_that_no_import_made_are_kept(
    session: Path, tmp_path: Path, overwrite: bool, frames: bool
) -> None:
    words = write_pictures(tmp_path / "source", tmp_path / "joints.csv")
    (session / "images").mkdir()
    cv2.imwrite(str(session / "images" / "0001.png"), picture(77))
    if frames:
        # Of a capture, or by hand: the pictures are originals all the same.
        (session / "frames.csv").write_text("frame,posture,image,a\n0,0,images/0001.png,0\n")
    before = contents(session / "images")
    more = ("--overwrite",) if overwrite else ()
    told = " ".join(run("import", tmp_path / "source", session, *words, *more, code=1).stderr.split())
    if frames and not overwrite:
        assert "has frames or detections already" in told
    else:
        assert "0001.png: is there already, and is not in images/imported.sha256" in told
    assert contents(session / "images") == before
    assert (session / "frames.csv").exists() == frames


def test_an_import_replaces_what_an_import_made_and_nothing_else(session: Path, tmp_path: Path) -> None:
    source = tmp_path / "source"
    words = write_pictures(source, tmp_path / "joints.csv")
    run("import", source, session, *words)
    images = session / "images"
    listed = dict(line.split("  ")[::-1] for line in (images / "imported.sha256").read_text().splitlines())
    assert listed == {
        f"{n:04d}.png": hashlib.sha256((images / f"{n:04d}.png").read_bytes()).hexdigest() for n in range(3)
    }
    cv2.imwrite(str(images / "mine.png"), picture(9))
    # A shorter recording: the third picture goes, one's own stays.
    log = tmp_path / "joints.csv"
    log.write_text("\n".join(log.read_text().splitlines()[:7]) + "\n")
    done = json.loads(run("import", source, session, *words, "--overwrite", "--json").stdout)
    assert done["frames"] == 2
    assert sorted(contents(images)) == ["0000.png", "0001.png", "imported.sha256", "mine.png"]
    # One that was replaced since is an original.
    cv2.imwrite(str(images / "0001.png"), picture(5))
    assert (
        "0001.png: is there already" in run("import", source, session, *words, "--overwrite", code=1).stderr
    )
    np.testing.assert_array_equal(cv2.imread(str(images / "0001.png")), picture(5))
    # Without frames what an import made still wants the word.
    (images / "0001.png").unlink()
    (session / "frames.csv").unlink()
    told = " ".join(run("import", source, session, *words, code=1).stderr.split())
    assert "0000.png: is there already, from an earlier import; add --overwrite" in told
    run("import", source, session, *words, "--overwrite")


def test_few_pictures_are_held_at_a_time(session: Path) -> None:
    """Before, one for each rest: 60 rests of 1080p took 460 MB."""
    count, most = 30, 0
    made: list[weakref.ref[np.ndarray]] = []

    def pictures() -> Iterator[tuple[float, np.ndarray]]:
        nonlocal most
        for number in range(count):
            one = picture(number)
            made.append(weakref.ref(one))
            most = max(most, sum(ref() is not None for ref in made))
            yield float(number), one

    time_s = np.arange(count)[:, None] + np.array([-0.4, 0.0, 0.4])
    position = np.repeat(np.where(np.arange(count) % 2, 0.4, 0.0), 3)[:, None]
    recording = Recording(JointLog(time_s.ravel(), ("a",), position), pictures, None, "a recording")
    assert import_recording(recording, session, offset_s=0.0).frames == count
    assert most <= 3
    for number in range(count):
        np.testing.assert_array_equal(cv2.imread(str(session / f"images/{number:04d}.png")), picture(number))
    with pytest.raises(MirrorPostureError, match="add --overwrite"):
        import_recording(recording, session, offset_s=0.0)


@pytest.mark.parametrize("overwrite", [False, True])
@pytest.mark.parametrize(
    ("name", "text"),
    [("states.csv", "time_s,a\n0,0.5\n9,0.5\n"), ("points.csv", "frame,marker,x,y,z\n0,hand,0,0,1\n")],
)
def test_tables_of_other_frames_are_neither_read_with_the_new_ones_nor_lost(
    session: Path, tmp_path: Path, name: str, text: str, overwrite: bool
) -> None:
    """Before, an earlier recording's log gave the joints that the new one lacks."""
    words = write_pictures(tmp_path / "source", tmp_path / "joints.csv")
    (session / name).write_text(text)
    more = ("--overwrite",) if overwrite else ()
    told = " ".join(run("import", tmp_path / "source", session, *words, *more, code=1).stderr.split())
    assert f"{name}: is there already" in told and "move it out of the folder" in told
    assert (session / name).read_text() == text and not (session / "frames.csv").exists()


@pytest.mark.parametrize("inside", [False, True])
def test_a_link_in_the_place_of_the_pictures_is_refused(session: Path, tmp_path: Path, inside: bool) -> None:
    """Before, the pictures were written where it leads, and no command read them."""
    words = write_pictures(tmp_path / "source", tmp_path / "joints.csv")
    place = session / "pictures" if inside else tmp_path / "disk"
    place.mkdir()
    (session / "images").symlink_to(place)
    told = " ".join(run("import", tmp_path / "source", session, *words, code=1).stderr.split())
    assert "images: is a link (to " in told and "put the folder in its place" in told
    assert not list(place.iterdir()) and not (session / "frames.csv").exists()


def test_a_camera_file_whose_name_reads_as_a_pattern_is_replaced_and_not_written_into(
    session: Path, tmp_path: Path
) -> None:
    toml = session / "session.toml"
    toml.write_text(toml.read_text().replace("camera.yaml", "cam[0].yaml"))
    (session / "camera.yaml").rename(session / "cam[0].yaml")
    before = (session / "cam[0].yaml").read_bytes()
    os.link(session / "cam[0].yaml", tmp_path / "backup.yaml")
    time_s = np.arange(3)[:, None] + np.array([-0.4, 0.0, 0.4])
    log = JointLog(time_s.ravel(), ("a",), np.repeat([0.0, 0.4, -0.3], 3)[:, None])
    camera: Camera = replace(load_camera_info(session / "cam[0].yaml"), focal_px=(55.0, 55.0))
    shown = [(float(number), picture(number)) for number in range(3)]
    import_recording(Recording(log, lambda: iter(shown), camera, "a recording"), session, offset_s=0.0)
    assert load_camera_info(session / "cam[0].yaml").focal_px == (55.0, 55.0)
    assert (tmp_path / "backup.yaml").read_bytes() == before
