"""Causes in the simulator's model against the laws that the diagnosis fits: frames, nested mounts, several causes at one place."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import mirror_posture as mp
from mirror_posture.diagnosis.parts import Cause, Member
from mirror_posture.rotations import pose_of
from session_folder import URDF, replaced
from test_simulate_models import SERVOS, cause, executed, model_of, session_of

mujoco = pytest.importorskip("mujoco")

MOVED = {"rx_rad": 0.02, "ry_rad": -0.03, "rz_rad": 0.01, "dx_m": 0.003, "dy_m": -0.002, "dz_m": 0.001}
POSE = pose_of(np.array([0.02, -0.03, 0.01]), np.array([0.003, -0.002, 0.001]))
HEAVY = (
    '<inertial><mass value="1"/><origin xyz="0 0 -.05"/>'
    '<inertia ixx=".001" iyy=".001" izz=".001" ixy="0" ixz="0" iyz="0"/></inertial>'
)


def flange(turned: str) -> str:
    """The arm with a tool turned against the link that carries it, and the hand's marker, turned too, on the tool."""
    urdf = replaced(URDF, '<link name="hand_marker"/>', '<link name="hand_marker"/><link name="tool"/>')
    urdf = replaced(
        urdf,
        '<parent link="lower"/><child link="hand_marker"/><origin xyz="0 0 -0.1"/>',
        f'<parent link="tool"/><child link="hand_marker"/><origin xyz="0 0 0" rpy="{turned}"/>',
    )
    return replaced(
        urdf,
        '<joint name="elbow_mount"',
        '<joint name="flange" type="fixed"><parent link="lower"/><child link="tool"/>'
        '<origin xyz="0 0 -0.1" rpy="0.4 -0.3 1.5"/></joint><joint name="elbow_mount"',
    )


@pytest.mark.parametrize("own", [False, True], ids=["urdf", "own model without the tool"])
def test_a_marker_moves_in_the_frame_of_its_mount(tmp_path: Path, own: bool) -> None:
    """Before, in a model without the tool: in the frame of the moving body, turned by the flange."""
    session = session_of(tmp_path / "session", flange("0.5 0.6 -0.7"))
    model = model_of(tmp_path) if own else None
    shift = np.array([0.003, -0.001, 0.002])
    values = dict(zip(("dx_m", "dy_m", "dz_m"), shift.tolist(), strict=True))
    _, before = executed(session, model)
    _, after = executed(session, model, cause("marker_mount", "marker:hand", **values))
    moved = (after.root_from_link["hand_marker"] - before.root_from_link["hand_marker"])[:, :3, 3]
    poses = session.robot.link_poses(session.positions, ["base", "tool"])
    root_from_tool = np.linalg.inv(poses[:, 0]) @ poses[:, 1]
    assert np.allclose(moved, root_from_tool[:, :3, :3] @ shift, atol=1e-6)


def test_a_marker_on_a_limb_itself_does_not_take_the_limb_along(tmp_path: Path) -> None:
    """Before: the elbow's axis moved with the marker, and the hand with both."""
    urdf = replaced(
        URDF, '<parent link="upper"/><child link="elbow_marker"/>', '<parent link="upper"/><child link="x"/>'
    )
    urdf = replaced(urdf, '<link name="elbow_marker"/>', '<link name="x"/>')
    folder = session_of(tmp_path / "first").folder
    (folder / "robot.urdf").write_text(urdf)
    text = (folder / "session.toml").read_text()
    (folder / "session.toml").write_text(replaced(text, 'link = "elbow_marker"', 'link = "lower"'))
    session = mp.load_session(folder)
    _, before = executed(session, None)
    _, after = executed(
        session, None, cause("marker_mount", "marker:elbow_ball", dx_m=0.0, dy_m=0.004, dz_m=0.0)
    )
    hand, ball = (
        (after.root_from_link[link] - before.root_from_link[link])[:, :3, 3]
        for link in ("hand_marker", "lower")
    )
    assert np.allclose(hand, 0.0, atol=1e-6) and np.allclose(ball, [0.0, 0.004, 0.0], atol=1e-6)


NESTED = {
    "beside": ("base", "base"),
    "camera on board": ("chest_board", "base"),
    "board on camera": ("base", "camera_optical"),
}


@pytest.mark.parametrize("nested", NESTED)
@pytest.mark.parametrize(
    "effects", [("board_mount",), ("camera_mount",), ("camera_mount", "board_mount")], ids="+".join
)
def test_a_mount_moves_what_it_says_and_nothing_that_rides_on_it(
    tmp_path: Path, nested: str, effects: tuple[str, ...]
) -> None:
    """Before: a camera on the board's link moved twice with the board, a board on the camera's link with the camera."""
    under_camera, under_board = NESTED[nested]
    urdf = replaced(
        URDF,
        '<parent link="base"/><child link="camera_optical"/>',
        f'<parent link="{under_camera}"/><child link="camera_optical"/><origin xyz="0.1 0 0" rpy="0.3 0 0.2"/>',
    )
    urdf = replaced(
        urdf,
        '<parent link="base"/><child link="chest_board"/>',
        f'<parent link="{under_board}"/><child link="chest_board"/><origin xyz="0 0.1 0" rpy="0 -0.4 0.1"/>',
    )
    session = session_of(tmp_path / "session", urdf)
    poses = session.robot.link_poses(session.positions[:1], ["base", "camera_optical", "chest_board"])[0]
    root = np.linalg.inv(poses[0])
    camera, board = root @ poses[1], root @ poses[2]
    if "board_mount" in effects:
        camera, board = board @ POSE @ np.linalg.inv(board) @ camera, board @ POSE
    if "camera_mount" in effects:
        camera = camera @ POSE
    places = {"board_mount": "board", "camera_mount": "camera"}
    _, rest = executed(session, None, *(cause(effect, places[effect], **MOVED) for effect in effects))
    assert np.allclose(rest.root_from_link["camera_optical"][0], camera, atol=1e-6)
    assert np.allclose(rest.root_from_link["chest_board"][0], board, atol=1e-6)


def test_a_camera_given_by_angles_in_a_frame_is_turned(tmp_path: Path) -> None:
    """Before: MuJoCo passed over the turn, because the file gives the camera's orientation otherwise than by a quaternion."""
    session = session_of(tmp_path / "session")
    model = model_of(
        tmp_path,
        base='<frame pos="0 0 .1" euler="0 .3 0"><site name="camera_optical" pos=".1 0 0" euler="0.1 0.2 0.3"/></frame>',
        elbow='<frame euler="0 0 1.5707963"><joint name="elbow" axis="1 0 0"/></frame>',
    )
    _, before = executed(session, model)
    _, after = executed(session, model, cause("camera_mount", "camera", **MOVED))
    told = before.root_from_link["camera_optical"] @ POSE
    assert np.allclose(after.root_from_link["camera_optical"], told, atol=1e-6)
    # A part in series with a joint has its axis, in a frame too.
    changed, _ = executed(
        session, model, cause("joint_compliance", "joint:elbow", compliance_rad_per_nm=0.01)
    )
    spring = changed.simulator.compiled().joint("elbow_spring")
    assert np.allclose(spring.axis, [0.0, 1.0, 0.0], atol=1e-6)


def _small(effect: str, at: str, parameter: str, value: float) -> Member:
    return Member(effect, at, parameter, value, 0.0)


def test_a_spring_that_is_a_cause_and_a_small_error_is_added_up(tmp_path: Path) -> None:
    """Before: "repeated name 'elbow_spring' in joint", a raw ValueError."""
    from mirror_simulation.simulate.staircase import with_causes

    urdf = replaced(URDF, '<link name="lower"/>', f'<link name="lower">{HEAVY}</link>')
    session = session_of(tmp_path / "session", urdf)
    group = Cause(
        "geometry",
        "robot",
        1.0,
        {},
        members=(
            _small("joint_compliance", "joint:elbow", "compliance_rad_per_nm", 0.02),
            _small("link_bending", "link:upper", "compliance_rad_per_nm", 0.005),
        ),
    )
    alone = [
        cause("joint_compliance", "joint:elbow", compliance_rad_per_nm=0.01),
        cause("link_bending", "link:upper", compliance_rad_per_nm=0.01),
    ]
    changed, told, both = with_causes(session, None, [*alone, group])
    model = changed.simulator.compiled()
    for name, compliance in (("elbow_spring", 0.03), ("upper_bend_1", 0.015), ("upper_bend_2", 0.015)):
        assert np.isclose(np.ravel(model.joint(name).stiffness)[0], 1.0 / compliance)
    assert told[2] == "2 small errors"
    # The same as one cause of that size.
    _, _, once = with_causes(
        session,
        None,
        [
            cause("joint_compliance", "joint:elbow", compliance_rad_per_nm=0.03),
            cause("link_bending", "link:upper", compliance_rad_per_nm=0.015),
        ],
    )
    assert np.allclose(both.root_from_link["hand_marker"], once.root_from_link["hand_marker"], atol=1e-6)
    plays = [cause("backlash", "joint:elbow", width_rad=width) for width in (0.01, 0.02)]
    changed, _, _ = with_causes(session, None, plays)
    assert np.allclose(changed.simulator.compiled().joint("elbow_play").range, [-0.015, 0.015])


def test_faults_of_a_drive_act_on_the_command_that_it_gets(tmp_path: Path) -> None:
    """Before: with two servos exchanged, each joint's gear error was a share of the other one's command."""
    session = session_of(tmp_path / "session")
    swapped = cause("joints_swapped", "joint:shoulder<->joint:elbow")
    gear = cause("gear_ratio", "joint:shoulder", scale_error=0.1)
    exchanged = session_of(
        tmp_path / "exchanged", rows="frame,posture,shoulder,elbow\n0,0,0.2,0.1\n1,1,0.4,-0.3\n"
    )
    _, told = executed(exchanged, None, gear)
    for causes in ((swapped, gear), (gear, swapped)):
        changed, rest = executed(session, None, *causes)
        assert np.allclose(rest.root_from_link["hand_marker"], told.root_from_link["hand_marker"], atol=1e-6)
        assert changed.comments


def test_what_changes_an_axis_comes_before_what_lies_along_it(tmp_path: Path) -> None:
    """Before: in the order of the report; a tilt before the axis was turned round had the sign of its second part wrong."""
    session = session_of(tmp_path / "session")
    tilt = cause("axis_tilt", "joint:elbow", tilt_1_rad=0.05, tilt_2_rad=0.03)
    sign = cause("axis_sign", "joint:elbow")
    spring = cause("joint_compliance", "joint:elbow", compliance_rad_per_nm=0.01)
    axes = []
    for causes in ((sign, tilt, spring), (spring, tilt, sign), (tilt, spring, sign)):
        changed, _ = executed(session, None, *causes)
        model = changed.simulator.compiled()
        assert np.allclose(model.joint("elbow_spring").axis, model.joint("elbow").axis)
        axes.append(model.joint("elbow").axis.copy())
    assert np.allclose(axes, axes[0])
    # For a = -y: u = -(a x e) with e = x, so that u = z and v = a x u = -x.
    assert np.allclose(axes[0] / -axes[0][1], [-np.tan(0.03), -1.0, np.tan(0.05)], atol=1e-9)


def test_a_friction_at_a_joint_without_a_servo_is_refused(tmp_path: Path) -> None:
    """Before: StopIteration."""
    session = session_of(tmp_path / "session", rows="frame,posture,shoulder\n0,0,0.1\n1,1,-0.3\n")
    model = model_of(tmp_path, SERVOS, base='<body name="fan"><joint name="fan"/><geom size=".01"/></body>')
    with pytest.raises(mp.MirrorPostureError, match="'fan' has no servo"):
        executed(session, model, cause("stiction", "joint:fan", deadband_rad=0.01))


def test_halves_are_diagnosed_without_what_the_diagnosis_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before: `--held-out` counted the observations that the whole session's diagnosis had found to be false."""
    import mirror_simulation.simulate as package
    from mirror_simulation.simulate import held_out
    from small_arm import run

    session = session_of(tmp_path / "session")
    tree = {
        "format": "mirror-posture/diagnosis",
        "version": 2,
        "verdict": "none",
        "sentence": "",
        "causes": [],
        "where": [],
        "gap": {"before_m": 0.0, "after_m": 0.0, "noise_floor_m": 0.0},
        "data": {"left_out": [{"frame": 0, "target": "hand", "deviations": 9.0, "why": "false"}]},
    }
    (tmp_path / "diagnosis.json").write_text(json.dumps(tree))
    given: list[mp.Session] = []

    def told(session: mp.Session, model: Path | None = None) -> held_out.HeldOut:
        given.append(session)
        return held_out.HeldOut(None, None, None, None, 2, ((), ()))

    def simulated(*_: object, **__: object) -> package.Simulation:
        gap = package.SimulatedGap(1.0, 0.001, np.array([1.0, 1.0]), np.array([0.001, 0.001]), 1, 1)
        stair = package.Stair(None, "the model as it is", gap)
        return package.Simulation(Path("arm.xml"), (stair,), session.marker_names, (), "<mujoco/>")

    monkeypatch.setattr(held_out, "held_out_gap", told)
    monkeypatch.setattr(package, "simulate", simulated)
    run("simulate", session.folder, "--with", tmp_path / "diagnosis.json", "--held-out")
    assert session.mirror_view.marker_seen.any()
    assert not given[0].mirror_view.marker_seen.any() and given[0].mirror_view.board_seen.any()
