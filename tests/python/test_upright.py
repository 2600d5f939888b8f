"""Bindings of directions: which way is up on a link, and how far two sets of directions differ."""

from __future__ import annotations

import numpy as np
import pytest

from mirror_posture._core import MirrorPostureError, Robot, rms_angles

STONE = """<robot name="stone"><link name="base"/><link name="top"/>
<joint name="glue" type="fixed"><parent link="base"/><child link="top"/></joint></robot>"""


def test_directions_of_different_number_are_refused() -> None:
    some = np.eye(3)[[0, 1, 2, 0, 1]]
    for fewer in (some[:3], some[:0]):
        with pytest.raises(MirrorPostureError, match=f"got {len(fewer)}, needed 5"):
            rms_angles(some, fewer)
    assert rms_angles(some, some) == pytest.approx((0.0, 0.0), abs=1e-7)
    none = rms_angles(some[:0], some[:0])
    assert none == (0.0, 0.0) and not np.signbit(none).any()


def test_a_robot_without_joints_has_the_same_up_in_every_posture() -> None:
    up = Robot.from_urdf_str(STONE).up_in_link(np.zeros((2, 0)), "top", [0.0, 0.0, -9.81], "base", [])
    np.testing.assert_allclose(up, [[0.0, 0.0, 1.0]] * 2)
