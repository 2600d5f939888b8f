"""A flange twisted at assembly: gravity was named as turned by 90 degrees with 0.99, although it alone closes nothing of the gap.

Under a wrong gravity one bending link was the best single cause; the small errors everywhere that explained the rest had no more to do with it.
Without its own word the twist was these small errors, or a zero and tilts.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from mirror_posture.diagnosis import diagnose
from twisted_arm import write_twisted

TWIST_RAD = 0.026
TWIST = ("link_twist", "link:l3")
GRAVITY = "gravity_direction"


@pytest.mark.parametrize(("seed", "sign"), [(10, -1.0), (14, -1.0), (23, 1.0), (28, 1.0)])
def test_a_twisted_flange_turns_no_gravity(seed: int, sign: float, tmp_path: Path) -> None:
    found = diagnose(write_twisted(tmp_path / "session", seed, (0.0, 0.0, sign * TWIST_RAD)))
    assert found.verdict == "explained"
    assert [(cause.effect, cause.at) for cause in found.causes] == [TWIST], found.sentence


def test_without_its_word_its_pieces_are_named_and_gravity_is_not(tmp_path: Path) -> None:
    folder = write_twisted(tmp_path / "session", 19, (0.0, 0.0, TWIST_RAD))
    found = diagnose(folder, without=[TWIST[0]])
    assert found.causes and all(cause.effect != GRAVITY for cause in found.causes), found.sentence
    assert [(cause.effect, cause.at) for cause in diagnose(folder).causes] == [TWIST]


@pytest.mark.parametrize(("stated", "twist_rad"), [(9.81, 0.0), (-9.81, 0.0), (-9.81, TWIST_RAD)])
def test_a_spring_shows_gravity_upside_down_and_no_twist_does(
    stated: float, twist_rad: float, tmp_path: Path
) -> None:
    folder = write_twisted(
        tmp_path / "session", 31, (0.0, 0.0, twist_rad), spring=("j2", 0.004), stated_m_per_s2=stated
    )
    named = {f"{cause.effect}@{cause.at}" for cause in diagnose(folder).causes}
    assert "joint_compliance@joint:j2" in named
    assert (f"{GRAVITY}@robot" in named) == (stated > 0.0)
