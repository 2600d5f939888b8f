"""Pictures are taken as they are stored: a viewer's turn (EXIF) is never applied, and is named where a picture's size does not fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mirror_posture.detect.reading import EXIF_ORIENTATION, EXIF_TURNS, read_picture, read_picture_file


@pytest.mark.parametrize("ending", ["jpg", "png", "tif", "webp"])
def test_a_turn_that_a_file_tells_of_is_not_made(tmp_path: Path, ending: str) -> None:
    pixels = np.random.default_rng(0).integers(0, 255, (24, 40, 3), dtype=np.uint8)
    plain = tmp_path / f"plain.{ending}"
    Image.fromarray(pixels).save(plain)
    stored = read_picture(plain)
    assert stored.shape == (24, 40, 3)
    for turn, words in EXIF_TURNS.items():
        exif = Image.Exif()
        exif[EXIF_ORIENTATION] = turn
        file = tmp_path / f"{turn}.{ending}"
        Image.fromarray(pixels).save(file, exif=exif)
        found = read_picture_file(file)
        assert np.array_equal(found.pixels, stored) and found.exif_turn == words
