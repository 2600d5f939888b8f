"""The MJCF beside a corrected session: gravity as the session has it, links that bend where the diagnosis says."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import mirror_posture as mp
from mirror_posture.diagnosis.applied import apply_diagnosis
from session_folder import URDF, replaced, write_folder
from test_apply_patch import found, settled

mujoco = pytest.importorskip("mujoco")

MASS = '<inertial><mass value="{}"/><origin xyz="0 0 -0.05"/><inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial>'
SIX_DIGITS = 1e-5
"""MuJoCo writes numbers with six digits."""
SPRING = ("joint_compliance", "joint:elbow", {"compliance_rad_per_nm": 0.01})


def heavy(text: str) -> str:
    """The small robot with masses, and motors that can hold them."""
    for link, mass in (("upper", 0.1), ("lower", 2.0)):
        text = replaced(text, f'<link name="{link}"/>', f'<link name="{link}">{MASS.format(mass)}</link>')
    return replaced(text, 'effort="1"', 'effort="900"')


def model_of(text: str, folder: Path, *causes: tuple[str, str, dict[str, float]]):
    """The written model, what was told of each cause, and the corrected session."""
    session = mp.load_session(write_folder(folder / "session", robot=text))
    applied = apply_diagnosis(session, found(*causes), folder / "better")
    told = [(entry.file, entry.what) for entry in applied.written]
    file = applied.folder / "robot.mjcf.xml"
    model = mujoco.MjModel.from_xml_path(str(file)) if file.exists() else None
    return model, told, mp.load_session(applied.folder)


def test_gravity_is_the_corrected_one(tmp_path: Path) -> None:
    """Before: the one that was found to be wrong."""
    turned = ("gravity_direction", "robot", {"rx_rad": 0.3, "ry_rad": 0.0, "rz_rad": 0.0})
    model, _, better = model_of(heavy(URDF), tmp_path, turned, SPRING)
    wanted = 9.81 * np.array([0.0, math.sin(0.3), -math.cos(0.3)])
    np.testing.assert_allclose(better.gravity_m_per_s2, wanted, atol=1e-9)
    np.testing.assert_allclose(model.opt.gravity, wanted, rtol=SIX_DIGITS)


@pytest.mark.parametrize("above", ["world", "ceiling_plate"])
def test_gravity_is_in_the_world_of_the_model(above: str, tmp_path: Path) -> None:
    """Before: a robot that hangs from the ceiling was pulled towards it."""
    text = replaced(heavy(URDF), '<link name="base"/>', f'<link name="{above}"/><link name="base"/>')
    text = replaced(
        text,
        '<joint name="shoulder"',
        f'<joint name="ceiling" type="fixed"><parent link="{above}"/><child link="base"/>'
        '<origin xyz="0 0 2" rpy="3.141592653589793 0 0.4"/></joint><joint name="shoulder"',
    )
    model, _, better = model_of(text, tmp_path, SPRING)
    np.testing.assert_allclose(better.gravity_m_per_s2, [0.0, 0.0, -9.81])
    np.testing.assert_allclose(model.opt.gravity, [0.0, 0.0, 9.81], atol=1e-9)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    base_from_world = data.xmat[model.body("base").id].reshape(3, 3).T
    np.testing.assert_allclose(base_from_world @ model.opt.gravity, [0.0, 0.0, -9.81], atol=1e-9)


def bending(link: str, compliance: float = 0.01) -> tuple[str, str, dict[str, float]]:
    return "link_bending", f"link:{link}", {"compliance_rad_per_nm": compliance}


@pytest.mark.parametrize(
    ("link", "tip"), [("upper", (0.03, 0.0, -0.1)), ("lower", (0.02, 0.01, -0.1))], ids=["upper", "lower"]
)
def test_a_link_bends_across_itself_in_its_middle(
    link: str, tip: tuple[float, float, float], tmp_path: Path
) -> None:
    """Before: across the joint's axis (so about the link itself too), and at its joint."""
    text = replaced(heavy(URDF), '<child link="lower"/><origin xyz="0 0 -0.1"/>', '<child link="lower"/><origin xyz="0.03 0 -0.1"/>')  # fmt: skip
    text = replaced(text, '<child link="hand_marker"/><origin xyz="0 0 -0.1"/>', '<child link="hand_marker"/><origin xyz="0.02 0.01 -0.1"/>')  # fmt: skip
    model, told, _ = model_of(text, tmp_path, bending(link))
    assert told == [
        ("robot.mjcf.xml", f"hinges {link}_bend_1 and {link}_bend_2 with a stiffness of 100 N m/rad")
    ]
    first, second = (model.joint(f"{link}_bend_{number}") for number in (1, 2))
    for hinge in (first, second):
        np.testing.assert_allclose(hinge.pos, 0.5 * np.array(tip), atol=1e-9)
        assert hinge.axis @ np.array(tip) == pytest.approx(0.0, abs=SIX_DIGITS)
        assert hinge.stiffness[0] == pytest.approx(100.0) and not hinge.limited[0]
    assert first.axis @ second.axis == pytest.approx(0.0, abs=SIX_DIGITS)


def test_a_bent_link_sags_as_the_law_says(tmp_path: Path) -> None:
    """`c m` about the link's middle, m the moment there of all that the link carries and of its own mass."""
    hands = []
    for name, compliance in (("stiff", 1e-7), ("soft", 0.01)):
        _, _, better = model_of(heavy(URDF), tmp_path / name, bending("upper", compliance))
        model, data = settled(mujoco, better.folder / "robot.mjcf.xml", {"shoulder": -1.2, "elbow": 0.2})
        hands.append(data.xpos[model.body("hand_marker").id].copy())
    along = lambda angle: np.array([-math.sin(angle), 0.0, -math.cos(angle)])  # noqa: E731
    middle, elbow = 0.05 * along(-1.2), 0.1 * along(-1.2)
    moment = 2.0 * 9.81 * (elbow + 0.05 * along(-1.0) - middle)[0]
    lever = elbow + 0.1 * along(-1.0) - middle
    sag = 0.01 * moment * np.array([lever[2], 0.0, -lever[0]])
    np.testing.assert_allclose(hands[1] - hands[0], sag, atol=0.05 * np.linalg.norm(sag))


def test_a_link_without_length_lies_along_the_limb_that_follows(tmp_path: Path) -> None:
    """As two joints at one place: the diagnosis takes the direction from the next link."""
    text = replaced(heavy(URDF), '<child link="lower"/><origin xyz="0 0 -0.1"/>', '<child link="lower"/>')
    model, _, _ = model_of(text, tmp_path, bending("upper"))
    for number in (1, 2):
        hinge = model.joint(f"upper_bend_{number}")
        np.testing.assert_allclose(hinge.pos, 0.0, atol=1e-12)
        assert hinge.axis[2] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("compliance", [0.0, -0.01])
def test_a_link_that_does_not_bend_is_told(compliance: float, tmp_path: Path) -> None:
    """Before: a bare ZeroDivisionError, or a spring that pushes away."""
    model, told, _ = model_of(heavy(URDF), tmp_path, bending("upper", compliance))
    assert told == [(None, "not written: a compliance that is not above 0 is no spring")]
    assert model is not None and model.njnt == 2
