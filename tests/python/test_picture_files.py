"""How pictures are written, and that reading them leaves the process as it is."""

from __future__ import annotations

import subprocess
import sys
import warnings
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from mirror_posture import MirrorPostureError
from mirror_posture.capture import Recorder
from mirror_posture.detect import DetectionError, read_picture
from mirror_posture.importing.bounds import decoded
from mirror_posture.picture_files import encoded_picture, write_picture
from mirror_posture.plan import PlannedFrame

PICTURE = np.random.default_rng(0).integers(0, 255, (24, 32, 3)).astype(np.uint8)


def test_a_picture_is_written_whole_in_the_format_of_its_name(tmp_path: Path) -> None:
    file = write_picture(tmp_path / "picture.png", PICTURE)
    assert np.array_equal(read_picture(file), PICTURE) and list(tmp_path.iterdir()) == [file]
    assert write_picture(tmp_path / "picture.jpg", PICTURE).read_bytes().startswith(b"\xff\xd8")
    # Without an ending it is PNG.
    assert encoded_picture(PICTURE, "picture") == file.read_bytes()


def test_what_cannot_be_encoded_is_told_and_not_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """OpenCV says so with False, or with an error of its own, or with an empty result."""
    for name, picture in (("a.xyz", PICTURE), ("a.png", np.zeros((0, 4, 3), np.uint8))):
        with pytest.raises(MirrorPostureError, match=r"a\.\w+: a picture of shape .* needed grey or BGR"):
            write_picture(tmp_path / name, picture)
    monkeypatch.setattr(cv2, "imencode", lambda *_: (False, np.zeros(0, np.uint8)))
    with pytest.raises(MirrorPostureError, match=r"cannot be encoded as '\.png'"):
        write_picture(tmp_path / "a.png", PICTURE)
    row = PlannedFrame(0, 0, 0, {"joint": 0.0})
    with pytest.raises(MirrorPostureError, match="cannot be encoded"):
        Recorder(tmp_path, [row]).add(row, PICTURE, 0.0, {})
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_reading_does_not_touch_the_filters_of_warnings(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are the whole process's: a thread that puts its own away and back takes those of another with it."""
    file = write_picture(tmp_path / "picture.jpg", PICTURE)
    before, meanwhile, really = warnings.filters, [], Image.open

    def seen(*words: object) -> Image.Image:
        meanwhile.append(warnings.filters is before)
        return really(*words)

    monkeypatch.setattr(Image, "open", seen)
    read_picture(file)
    decoded(file.read_bytes(), "picture")
    assert meanwhile == [True, True]


def test_the_commands_do_not_pass_on_pillows_warning_of_a_picture_within_the_limit(tmp_path: Path) -> None:
    (tmp_path / "pictures").mkdir()
    write_picture(tmp_path / "pictures" / "picture.jpg", PICTURE)
    text = (
        "import sys; from PIL import Image; from mirror_posture.cli.app import main\n"
        "Image.MAX_IMAGE_PIXELS = 500; sys.argv = ['', 'calibrate-camera', sys.argv[1], *sys.argv[2:]]; main()"
    )
    board = ("--corners", "4x3", "--square-mm", "20", "--out", str(tmp_path / "camera.yaml"))
    done = subprocess.run(
        [sys.executable, "-c", text, str(tmp_path / "pictures"), *board], capture_output=True, text=True
    )
    assert done.returncode == 1 and "exceeds limit" not in done.stderr, done.stderr


def test_grey_of_32_bits_is_read_as_the_16_that_it_holds(tmp_path: Path) -> None:
    """Before, Pillow cut off all levels above 255, and such a picture was white."""
    levels = np.linspace(0, 65535, 40 * 50).reshape(40, 50).astype(np.int32)
    file = tmp_path / "grey.tiff"
    Image.fromarray(levels).save(file)
    with Image.open(file) as opened:
        assert opened.mode == "I"
    read = read_picture(file)
    assert read.shape == (40, 50, 3) and (read == (levels >> 8)[..., None]).all()
    for value in (-1, 65536):
        levels[3, 4] = value
        Image.fromarray(levels).save(file)
        with pytest.raises(DetectionError, match=f"grey.tiff: has grey levels .*{value}.*needed 0 to 65535"):
            read_picture(file)
