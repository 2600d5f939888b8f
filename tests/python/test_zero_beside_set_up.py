"""A wrong zero that a set-up by hand makes up for: the fit of it used to stop where every observation looked false, and a tilted axis was told."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("mujoco", reason="the session is made by mirror_lab")

from mirror_lab.blind import make
from mirror_lab.blind.simulate import Options
from mirror_posture.diagnosis import diagnose

SEED, NUMBER = 81811, 32
"""A sealed session that was misjudged: a zero of a4 off by 49 mrad beside a gear of a3 and a curved mirror."""


def test_a_zero_is_no_tilted_axis_and_coupling(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # What the data can show is not asked here.
    monkeypatch.setattr(make, "judge_by_hand", lambda case, mounting: {})
    (tmp_path / "answers").mkdir()
    job = make._Job(tmp_path, NUMBER, SEED, Options(by_hand=True, outside_share=0.0), None)
    found = diagnose(tmp_path / make._make(job)).document
    told = {
        (c["effect"], c["at"]) for c in found["causes"] if c["kind"] != "setup" and c["effect"] != "geometry"
    }
    assert ("joint_offset", "joint:a4") in told, found["trace"]
    assert {at for _, at in told} == {"joint:a4", "joint:a3", "mirror"}
