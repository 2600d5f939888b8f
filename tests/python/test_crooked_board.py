"""A board that is mounted crooked by some degrees in its own plane: no mirror brings its corners near where the model has them, and
sharp pictures show each of them tens of deviations away.

The body that is seen is that of the simulated robots, which share nothing with the core.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest

pytest.importorskip("mujoco", reason="the mirrored session needs mirror_lab's robots")

from scipy.spatial.transform import Rotation

from mirror_posture.diagnosis import diagnose
from mirrored_session import write_mirrored


def turned_about_its_normal(urdf: str, angle_rad: float) -> str:
    """The board's link turned about its own z axis."""
    joint = re.search(r'<joint name="chest_board_mount".*?</joint>', urdf, re.DOTALL)
    assert joint
    rpy = re.search(r'rpy="([^"]*)"', joint.group())
    assert rpy
    nominal = Rotation.from_euler("xyz", [float(x) for x in rpy.group(1).split()])
    turned = (nominal * Rotation.from_rotvec([0.0, 0.0, angle_rad])).as_euler("xyz")
    told = " ".join(repr(float(x)) for x in turned)
    return urdf.replace(joint.group(), joint.group().replace(rpy.group(), f'rpy="{told}"'))


@pytest.mark.parametrize("angle_deg", [2.0, 5.0, -9.0])
def test_a_board_turned_in_its_own_plane_is_a_board_mounted_elsewhere(
    tmp_path: Path, angle_deg: float
) -> None:
    angle = math.radians(angle_deg)
    folder = write_mirrored(tmp_path / "s", 5, built=lambda urdf: turned_about_its_normal(urdf, angle))
    found = diagnose(folder)
    assert {f"{c.effect}@{c.at}" for c in found.causes if c.probability >= 0.5} == {"board_mount@board"}, (
        found.sentence
    )
    mount = found.causes[0].parameters
    for name in ("rx_rad", "ry_rad", "rz_rad"):
        truth = angle if name == "rz_rad" else 0.0
        assert abs(mount[name].value - truth) < 5 * mount[name].std, (name, mount[name])
    assert found.verdict == "explained", found.sentence
    assert not any("flat" in warning for warning in found.warnings), found.warnings
