"""Equalities of measuring in a mirror: order, names, the world's scale, the picture's resolution and threads change nothing."""

from __future__ import annotations

import csv
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

pytest.importorskip("mujoco", reason="the session needs mirror_lab's robots")

from mirror_posture import load_session
from mirror_posture.diagnosis import diagnose
from mirror_posture.measurement import MeasureOptions, measure
from mirrored_session import write_mirrored
from test_metamorphic import (
    said,
    shuffled_columns,
    shuffled_elements,
    shuffled_rows,
    unsigned,
    vectors,
)
from test_metamorphic import same as alike

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


def shuffled_sections(text: str) -> str:
    """Other orders of the markers and of the sections; what stands before them stays first."""
    head, *sections = re.split(r"(?m)^(?=\[)", text)
    markers = [one for one in sections if one.startswith("[[markers]]")][::-1]
    others = [one for one in sections if not one.startswith("[[markers]]")][::-1]
    return head + "\n".join([*markers, *others])


def test_order_of_sections(original: Path, found: tuple[Floats, Floats], tmp_path: Path) -> None:
    folder = tmp_path / "session"
    other = again(original, folder, session=shuffled_sections)
    names, before = (list(load_session(at).marker_names) for at in (folder, original))
    assert names == before[::-1]
    # Rows are posture by posture, markers in the order of the session.
    keys = [(p, names[m]) for p, m in zip(*rows_of(folder), strict=True)]
    old = [(p, before[m]) for p, m in zip(*rows_of(original), strict=True)]
    order = [keys.index(key) for key in old]
    assert order != sorted(order)
    same((other[0][order], other[1][order]), found, 1e-9)


def rows_of(folder: Path) -> tuple[list[int], list[int]]:
    markers = measure(folder).markers
    return markers.posture.tolist(), markers.marker.tolist()


TURN_RPY = (0.4, -0.9, 2.1)
SHIFT_M = (0.3, -0.2, 0.7)


def matrix_of(rpy: tuple[float, float, float]) -> Floats:
    """Fixed axes, x first."""
    (a, b, c), (d, e, f) = np.cos(rpy), np.sin(rpy)
    about_z, about_y, about_x = (
        np.array([[c, -f, 0], [f, c, 0], [0, 0, 1]]),
        np.array([[b, 0, e], [0, 1, 0], [-e, 0, b]]),
        np.array([[1, 0, 0], [0, a, -d], [0, d, a]]),
    )
    return about_z @ about_y @ about_x


def on_a_bench(text: str) -> str:
    """A root below the robot's, turned and shifted."""
    joint = (
        '<link name="bench"/><joint name="bolts" type="fixed"><parent link="bench"/><child link="base_link"/>'
        f'<origin xyz="{" ".join(map(str, SHIFT_M))}" rpy="{" ".join(map(str, TURN_RPY))}"/></joint></robot>'
    )
    return text.replace("</robot>", joint)


def turned_gravity(text: str) -> str:
    turned = matrix_of(TURN_RPY) @ [0.0, 0.0, -9.81]
    text = text.replace('root = "base_link"', 'root = "bench"')
    return re.sub(r"gravity = \[[^]]*\]", f"gravity = {turned.tolist()!r}", text)


def test_a_turned_world(original: Path, found: tuple[Floats, Floats], tmp_path: Path) -> None:
    points, _ = again(original, tmp_path / "session", robot=on_a_bench, session=turned_gravity)
    np.testing.assert_allclose(points, found[0] @ matrix_of(TURN_RPY).T + SHIFT_M, rtol=0.0, atol=1e-9)


def reflected_robot(text: str) -> str:
    """y is −y in every link's frame: origins are reflected, angles about x and z and axes (which are no points) turn round."""
    text = vectors(text, "xyz", lambda p: [p[0], -p[1], p[2]], "origin")
    text = vectors(text, "rpy", lambda a: [-a[0], a[1], -a[2]], "origin")
    return vectors(text, "xyz", lambda a: [-a[0], a[1], -a[2]], "axis")


def flipped_camera(text: str) -> str:
    """The camera's y is −y as well: rows are counted from below, and the lens's first tangential coefficient changes its sign."""
    tree = yaml.safe_load(text)
    tree["camera_matrix"]["data"][5] = tree["image_height"] - 1 - tree["camera_matrix"]["data"][5]
    tree["distortion_coefficients"]["data"][2] *= -1.0
    return yaml.safe_dump(tree)


def flipped_points(corners: tuple[int, int], height_px: int) -> Callable[[str], str]:
    """And the board's: its rows of corners are counted from the other side."""

    def change(text: str) -> str:
        head, *rows = csv.reader(text.splitlines())
        target, index, v = (head.index(name) for name in ("target", "index", "v"))
        for row in rows:
            row[v] = repr(height_px - 1 - float(row[v]))
            if row[target] == "board":
                iy, ix = divmod(int(row[index]), corners[0])
                row[index] = str((corners[1] - 1 - iy) * corners[0] + ix)
        return "\n".join(map(",".join, [head, *rows])) + "\n"

    return change


def reflected(original: Path) -> dict[str, Callable[[str], str]]:
    """The changes that make the mirrored world of a session."""
    session = load_session(original)
    board, camera = session.board, session.camera
    assert board is not None and camera is not None
    return {
        "robot": reflected_robot,
        "camera": flipped_camera,
        "detections": flipped_points((board.columns, board.rows), camera.size_px[1]),
    }


def test_a_mirrored_world(original: Path, found: tuple[Floats, Floats], tmp_path: Path) -> None:
    points, deviations = again(original, tmp_path / "session", **reflected(original))
    same((points, deviations), (found[0] * [1.0, -1.0, 1.0], found[1]), 1e-7)


def test_a_diagnosis_in_the_mirror(tmp_path: Path) -> None:
    """Order changes nothing at all; names, a mirrored and a turned world nothing of what is said."""
    original = write_mirrored(tmp_path / "original", 7, lambda q: {**q, "r_elbow": q["r_elbow"] + 0.03}, 16)

    def diagnosed(name: str, **changes: Callable[[str], str]) -> dict[str, Any]:
        folder = tmp_path / name
        folder.mkdir()
        for file in original.iterdir():
            text = file.read_text(encoding="utf-8")
            (folder / file.name).write_text(changes.get(file.stem, str)(text), encoding="utf-8")
        document: dict[str, Any] = json.loads(diagnose(folder, most_causes=1).to_json())
        return document

    found = diagnosed("same")
    assert [cause["at"] for cause in found["causes"]] == ["joint:r_elbow"]
    order = diagnosed(
        "order", detections=lambda t: shuffled_columns(shuffled_rows(t)), robot=shuffled_elements
    )
    alike(unsigned(order), unsigned(found), 0.0)

    def renamed(text: str) -> str:
        return text.replace("r_elbow", "Gelenk 7").replace("r_hand", "Kugel").replace("chest_board", "Brett")

    mirror = reflected(original)
    changed = diagnosed(
        "changed",
        robot=lambda t: renamed(on_a_bench(mirror["robot"](t))),
        camera=mirror["camera"],
        detections=lambda t: renamed(mirror["detections"](t)),
        session=lambda t: renamed(turned_gravity(t)),
        frames=renamed,
    )
    alike(said(changed), json.loads(renamed(json.dumps(said(found)))), 1e-3)


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
