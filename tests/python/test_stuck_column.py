"""A column that stands still over most rows, of a body that was measured in a frame which nobody told."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the tracked session is made with mirror_lab's robots")

from mirror_posture.diagnosis import diagnose
from tracked_session import write_tracked

FIRST = 30


def test_the_rows_before_tell_where_the_frame_is(tmp_path: Path) -> None:
    folder = write_tracked(tmp_path / "session", 5)
    text = (folder / "session.toml").read_text(encoding="utf-8")
    (folder / "session.toml").write_text(
        text.replace('"base_link"\n\n[noise', '"unknown"\n\n[noise'), "utf-8"
    )
    head, *rows = csv.reader((folder / "frames.csv").read_text(encoding="utf-8").splitlines())
    k = head.index("r_elbow")
    for row in rows[FIRST:]:
        row[k] = rows[FIRST - 1][k]
    (folder / "frames.csv").write_text("\n".join(map(",".join, [head, *rows])) + "\n", encoding="utf-8")

    turn = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    head, *points = csv.reader((folder / "points.csv").read_text(encoding="utf-8").splitlines())
    for row in points:
        row[2:] = [repr(float(x)) for x in turn @ np.array(row[2:], float) + [3.0, -2.0, 1.0]]
    (folder / "points.csv").write_text("\n".join(map(",".join, [head, *points])) + "\n", encoding="utf-8")

    found = diagnose(folder).document
    causes = [(c["effect"], c["at"]) for c in found["causes"]]
    assert causes == [("joint_frozen", "joint:r_elbow")], found["trace"]
    first = found["causes"][0]["parameters"]["first_frame"]["value"]
    assert abs(first - FIRST) <= 3
