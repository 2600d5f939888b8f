"""The postures that a plan chooses, against others of the same pool."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from draws import draws
from mirror_posture.plan import PlanOptions, make_plan
from small_arm import setup

pytest.importorskip("mujoco")
ROBOTS = ("gear_ratio", "gear_eccentricity", "backlash", "joint_compliance", "axis_tilt", "drift")


def test_the_postures_chosen_tell_more_than_any_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mirror_posture.plan.run.DRAWN", 2500)
    monkeypatch.setattr("mirror_posture.plan.run.POOL", 80)
    folder = setup(tmp_path)
    options = PlanOptions(mirror_width_m=0.5, mirror_height_m=0.5, postures=12)

    def sizes() -> float:
        told = make_plan(folder, options).tells
        found = [
            s for one in told if one.effect in ROBOTS for s in one.parameters.values() if math.isfinite(s)
        ]
        assert len(found) > 20
        return float(np.mean(np.log(found)))

    chosen = sizes()
    chance = np.random.default_rng(0)

    def any_others(setting, candidates, mirrors, blocks, same, random) -> list[list[int]]:
        return [
            chance.permutation(np.flatnonzero(candidates.view == view))[:count].tolist()
            for view, count in enumerate(blocks)
        ]

    monkeypatch.setattr("mirror_posture.plan.run.choose", any_others)
    others = [sizes() for _ in draws(2, range(3))]
    # A factor of 1.1 in every size: a fifth fewer pictures for the same.
    assert chosen < min(others) - math.log(1.1), (chosen, others)
