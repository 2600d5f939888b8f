"""Equalities that hold for every session: order, names, the world's pose, handedness, scale, time and threads change nothing.

The session's truth is one wrong zero; what is compared is everything that the diagnosis says, as far as the change leaves it the same.
"""

from __future__ import annotations

import csv
import json
import os
import random
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the tracked session needs mirror_lab's robots")

from mirror_posture.diagnosis import diagnose
from tracked_session import write_tracked

OFFSET = 0.02


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tracked(
        tmp_path_factory.mktemp("original") / "session", 3, lambda q: {**q, "r_elbow": q["r_elbow"] + OFFSET}
    )


@pytest.fixture(scope="module")
def found(original: Path) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(diagnose(original).to_json())
    (cause,) = document["causes"]
    assert cause["at"] == "joint:r_elbow" and document["verdict"] == "explained"
    return document


def again(original: Path, folder: Path, **changes: Callable[[str], str]) -> dict[str, Any]:
    """The diagnosis of a copy whose files (by stem) were changed."""
    folder.mkdir()
    for file in original.iterdir():
        text = file.read_text(encoding="utf-8")
        change = changes.get(file.stem)
        (folder / file.name).write_text(text if change is None else change(text), encoding="utf-8")
        assert change is None or (folder / file.name).read_text(encoding="utf-8") != text, (
            "nothing was changed"
        )
    document: dict[str, Any] = json.loads(diagnose(folder).to_json())
    return document


def same(a: Any, b: Any, tolerance: float, place: str = "") -> None:
    """Two documents alike, numbers within a share of their size (or of a thousandth)."""
    if isinstance(a, dict):
        assert a.keys() == b.keys(), place
        for key in a:
            same(a[key], b[key], tolerance, f"{place}.{key}")
    elif isinstance(a, list):
        assert len(a) == len(b), place
        for k, (x, y) in enumerate(zip(a, b, strict=True)):
            same(x, y, tolerance, f"{place}[{k}]")
    elif isinstance(a, float) and isinstance(b, (int, float)):
        assert abs(a - b) <= tolerance * max(abs(a), abs(b), 1e-3), f"{place}: {a} and {b}"
    else:
        assert a == b, place


def unsigned(document: dict[str, Any]) -> dict[str, Any]:
    """Without the hashes of the session's files, which change with every byte."""
    return {key: value for key, value in document.items() if key != "session"}


def said(document: dict[str, Any]) -> dict[str, Any]:
    """What a change of coordinates leaves the same: verdict, causes with their values, the gap."""
    causes = [
        {"effect": c["effect"], "at": c["at"], "parameters": c["parameters"]} for c in document["causes"]
    ]
    gap = {key: document["gap"][key] for key in ("before_m", "after_m", "noise_floor_m")}
    return {"verdict": document["verdict"], "causes": causes, "gap": gap}


def shuffled_rows(text: str) -> str:
    head, *rows = text.splitlines()
    random.Random(1).shuffle(rows)
    return "\n".join([head, *rows]) + "\n"


def shuffled_columns(text: str) -> str:
    rows = list(csv.reader(text.splitlines()))
    order = list(range(len(rows[0])))
    random.Random(2).shuffle(order)
    return "\n".join(",".join(row[k] for k in order) for row in rows) + "\n"


def shuffled_elements(text: str) -> str:
    robot = ElementTree.fromstring(text)
    # Children of one link stay in their order: it is that of the joints.
    links, joints = robot.findall("link"), robot.findall("joint")
    for part in (*links, *joints):
        robot.remove(part)
    random.Random(3).shuffle(links)
    robot.extend([*joints, *links])
    for joint in joints:
        joint[:] = joint[::-1]
    return ElementTree.tostring(robot, encoding="unicode")


def test_order_of_rows_columns_and_elements(original: Path, found: dict[str, Any], tmp_path: Path) -> None:
    document = again(
        original,
        tmp_path / "session",
        points=lambda t: shuffled_columns(shuffled_rows(t)),
        robot=shuffled_elements,
    )
    same(unsigned(document), unsigned(found), 0.0)


def test_order_of_the_joints_columns(original: Path, found: dict[str, Any], tmp_path: Path) -> None:
    same(said(again(original, tmp_path / "session", frames=shuffled_columns)), said(found), 1e-9)


def test_renaming(original: Path, found: dict[str, Any], tmp_path: Path) -> None:
    def renamed(text: str) -> str:
        return text.replace("r_elbow", "Gelenk 7").replace("r_hand", "Kugel")

    document = again(
        original, tmp_path / "session", frames=renamed, robot=renamed, points=renamed, session=renamed
    )
    assert json.dumps(said(document)) == renamed(json.dumps(said(found)))


def points_moved(text: str, move: Callable[[np.ndarray], np.ndarray]) -> str:
    rows = list(csv.reader(text.splitlines()))
    k = [rows[0].index(axis) for axis in "xyz"]
    for row in rows[1:]:
        for column, value in zip(k, move(np.array([float(row[c]) for c in k])), strict=True):
            row[column] = repr(float(value))
    return "\n".join(map(",".join, rows)) + "\n"


def test_a_turned_and_shifted_world(original: Path, tmp_path: Path) -> None:
    turn = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))

    def unknown(text: str) -> str:
        return text.replace('frame = "base_link"', 'frame = "unknown"')

    here = again(original, tmp_path / "here", session=unknown)
    there = again(
        original, tmp_path / "there", session=unknown, points=lambda t: points_moved(t, lambda p: turn @ p + [3.0, -2.0, 1.0])
    )  # fmt: skip
    same(said(there), said(here), 1e-4)


def vectors(text: str, attribute: str, change: Callable[[list[float]], list[float]], inside: str = "") -> str:
    pattern = rf'(<{inside}[^>]*\b{attribute}=")([^"]+)(")'
    return re.sub(
        pattern, lambda m: m[1] + " ".join(map(repr, change([float(x) for x in m[2].split()]))) + m[3], text
    )


def test_a_mirrored_world(original: Path, found: dict[str, Any], tmp_path: Path) -> None:
    """y is −y: origins and points are reflected, angles about x and z and axes (which are no points) turn round."""

    def reflected(text: str) -> str:
        text = vectors(text, "xyz", lambda p: [p[0], -p[1], p[2]], "origin")
        text = vectors(text, "rpy", lambda a: [-a[0], a[1], -a[2]], "origin")
        return vectors(text, "xyz", lambda a: [-a[0], a[1], -a[2]], "axis")

    document = again(
        original,
        tmp_path / "session",
        robot=reflected,
        points=lambda t: points_moved(t, lambda p: p * [1.0, -1.0, 1.0]),
    )
    same(said(document), said(found), 1e-4)


def test_a_larger_world(original: Path, found: dict[str, Any], tmp_path: Path) -> None:
    document = again(
        original,
        tmp_path / "session",
        robot=lambda t: vectors(t, "xyz", lambda p: [2.0 * x for x in p], "origin"),
        points=lambda t: points_moved(t, lambda p: 2.0 * p),
        session=lambda t: t.replace("point_std = 0.0003", "point_std = 0.0006"),
    )
    (cause,), (before,) = document["causes"], found["causes"]
    assert (cause["effect"], cause["at"]) == (before["effect"], before["at"])
    value = cause["parameters"]["offset_rad"]["value"]
    assert value == pytest.approx(before["parameters"]["offset_rad"]["value"], rel=0.01)
    assert document["gap"]["before_m"] == pytest.approx(2.0 * found["gap"]["before_m"], rel=0.01)
    assert document["verdict"] == found["verdict"]


def test_units_of_time(original: Path, found: dict[str, Any], tmp_path: Path) -> None:
    def milliseconds(text: str) -> str:
        rows = list(csv.reader(text.splitlines()))
        k = rows[0].index("time_s")
        for row in rows[1:]:
            row[k] = repr(1000.0 * float(row[k]))
        return "\n".join(map(",".join, rows)) + "\n"

    same(said(again(original, tmp_path / "session", frames=milliseconds)), said(found), 1e-6)


def test_numbers_of_threads(original: Path, found: dict[str, Any]) -> None:
    code = "import sys; from mirror_posture.diagnosis import diagnose; print(diagnose(sys.argv[1]).to_json())"
    for threads in ("1", "3"):
        text = subprocess.run(
            [sys.executable, "-c", code, str(original)],
            env={**os.environ, "RAYON_NUM_THREADS": threads},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        assert json.loads(text) == found
