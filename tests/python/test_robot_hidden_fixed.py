"""Hidden effects on links that carry their next joint through a fixed link, and on joints with a servo of the model's own."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("mirror_lab")

from mirror_lab.robots.hidden import HiddenBody, HiddenEffect

mujoco = pytest.importorskip("mujoco")

from mirror_lab.robots.mujoco_model import ServoOptions, TrueModel, build, frame_of  # noqa: E402
from mirror_posture._core import MirrorPostureError  # noqa: E402

DOWN = np.array([0.0, 0.0, -9.81])
MASS = '<inertial><mass value="1"/><origin xyz="{}"/><inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial>'


def arm(mount: str) -> str:
    """An arm of two links, which reaches along x; `mount`: how the fore arm's joint hangs on the upper arm, 0.3 m out."""
    turned = 'rpy="0 0 1.5707963267948966"'
    joints = {
        "directly": '<joint name="e" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.3 0 0"/><axis xyz="0 1 0"/><limit lower="-2" upper="2"/></joint>',
        # The flange is turned: its x axis is the link's y axis.
        "fixed": f'<link name="flange"/><joint name="f" type="fixed"><parent link="upper"/><child link="flange"/><origin xyz="0.2 0 0" {turned}/></joint>'
        '<joint name="e" type="revolute"><parent link="flange"/><child link="fore"/><origin xyz="0 -0.1 0" rpy="0 0 -1.5707963267948966"/><axis xyz="0 1 0"/><limit lower="-2" upper="2"/></joint>',
    }[mount]
    return f"""<robot name="r"><link name="base"/><link name="upper">{MASS.format("0.1 0 0")}</link><link name="fore">{MASS.format("0.1 0 0")}</link>
<joint name="s" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/><limit lower="-2" upper="2"/></joint>
{joints}<link name="tip"/><joint name="t" type="fixed"><parent link="fore"/><child link="tip"/><origin xyz="0.6 0 0"/></joint></robot>"""


def _spec(urdf: str) -> mujoco.MjSpec:
    settings = '<mujoco><compiler fusestatic="false" balanceinertia="true"/></mujoco></robot>'
    return mujoco.MjSpec.from_string(urdf.replace("</robot>", settings))


def _at_rest(true: TrueModel, link: str = "tip") -> np.ndarray:
    data = mujoco.MjData(true.model)
    for _ in range(1500):
        mujoco.mj_step(true.model, data)
    return frame_of(true.model, data, link)[0]


EFFECTS = [
    HiddenEffect("link_bending", "link:upper", {"compliance_rad_per_nm": 0.01}),
    HiddenEffect("link_length", "link:upper", {"dx_m": 0.01, "dy_m": 0.02, "dz_m": -0.03}),
]


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda e: e.effect)
def test_a_fixed_link_before_the_next_joint_changes_nothing(effect: HiddenEffect) -> None:
    """Before: the link bent about the flange's mean with the fore arm's ends, and had no joint to displace."""
    tips = {}
    for mount in ("directly", "fixed"):
        plain, changed = (HiddenBody(arm(mount), "base", DOWN, hidden) for hidden in ((), (effect,)))
        tips[mount] = changed.link_poses()["tip"]
        assert np.abs(tips[mount] - plain.link_poses()["tip"]).max() > 5e-3, "the effect is worth finding"
    np.testing.assert_allclose(tips["fixed"], tips["directly"], atol=1e-12)


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda e: e.effect)
def test_mujocos_body_does_as_the_plain_one(effect: HiddenEffect) -> None:
    servo = ServoOptions(droop_rad=1e-4)
    for mount in ("directly", "fixed"):
        true = build(_spec(arm(mount)), ["s", "e"], "base", DOWN, [effect], servo)
        still = HiddenBody(arm(mount), "base", DOWN, [effect]).link_poses()["tip"][:3, 3]
        np.testing.assert_allclose(_at_rest(true), still, atol=1e-3)


def test_a_link_without_a_joint_has_no_length() -> None:
    wrong = HiddenEffect("link_length", "link:fore", {"dx_m": 0.01, "dy_m": 0.0, "dz_m": 0.0})
    with pytest.raises(MirrorPostureError, match="carries no joint"):
        HiddenBody(arm("fixed"), "base", DOWN, [wrong])
    with pytest.raises(MirrorPostureError, match="carries no joint"):
        build(_spec(arm("fixed")), ["s", "e"], "base", DOWN, [wrong], ServoOptions())


MJCF = """<mujoco><worldbody><body name="base"><geom size=".05" mass="1"/><body name="arm" pos="0 0 .1">
<joint name="j" type="hinge" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".02" mass=".5"/></body></body></worldbody>{}</mujoco>"""
OWN = '<actuator><position name="p" joint="j" kp="50" kv="2"/></actuator>'


def test_a_model_with_its_own_servo_can_hide_stiction() -> None:
    """Before, the effect was dropped, and the answer told of it."""
    stiction = HiddenEffect("stiction", "joint:j", {"deadband_rad": 0.03})
    models = [
        build(mujoco.MjSpec.from_string(MJCF.format(own)), ["j"], "base", DOWN, [stiction], ServoOptions())
        for own in ("", OWN)
    ]
    for true in models:
        assert true.model.nu == 1 and true.actuator == {"j": 0}
        stiffness = float(true.model.actuator_gainprm[0, 0])
        assert float(true.model.dof_frictionloss[0]) == pytest.approx(0.03 * stiffness)
    assert models[0].model.actuator_gainprm[0, 0] == pytest.approx(models[1].model.actuator_gainprm[0, 0])
    kept = build(mujoco.MjSpec.from_string(MJCF.format(OWN)), ["j"], "base", DOWN, [], ServoOptions())
    assert float(kept.model.actuator_gainprm[0, 0]) == 50.0, "without stiction it is kept"
