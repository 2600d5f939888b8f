"""A coupling is no marker on another link: with small errors alone to compare with, the marker's other link was told at 0.99, and five causes beside it."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("mujoco", reason="the session is made by mirror_lab")

from mirror_lab.blind import make
from mirror_lab.blind.simulate import Options
from mirror_posture.diagnosis import diagnose

SEED, NUMBER = 28112603, 5
"""A sealed session that was misjudged: the squares of a UR10's board, and its wrist's last joint that drives its shoulder."""
TRUTH = {("board_scale", "board"), ("joint_coupling", "joint:shoulder_lift_joint<-joint:wrist_3_joint")}


def test_a_coupling_is_no_marker_on_another_link(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # What the data can show is not asked here.
    monkeypatch.setattr(make, "judge", lambda case, *others: {})
    (tmp_path / "answers").mkdir()
    job = make._Job(tmp_path, NUMBER, SEED, Options(), None)
    found = diagnose(tmp_path / make._make(job)).document
    assert {(c["effect"], c["at"]) for c in found["causes"]} == TRUTH, found["trace"]
    assert found["verdict"] == "explained"
