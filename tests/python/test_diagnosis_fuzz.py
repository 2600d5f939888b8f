"""Fuzz target of diagnosis.json: a mangled document loads, or is refused with one line; what loads can be told."""

from __future__ import annotations

import json
import os
import random
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("mujoco", reason="the tracked session needs mirror_lab's robots")

from mirror_posture import MirrorPostureError
from mirror_posture.diagnosis import diagnose
from mirror_posture.diagnosis.formatting import next_step, tell_all
from mirror_posture.diagnosis.result import Diagnosis
from mirror_posture.output_files import MIXED
from tracked_session import write_tracked

ODD: list[Any] = [None, "", "x", -1, 0, 1e308, 10**400, True, [], {}, [[1]], {"a": 1}, "joint:", "\0"]


@pytest.fixture(scope="module")
def document(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("tracked") / "session"
    return diagnose(write_tracked(folder, 3, lambda q: {**q, "r_elbow": q["r_elbow"] + 0.02})).to_json()


def places(tree: Any) -> list[tuple[Any, Any]]:
    """Every container of a tree with each of its keys."""
    items = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    return [found for key, value in items for found in [(tree, key), *places(value)]]


@pytest.mark.filterwarnings("ignore")
def test_mangled_documents(document: str, tmp_path: Path) -> None:
    chance, file = random.Random(5), tmp_path / "diagnosis.json"
    ends = {"loaded": 0, "refused": 0}
    # The panels' points are most of the document, and alike.
    tree = json.loads(document)
    for name in ("signatures", "tracks", "fields"):
        for panel in tree.get(name, []):
            panel["points"] = panel["points"][:2]
    short = json.dumps(tree)
    for _ in range(250):
        tree = json.loads(short)
        for _ in range(chance.choice([1, 1, 2])):
            owner, key = chance.choice(places(tree))
            if chance.random() < 0.2 and isinstance(owner, dict):
                owner.pop(key)
            else:
                owner[key] = chance.choice(ODD)
        text = json.dumps(tree)
        file.write_text(
            text[: chance.randrange(len(text))] if chance.random() < 0.1 else text, encoding="utf-8"
        )
        try:
            found = Diagnosis.load(file)
        except MirrorPostureError as error:
            assert "\n" not in str(error) and "diagnosis.json" in str(error)
            ends["refused"] += 1
            continue
        next_step(found)
        for cause in found.causes:
            tell_all(cause)
        ends["loaded"] += 1
    assert min(ends.values()) > 20, ends


def test_hostile_files(document: str, tmp_path: Path) -> None:
    file = tmp_path / "diagnosis.json"
    file.write_text("[" * 100_000)
    with pytest.raises(MirrorPostureError, match="cannot be read as JSON"):
        Diagnosis.load(file)
    file.unlink()
    os.mkfifo(file)
    with pytest.raises(MirrorPostureError, match="no regular file"):
        Diagnosis.load(file)
    file.unlink()
    file.write_text(document, encoding="utf-8")
    assert Diagnosis.load(tmp_path).to_json() == document
    (tmp_path / MIXED).touch()
    with pytest.raises(MirrorPostureError, match="was cut off"):
        Diagnosis.load(tmp_path)
