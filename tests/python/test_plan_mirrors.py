"""How a planned mirror is turned, also where the robot looks steeply down at it: the angles are those that were asked for."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from mirror_posture import MirrorPostureError
from mirror_posture.plan.options import PlanOptions, turned_mirrors
from mirror_posture.plan.simple import mirrors_before
from mirror_posture.robots import Nominal
from small_arm import MOUNTS, URDF, run

UP = np.array([0.0, 0.0, 1.0])


def steep(degrees: float) -> np.ndarray:
    return np.array([math.cos(math.radians(degrees)), 0.0, -math.sin(math.radians(degrees))])


@pytest.mark.parametrize("down_deg", [0.0, 55.0, 80.0])
def test_mirrors_are_turned_by_what_they_say(down_deg: float) -> None:
    forward = steep(down_deg)
    for mirror in turned_mirrors(PlanOptions(), np.zeros(3), forward, UP):
        normal = mirror.normal_in_root
        assert np.linalg.norm(normal) == pytest.approx(1.0)
        assert np.linalg.norm(mirror.up_in_root) == pytest.approx(1.0)
        assert mirror.up_in_root @ normal == pytest.approx(0.0, abs=1e-12)
        cosine = math.cos(mirror.yaw_rad) * math.cos(mirror.pitch_rad)
        assert normal @ forward == pytest.approx(cosine)


def looking(down_deg: float, folder: Path, *more: str) -> Nominal:
    """The small arm with camera and board that look down by an angle."""
    (folder / "arm.urdf").write_text(URDF)
    looks = ",".join(str(part) for part in steep(down_deg))
    mounts = [looks if word == "1,0,-0.2" else word for word in MOUNTS]
    run("init", folder / "arm.urdf", folder / "session", *mounts, "--board-faces", looks, *more)
    return Nominal.load(folder / "session")


@pytest.mark.parametrize("down_deg", [10.0, 60.0])
def test_a_mirror_without_a_plan_is_turned_by_its_yaw(down_deg: float, tmp_path: Path) -> None:
    yaws_rad = [0.0, math.radians(30.0), math.radians(-10.0)]
    straight, *turned = mirrors_before(looking(down_deg, tmp_path), PlanOptions(), yaws_rad, 0.5)
    for mirror, yaw_rad in zip(turned, yaws_rad[1:], strict=True):
        assert np.linalg.norm(mirror.normal_in_root) == pytest.approx(1.0)
        assert math.acos(mirror.normal_in_root @ straight.normal_in_root) == pytest.approx(abs(yaw_rad))
        np.testing.assert_allclose(mirror.center_in_root_m, straight.center_in_root_m)


def test_a_robot_that_looks_straight_down_is_refused(tmp_path: Path) -> None:
    """Before, every number of its mirrors was none, and a plan blamed the balls."""
    nominal = looking(90.0, tmp_path, "--camera-up", "1,0,0", "--board-up", "1,0,0")
    with pytest.raises(MirrorPostureError, match="look straight down; needed a way to one side"):
        mirrors_before(nominal, PlanOptions(), [0.0], 0.5)
