"""Equalities of measuring in a mirror: order, names, the world's scale, the picture's resolution and threads change nothing."""

from __future__ import annotations

import csv
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

pytest.importorskip("mujoco", reason="the session needs mirror_lab's robots")

from mirror_posture.measurement import MeasureOptions, measure
from mirrored_session import write_mirrored
from test_metamorphic import shuffled_columns, shuffled_elements, shuffled_rows, vectors

Floats = np.ndarray


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("mirrored") / "session"
    return write_mirrored(folder, 3, lambda q: {**q, "r_elbow": q["r_elbow"] + 0.02}, 6)


@pytest.fixture(scope="module")
def found(original: Path) -> tuple[Floats, Floats]:
    return measured(original)


def measured(folder: Path, scale: float = 1.0) -> tuple[Floats, Floats]:
    """(P, M, 3) m of what was measured, NaN elsewhere, and its standard deviations."""
    options = MeasureOptions("joint", mount_std_rad=0.02, mount_std_m=0.002 * scale)
    markers = measure(folder, options).markers
    seen = markers.measured[..., None]
    assert markers.measured.sum() > 8, "too little is measured to compare anything"
    deviations = np.sqrt(np.einsum("...ii->...i", markers.covariance_m2))
    return np.where(seen, markers.point_in_root_m, np.nan), np.where(seen, deviations, np.nan)


def again(
    original: Path, folder: Path, scale: float = 1.0, **changes: Callable[[str], str]
) -> tuple[Floats, Floats]:
    """What is measured in a copy whose files (by stem) were changed."""
    folder.mkdir()
    for file in original.iterdir():
        text = file.read_text(encoding="utf-8")
        new = changes.get(file.stem, lambda t: t)(text)
        assert file.stem not in changes or new != text, "nothing was changed"
        (folder / file.name).write_text(new, encoding="utf-8")
    return measured(folder, scale)


def same(a: tuple[Floats, Floats], b: tuple[Floats, Floats], tolerance_m: float, scale: float = 1.0) -> None:
    for x, y in zip(a, b, strict=True):
        np.testing.assert_allclose(x, scale * y, rtol=1e-4, atol=tolerance_m)


def test_order(original: Path, found: tuple[Floats, Floats], tmp_path: Path) -> None:
    other = again(
        original,
        tmp_path / "session",
        detections=lambda t: shuffled_columns(shuffled_rows(t)),
        robot=shuffled_elements,
    )
    same(other, found, 1e-9)


def test_names(original: Path, found: tuple[Floats, Floats], tmp_path: Path) -> None:
    def renamed(text: str) -> str:
        return text.replace("r_elbow", "Gelenk 7").replace("r_hand", "Kugel").replace("chest_board", "Brett")

    changes = dict.fromkeys(("robot", "session", "frames", "detections"), renamed)
    same(again(original, tmp_path / "session", **changes), found, 0.0)


def test_a_larger_world(original: Path, found: tuple[Floats, Floats], tmp_path: Path) -> None:
    def lengths(text: str) -> str:
        return re.sub(
            r"(square|diameter|glass_thickness) = ([\d.]+)",
            lambda m: f"{m[1]} = {2.0 * float(m[2])!r}",
            text,
        )

    other = again(
        original,
        tmp_path / "session",
        2.0,
        robot=lambda t: vectors(t, "xyz", lambda p: [2.0 * x for x in p], "origin"),
        session=lengths,
    )
    same(other, found, 2e-7, 2.0)


def test_a_finer_picture(original: Path, found: tuple[Floats, Floats], tmp_path: Path) -> None:
    """Twice the resolution: pixel (0, 0) is the first pixel's centre, so u is 2 u + 1/2."""

    def pixels(text: str) -> str:
        rows = list(csv.reader(text.splitlines()))
        for name in "uv":
            k = rows[0].index(name)
            for row in rows[1:]:
                row[k] = repr(2.0 * float(row[k]) + 0.5)
        return "\n".join(map(",".join, rows)) + "\n"

    def camera(text: str) -> str:
        tree = yaml.safe_load(text)
        tree["image_width"], tree["image_height"] = 2 * tree["image_width"], 2 * tree["image_height"]
        data = tree["camera_matrix"]["data"]
        data[0], data[4], data[2], data[5] = 2 * data[0], 2 * data[4], 2 * data[2] + 0.5, 2 * data[5] + 0.5
        return yaml.safe_dump(tree)

    other = again(
        original,
        tmp_path / "session",
        detections=pixels,
        camera=camera,
        session=lambda t: t.replace("pixel_std = 0.1", "pixel_std = 0.2"),
    )
    same(other, found, 1e-7)


def test_units_of_time(original: Path, found: tuple[Floats, Floats], tmp_path: Path) -> None:
    """What is measured does not depend on when."""

    def milliseconds(text: str) -> str:
        rows = list(csv.reader(text.splitlines()))
        k = rows[0].index("time_s")
        for row in rows[1:]:
            row[k] = repr(1000.0 * float(row[k]))
        return "\n".join(map(",".join, rows)) + "\n"

    same(again(original, tmp_path / "time", frames=milliseconds), found, 0.0)


def test_numbers_of_threads(original: Path, found: tuple[Floats, Floats]) -> None:
    code = (
        "import sys, numpy as np; from mirror_posture.measurement import MeasureOptions, measure; "
        "m = measure(sys.argv[1], MeasureOptions('joint')).markers; print(np.asarray(m.point_in_root_m)[m.measured].tobytes().hex())"
    )
    texts = {
        subprocess.run(
            [sys.executable, "-c", code, str(original)],
            env={**os.environ, "RAYON_NUM_THREADS": threads},
            capture_output=True, text=True, check=True,
        ).stdout for threads in ("1", "3")
    }  # fmt: skip
    assert len(texts) == 1
