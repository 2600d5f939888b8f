"""The plan of the embedded robot."""

from __future__ import annotations

import numpy as np
import pytest

from mirror_posture import Robot
from mirror_posture.plan import PlanOptions, make_plan
from mirror_posture.render import EMBEDDED_FOLDER

mujoco = pytest.importorskip("mujoco")


def test_the_embedded_robot_on_its_stand(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mirror_posture.plan.run.DRAWN", 500)
    monkeypatch.setattr("mirror_posture.plan.run.POOL", 32)
    options = PlanOptions(
        postures=4, views=2, mirror_width_m=0.42, mirror_height_m=0.36, table_m=-0.2, same_postures=True,
        held=tuple(n for n in Robot.from_urdf(EMBEDDED_FOLDER / "robot.urdf").position_names if "shoulder" not in n and "elbow" not in n),
    )  # fmt: skip
    plan = make_plan(EMBEDDED_FOLDER, options)
    assert len(plan.view) >= 6 and len(plan.setting.joint_names) == 6
    # Each posture in both views.
    assert (np.bincount(plan.posture)[:3] == 2).all()
