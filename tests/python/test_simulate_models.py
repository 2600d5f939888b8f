"""Models of the user's that a session is executed on: which actuator gets a joint's command, and where links are found."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mirror_posture as mp
from mirror_posture.diagnosis.parts import Cause, Estimate
from session_folder import SESSION, URDF, replaced, write_folder

mujoco = pytest.importorskip("mujoco")

ROWS = "frame,posture,shoulder,elbow\n0,0,0.1,0.2\n1,1,-0.3,0.4\n"
SEEN = "frame,target,index,u,v\n0,board,0,100.5,200.25\n0,hand,0,300,310\n"
ARM = """<mujoco><compiler angle="radian"/>{first}<worldbody><body name="base">{base}<geom size=".01" mass=".1"/>
<body name="upper">{shoulder}<geom size=".02" mass=".3" pos="0 0 -.05"/>
<body name="lower" pos="0 0 -.1">{elbow}<geom size=".02" mass=".3" pos="0 0 -.05"/></body></body></body></worldbody>
{before}<actuator>{servos}</actuator>{after}</mujoco>"""
SERVOS = """<position name="ps" joint="shoulder" kp="2000" kv="20"/><position name="pe" joint="elbow" kp="2000" kv="20"/>"""
CLOSE_M = 5e-5
"""Gravity deflects the servos by a hundredth of a millimetre at the hand."""


def session_of(folder: Path, urdf: str = URDF, rows: str = ROWS) -> mp.Session:
    """A session of two still postures, without measured points."""
    session = replaced(SESSION, 'mount = "unknown"\n', "").split("[points]")[0]
    return mp.load_session(
        write_folder(folder, robot=urdf, session=session, frames=rows, detections=SEEN, points=None)
    )


def model_of(folder: Path, servos: str = SERVOS, **parts: str) -> Path:
    """The arm as an MJCF; `parts` are put in at their places."""
    told = {"first": "", "base": "", "before": "", "after": ""} | {
        name: f'<joint name="{name}" axis="0 1 0"/>' for name in ("shoulder", "elbow")
    }
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "arm.xml").write_text(ARM.format(**(told | parts), servos=servos), encoding="utf-8")
    return folder / "arm.xml"


def cause(effect: str, at: str, **values: float) -> Cause:
    """A cause of a diagnosis."""
    return Cause(effect, at, 1.0, {name: Estimate(value, 0.0) for name, value in values.items()})


def executed(session: mp.Session, model: Path | None, *causes: Cause) -> tuple[Any, Any]:
    """The simulator with causes, and where it rests."""
    from mirror_simulation.simulate.staircase import with_causes

    changed, _, rest = with_causes(session, model, causes)
    return changed, rest


def by_urdf(session: mp.Session, link: str = "hand_marker") -> np.ndarray:
    """(F, 3): where the session's URDF has a link, in the root's frame, m."""
    poses = session.robot.link_poses(session.positions, ["base", link])
    return (np.linalg.inv(poses[:, 0]) @ poses[:, 1])[:, :3, 3]


def off_m(session: mp.Session, rest: Any) -> float:
    """How far the hand rests from where the URDF has it, the farther of the two postures."""
    here = rest.root_from_link["hand_marker"][:, :3, 3]
    return float(np.linalg.norm(here - by_urdf(session), axis=1).max())


TENDON = '<tendon><fixed name="{}"><joint joint="elbow" coef="1"/></fixed></tendon>'


@pytest.mark.parametrize(
    ("before", "servos"),
    [
        ("", SERVOS + '<motor name="m" joint="shoulder"/>'),
        ("", SERVOS + '<velocity name="v" joint="elbow" kv="5"/>'),
        ("", SERVOS + '<position name="again" joint="elbow" kp="500" kv="5"/>'),
        ("", SERVOS.replace(' name="ps"', "").replace(' name="pe"', "")),
        (TENDON.format("t"), SERVOS + '<motor name="m" tendon="t"/>'),
        (TENDON.format("shoulder"), SERVOS + '<position name="m" tendon="shoulder" kp="1e-9"/>'),
        (TENDON.format("shoulder"), '<motor name="servo_elbow" tendon="shoulder"/>'),
        ("", SERVOS.replace('kp="2000"', 'kp="2000" gear="-2"')),
    ],
    ids=["motor", "velocity", "two servos", "unnamed", "tendon", "tendon's name", "taken name", "gear"],
)
def test_the_position_servo_of_a_joint_gets_its_command(tmp_path: Path, before: str, servos: str) -> None:
    """Before: the last actuator in the file with the joint's number, be it a tendon's; the hand was 20 to 58 mm off."""
    session = session_of(tmp_path / "session")
    changed, rest = executed(session, model_of(tmp_path, servos, before=before))
    assert off_m(session, rest) < CLOSE_M
    assert not [note for note in changed.simulator.notes if "different robots" in note]
    told = "joints with several position servos keep the first: elbow"
    assert (told in changed.simulator.notes) == ("again" in servos)


def test_a_motion_has_the_same_servos(tmp_path: Path) -> None:
    """Before: as for still postures; and the load of a servo with a gear was told without its gear."""
    from mirror_posture.session.types import States
    from mirror_simulation.motion.recording import Recording
    from mirror_simulation.motion.rollouts import Rollouts

    session = session_of(tmp_path / "session")
    time = np.linspace(0.0, 1.5, 40)
    told = 0.3 * np.stack([np.sin(2.0 * time), 1.0 - np.cos(3.0 * time)], axis=1)
    states = States(time, ("shoulder", "elbow"), told)
    recording = Recording(session, states, time[:, None] * np.ones((1, 2)), time)
    torque = {}
    plain = SERVOS.replace('kp="2000" kv="20"', 'kp="200" kv="2"')
    # A servo of a quarter of the gain at twice the gear does the same.
    geared = SERVOS.replace('kp="2000" kv="20"', 'kp="50" kv="0.5" gear="2"')
    for name, servos in (
        ("plain", plain),
        ("geared", geared),
        ("more", plain + '<motor name="m" joint="shoulder"/>'),
    ):
        rollouts = Rollouts(recording, model_of(tmp_path / name, servos), exact=False)
        motion = rollouts.nominal()
        assert np.abs(motion.position - rollouts.commands).max() < 0.02
        torque[name] = rollouts.servo_torque(motion)
        limited = rollouts._changed({("torque_limit", "joint:elbow"): (0.4,)})
        servo = rollouts.actuator[rollouts.joints.index("elbow")]
        assert np.isclose(limited.actuator_forcerange[servo, 1] * limited.actuator_gear[servo, 0], 0.4)
    assert np.allclose(torque["geared"], torque["plain"], atol=1e-6)
    assert np.allclose(torque["more"], torque["plain"], atol=1e-6)
    assert np.abs(torque["plain"]).max() > 0.1


def test_a_slide_in_a_model_in_degrees_is_in_metres(tmp_path: Path) -> None:
    """Before: an offset of 5 mm moved the hand by 286 mm, because MuJoCo converts hinges only."""
    urdf = replaced(URDF, '<joint name="elbow" type="continuous">', '<joint name="elbow" type="prismatic">')
    urdf = replaced(
        urdf,
        '<origin xyz="0 0 -0.1"/><axis xyz="0 1 0"/>\n',
        '<origin xyz="0 0 -0.1"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/>\n',
    )
    session = session_of(tmp_path / "session", urdf, ROWS.replace("0.2", "0.02").replace("0.4", "0.04"))
    model = model_of(tmp_path, elbow='<joint name="elbow" type="slide" axis="0 1 0"/>')
    model.write_text(model.read_text().replace("radian", "degree"))
    _, before = executed(session, model)
    changed, after = executed(session, model, cause("joint_offset", "joint:elbow", offset_rad=0.005))
    moved = (after.root_from_link["hand_marker"] - before.root_from_link["hand_marker"])[:, :3, 3]
    assert np.allclose(np.linalg.norm(moved, axis=1), 0.005, atol=2e-5)
    assert changed.comments[0][1].endswith("ref less 0.005000 m")
    changed, _ = executed(session, model, cause("backlash", "joint:elbow", width_rad=0.004))
    assert np.allclose(changed.simulator.compiled().joint("elbow_play").range, [-0.002, 0.002])
    assert "slide in series" in changed.comments[0][1] and changed.comments[0][1].endswith(" N")
    changed, _ = executed(
        session, model, cause("joint_compliance", "joint:elbow", compliance_rad_per_nm=0.01)
    )
    assert changed.comments[0][1].endswith("slide in series with elbow, stiffness 100 N/m")
    # A hinge of the same file is in degrees.
    changed, _ = executed(session, model, cause("joint_offset", "joint:shoulder", offset_rad=0.005))
    assert np.isclose(changed.simulator.compiled().joint("shoulder").qpos0[0], -0.005)


def test_a_free_base_may_have_a_keyframe(tmp_path: Path) -> None:
    """Before: "keyframe home: invalid qpos size"."""
    session = session_of(tmp_path / "session")
    after = '<keyframe><key name="home" qpos="0 0 0 1 0 0 0 0 0" ctrl="0 0"/></keyframe>'
    model = model_of(tmp_path, base="<freejoint/>", after=after)
    _, rest = executed(session, model)
    assert off_m(session, rest) < CLOSE_M


@pytest.mark.parametrize(
    "kind", ["ref", "ref of another", "follower", "another follower", "urdf", "other urdf"]
)
def test_another_robot_is_told_and_the_same_is_not(tmp_path: Path, kind: str) -> None:
    """Before: by another position than what is executed, with followers at 0, and of a URDF never."""
    urdf, rows, parts, servos = URDF, ROWS, {}, SERVOS
    if kind.startswith("ref"):
        parts = {"shoulder": '<joint name="shoulder" axis="0 1 0" ref="0.5"/>'}
    if kind.endswith("follower"):
        urdf = replaced(
            URDF,
            '<joint name="elbow" type="continuous">',
            '<joint name="elbow" type="revolute"><mimic joint="shoulder" multiplier="-1"/>'
            '<limit lower="-3" upper="3" effort="1" velocity="1"/>',
        )
        rows = "frame,posture,shoulder\n0,0,0.1\n1,1,-0.3\n"
        share = "-1" if kind == "follower" else "1"
        parts = {
            "after": f'<equality><joint joint1="elbow" joint2="shoulder" polycoef="0 {share} 0 0 0"/></equality>'
        }
        servos = '<position name="ps" joint="shoulder" kp="5000" kv="50"/>'
    session = session_of(tmp_path / "session", urdf, rows)
    model = model_of(tmp_path, servos, **parts)
    if kind == "ref":
        model.write_text(
            model.read_text().replace('<body name="upper">', '<body name="upper" euler="0 0.5 0">')
        )
    if kind.endswith("urdf"):
        model = tmp_path / "arm.urdf"
        changed = replaced(URDF, '<origin xyz="0 0 -0.1"/><axis', '<origin xyz="0.05 0 -0.2"/><axis')
        model.write_text(URDF if kind == "urdf" else changed)
    simulated, rest = executed(session, model)
    differs = kind in ("ref of another", "another follower", "other urdf")
    assert (off_m(session, rest) > 0.01) == differs
    assert bool([note for note in simulated.simulator.notes if "different robots" in note]) == differs


def test_a_joint_that_follows_another_in_a_urdf_does_not_sag(tmp_path: Path) -> None:
    """Before: by 1.6 mrad under a kilogram; `docs/simulating.md` promises 2e-5 rad of every servo."""
    urdf = replaced(
        URDF,
        '<joint name="elbow" type="continuous">',
        '<joint name="elbow" type="revolute"><mimic joint="shoulder" multiplier="-1"/>'
        '<limit lower="-3" upper="3" effort="1" velocity="1"/>',
    )
    heavy = (
        '<link name="lower"><inertial><mass value="1"/><origin xyz=".05 0 -.05"/>'
        '<inertia ixx=".001" iyy=".001" izz=".001" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )
    session = session_of(
        tmp_path / "session",
        replaced(urdf, '<link name="lower"/>', heavy),
        "frame,posture,shoulder\n0,0,0.1\n1,1,-0.3\n",
    )
    _, rest = executed(session, None)
    assert off_m(session, rest) < 0.1 * 2e-5


def test_meshes_of_the_users_model_are_found_from_the_patched_model(tmp_path: Path) -> None:
    """Before: model.xml named the mesh by a place relative to another folder, and MuJoCo refused it."""
    from mirror_simulation.simulate.staircase import _commented

    (tmp_path / "mine" / "shapes").mkdir(parents=True)
    faces = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    (tmp_path / "mine" / "shapes" / "shell.obj").write_text(faces)
    session = session_of(tmp_path / "session")
    model = model_of(
        tmp_path / "mine",
        first='<asset><mesh name="shell" file="shell.obj"/></asset>',
        base='<geom type="mesh" mesh="shell"/>',
    )
    model.write_text(model.read_text().replace('angle="radian"', 'angle="radian" meshdir="shapes"'))
    changed, _ = executed(session, model)
    out = tmp_path / "out" / "model.xml"
    out.parent.mkdir()
    out.write_text(_commented(changed))
    assert mujoco.MjModel.from_xml_path(str(out)).nmesh == 1


def test_a_simulation_that_diverges_leaves_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Before: MUJOCO_LOG.TXT in the user's working directory."""
    session = session_of(tmp_path / "session")
    wild = SERVOS.replace('kp="2000" kv="20"', 'kp="1e9"')
    model = model_of(tmp_path, wild)
    model.write_text(model.read_text().replace('mass=".3"', 'mass="1e-5"'))
    heard = mujoco.get_mju_user_warning()
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    with pytest.raises(mp.MirrorPostureError, match="diverges"):
        executed(session, model)
    assert not list((tmp_path / "here").iterdir())
    assert mujoco.get_mju_user_warning() is heard


def test_a_static_camera_that_the_model_lacks_gets_a_site(tmp_path: Path) -> None:
    """Before: an error, where the model has no body of the root's name."""
    urdf = replaced(
        URDF, '<child link="camera_optical"/>', '<child link="camera_optical"/><origin xyz="0.3 0 0.2"/>'
    )
    session = session_of(tmp_path / "session", urdf)
    model = model_of(tmp_path)
    model.write_text(model.read_text().replace('<body name="base">', '<body name="stand">'))
    changed, rest = executed(session, model)
    assert off_m(session, rest) < CLOSE_M
    assert np.allclose(rest.root_from_link["camera_optical"][0, :3, 3], [0.3, 0.0, 0.2])
    assert not [note for note in changed.simulator.notes if "different robots" in note]
