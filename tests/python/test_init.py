"""A session from nothing: mounts where a person said, judged by MuJoCo and Pinocchio; bad words refused."""

from __future__ import annotations

import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
import tomllib
from typer.testing import CliRunner

from mirror_posture import MirrorPostureError, Robot, cli, load_session
from mirror_posture.mirror import Mirror
from mirror_posture.new_session import CameraMount, FaceMount, parse_marker, parse_vector
from mirror_posture.new_session.from_mjcf import urdf_from_mjcf
from mirror_posture.plan.options import PlanOptions
from mirror_posture.shapes.of_links import mesh_file, shapes_of_links

ARM = """<?xml version="1.0"?>
<!-- a licence -->
<robot name="arm">
  <link name="base"><visual><geometry><box size="0.1 0.1 0.05"/></geometry></visual></link>
  <link name="upper"><visual><geometry><mesh filename="package://arm_description/meshes/upper.stl"/></geometry></visual></link>
  <joint name="pan" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0.05"/>
    <axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
</robot>
"""
WORDS = [
    "--camera", "base", "--camera-at", "0.1,0.02,0.3", "--board", "base", "--board-at", "0.12,0,0.1",
    "--marker", "hand=upper@0.2,0,0.01", "--tolerance-mm", "4",
]  # fmt: skip


def run(*arguments: object, code: int = 0, **options):
    result = CliRunner().invoke(cli.app, [str(argument) for argument in arguments], **options)
    assert result.exit_code == code, f"{result.exit_code}: {result.output}\n{result.exception!r}"
    return result


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    file = tmp_path / "arm_description" / "urdf" / "arm.urdf"
    file.parent.mkdir(parents=True)
    file.write_text(ARM)
    return file


def test_a_file_that_is_missing_is_told_before_anything_is_asked(tmp_path: Path) -> None:
    result = run("init", tmp_path / "nosuch.urdf", tmp_path / "s", "--camera", "a", code=1, input="b\n")
    assert "nosuch.urdf: there is no such file" in " ".join(result.stderr.split())
    assert "Link that carries" not in result.output + result.stderr


def test_a_session_from_a_urdf(arm: Path, tmp_path: Path) -> None:
    folder = tmp_path / "session"
    told = json.loads(run("init", arm, folder, *WORDS, "--json").stdout)
    assert told["joints"] == ["pan"] and told["warnings"] == []
    assert told["meshes_not_drawn"] == ["package://arm_description/meshes/upper.stl"]
    # The user's own lines are there to the letter.
    assert (folder / "robot.urdf").read_text().startswith(ARM[: ARM.index("</robot>")])
    tree = tomllib.loads((folder / "session.toml").read_text())
    assert tree["board"]["tolerance_m"] == tree["markers"][0]["tolerance_m"] == pytest.approx(0.004)
    picture = cv2.imread(str(folder / "setup.png"))
    assert picture is not None and picture.shape[1] > 1000 and picture.std() > 5
    # With a row of frames and something seen it is a session without a word of warning.
    (folder / "frames.csv").write_text("frame,posture,pan\n0,0,0.1\n")
    (folder / "detections.csv").write_text("frame,target,index,u,v\n0,hand,0,640,360\n")
    session = load_session(folder)
    assert session.warnings == ()
    pose = session.robot.link_poses(
        np.zeros((1, 1)), ["session_camera_optical", "session_board", "hand_marker"]
    )[0]
    np.testing.assert_allclose(pose[0][:3, 3], [0.1, 0.02, 0.3], atol=1e-12)
    # Optical frame: z forward (x of the link), x right (its -y), y down (its -z). Board: z out, y up.
    np.testing.assert_allclose(pose[0][:3, :3], [[0, 0, 1], [-1, 0, 0], [0, -1, 0]], atol=1e-10)
    np.testing.assert_allclose(pose[1][:3, :3], [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=1e-10)
    np.testing.assert_allclose(pose[2][:3, 3], [0.2, 0.0, 0.06], atol=1e-12)


def test_a_beginning_is_written_anew_and_a_recording_is_not(
    arm: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mirror_posture.new_session.draw_setup", lambda part, file: [])
    folder = tmp_path / "session"
    run("init", arm, folder, *WORDS)
    (folder / "plan").mkdir()
    (folder / "plan" / "plan.json").write_text("{}")
    assert "--overwrite" in run("init", arm, folder, *WORDS, code=1).stderr
    # A board that is larger than a desk's printer prints.
    run("init", arm, folder, *WORDS, "--overwrite", "--ball-mm", "40", "--up", "0,0,-2", "--square-mm", "60")
    assert tomllib.loads((folder / "session.toml").read_text())["gravity"] == [0.0, 0.0, 9.81]
    assert "--up" in run("init", arm, folder, *WORDS, "--overwrite", "--up", "0,0,0", code=1).stderr
    assert tomllib.loads((folder / "session.toml").read_text())["markers"][0]["diameter"] == pytest.approx(
        0.04
    )
    assert (folder / "plan" / "plan.json").is_file()
    (folder / "frames.csv").write_text("frame,posture,pan\n0,0,0.0\n")
    before = (folder / "session.toml").read_bytes()
    assert "with frames.csv" in run("init", arm, folder, *WORDS, "--overwrite", code=1).stderr
    assert (folder / "session.toml").read_bytes() == before


@pytest.mark.parametrize(
    ("end", "kept"),
    [
        ("</robot >", "</robot >"),
        ("</robot>\n<!-- more than </robot> ends here -->", "<!-- more than </robot> ends here -->"),
        ("<!-- ä --></robot\n>", "</robot\n>"),
    ],
)
def test_mounts_stand_before_the_roots_own_end(arm: Path, tmp_path: Path, end: str, kept: str) -> None:
    """Before: "substring not found", and links after the end of the robot."""
    arm.write_text(ARM.replace("</robot>", end), encoding="utf-8")
    run("init", arm, tmp_path / "s", *WORDS)
    assert kept in (tmp_path / "s/robot.urdf").read_text(encoding="utf-8")
    assert "hand_marker" in Robot.from_urdf(tmp_path / "s/robot.urdf").link_names


def test_a_session_from_xacro(arm: Path, tmp_path: Path) -> None:
    pytest.importorskip("xacro")
    file = tmp_path / "arm.xacro"
    text = arm.read_text().replace("<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" ', 1)
    assert '"base"' in text
    file.write_text(text.replace('"base"', '"$(arg prefix)base"'))
    assert "substitution argument" in run("init", file, tmp_path / "s", *WORDS, code=1).stderr
    run("init", file, tmp_path / "s", *WORDS, "--xacro-arg", "prefix:=")
    assert 'link name="base"' in (tmp_path / "s" / "robot.urdf").read_text()


def test_what_is_left_out_is_asked_for(arm: Path, tmp_path: Path) -> None:
    answers = "base\nbase\nhand=upper@0.2,0,0 wrist=upper@0.1,0,0\n"
    run("init", arm, tmp_path / "s", "--camera-at", "0,0,0.3", "--board-at", "0,0,0.1", input=answers)
    tree = tomllib.loads((tmp_path / "s" / "session.toml").read_text())
    assert [marker["name"] for marker in tree["markers"]] == ["hand", "wrist"]
    assert tree["markers"][1]["color"]["hue"] == 180.0


def test_places_are_asked_for_with_their_links(arm: Path, tmp_path: Path) -> None:
    answers = "base\n0,0,0.3\n1,0,-0.2\nbase\n0,0,0.1\n\nhand=upper@0.2,0,0\n"
    run("init", arm, tmp_path / "asked", input=answers)
    words = [
        "--camera",
        "base",
        "--camera-at",
        "0,0,0.3",
        "--camera-looks",
        "1,0,-0.2",
        "--board",
        "base",
        "--board-at",
        "0,0,0.1",
    ]
    run("init", arm, tmp_path / "told", *words, "--marker", "hand=upper@0.2,0,0")
    for name in ("robot.urdf", "session.toml", "camera.yaml"):
        assert (tmp_path / "asked" / name).read_bytes() == (tmp_path / "told" / name).read_bytes()


def test_a_board_that_looks_away_is_told(arm: Path, tmp_path: Path) -> None:
    assert "180° apart" in run("init", arm, tmp_path / "s", *WORDS, "--board-faces=-1,0,0").stderr


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--mirror-size", "4x8"], "a mirror of 4 x 8 cm is too small to show the board of 16 x 10 cm whole"),
        (["--mirror-size", "400x600"], "a mirror of 400 x 600 cm is larger than 3 m: is --mirror-size in mm? It needs cm"),
        (["--camera-at=-5,12,25"], "the camera is 28.2 m from the root"),
        (["--marker", "palm=upper@13,0,2"], "marker palm is 13.2 m from the root, of a robot that reaches 0.05 m"),
        (["--mirror-at", "100,20,30"], "the mirror's centre is 106 m from the root"),
    ],
)  # fmt: skip
def test_sizes_and_places_in_another_unit_are_told(
    words: list[str], told: str, arm: Path, tmp_path: Path
) -> None:
    """Before, not a word."""
    warned = run("init", arm, tmp_path / "s", *WORDS, "--square-mm", "20", *words).stderr
    assert f"warning: {told}" in warned
    assert warned.count("warning: ") == 2, "one for the guessed camera file, and this one"


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (["--camera", "head"], "no link 'head'; it has base, upper"),
        (["--marker", "hand"], "NAME=LINK@X,Y,Z"),
        (["--marker", "hand=upper@0,0"], "X,Y,Z"),
        (["--marker", "hand=upper@0,0,0"], "is there already"),
        (["--camera-up", "1,0,0"], "parallel"),
        (["--board-faces", "0,0,0"], "a direction"),
        (["--corners", "7x5"], "one odd and one even"),
        (["--camera-at", "nan,0,0"], "finite"),
        (["--picture", "wide"], "two whole numbers"),
        (["--ball-mm", "0"], "needed 1 to below 500 mm\n"),
        (["--ball-mm", "0.02"], "needed 1 to below 500 mm: is it in another unit?"),
        (["--glass-mm", "400"], "--glass-mm: got 400, needed 0 to below 50 mm"),
        (["--glass-mm", "0.004"], "or 0.1 mm and more: is it in m?"),
        (["--tolerance-deg", "400"], "needed 0 to below 180 degrees"),
        (
            ["--mirror-size", "0.6x0.8"],
            "a mirror of 6 x 8 mm; needed WIDTHxHEIGHT in cm, each from 2 to below 1000",
        ),
        (["--mirror-size", "4000x6000"], "is it in mm?"),
        (["--focal-px", "4"], "camera.yaml: camera_matrix: got fx = 4 px"),
        (["--picture", "2x2"], "needed at least 16 px a side"),
        (["--package", "x=/nowhere-at-all"], "NAME=FOLDER"),
    ],
)
def test_bad_words_are_refused_and_leave_nothing(
    words: list[str], problem: str, arm: Path, tmp_path: Path
) -> None:
    result = run("init", arm, tmp_path / "s", *WORDS, *words, code=1)
    assert problem in result.stderr
    assert not (tmp_path / "s").exists()


def test_files_that_are_no_robots_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "x.urdf"
    for text, problem in (
        ("<sdf/>", "needed a URDF"),
        ("<robot", "no XML"),
        (
            '<robot xmlns:xacro="http://x" name="a"><xacro:arm/><link name="a"/></robot>',
            "unknown macro name: xacro:arm",
        ),
    ):
        file.write_text(text)
        assert problem in run("init", file, tmp_path / "s", *WORDS, code=1).stderr


def test_directions_need_not_be_square_and_places_are_three_numbers() -> None:
    tilted = CameraMount("head", (0, 0, 0), (1.0, 0.0, -1.0), (0.0, 0.0, 1.0)).link_from_mount()
    np.testing.assert_allclose(tilted[:3, :3] @ tilted[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(tilted[:3, :3]) == pytest.approx(1.0)
    np.testing.assert_allclose(tilted[:3, 2], [np.sqrt(0.5), 0, -np.sqrt(0.5)], atol=1e-12)
    np.testing.assert_allclose(FaceMount("board").link_from_mount(), np.eye(4))
    assert parse_marker("a=b@c@1,2,3", None).link == "b@c"
    with pytest.raises(MirrorPostureError, match="--x"):
        parse_vector("1,2", "--x")


def test_meshes_are_found_as_ros_finds_them(
    arm: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = "package://arm_description/meshes/upper.stl"
    assert mesh_file(name, arm, {}) is None
    mesh = arm.parents[1] / "meshes" / "upper.stl"
    mesh.parent.mkdir()
    mesh.write_text("solid x\nendsolid x\n")
    assert mesh_file(name, arm, {}).resolve() == mesh.resolve()
    lonely = tmp_path / "lonely.urdf"
    assert mesh_file(name, tmp_path / "elsewhere" / "x.urdf", {}) is not None, (
        "a folder above holds the package"
    )
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path))
    assert mesh_file(name, Path("/x.urdf"), {}) == mesh
    assert mesh_file("package://other/meshes/upper.stl", lonely, {"other": mesh.parents[1]}) == mesh
    assert mesh_file("../meshes/upper.stl", arm, {}) is not None


MJCF = """<mujoco model="m"><compiler angle="radian"/><worldbody>
  <body name="a" pos="0.1 0 0.2" quat="0.9 0.1 0.3 -0.2"><freejoint/>
    <geom type="sphere" size="0.05" mass="1"/>
    <body name="b" pos="0 0.1 0.3" euler="0.3 0.2 -0.4">
      <joint name="j1" axis="0 1 0.5" pos="0.02 -0.01 0.03" range="-1 1" ref="0.3"/>
      <joint name="j2" axis="1 0 0" pos="0 0.05 0"/>
      <geom type="box" size="0.02 0.03 0.04" pos="0.1 0 0" mass="0.4"/>
      <body name="c" pos="0.2 0 0"><joint name="s" type="slide" axis="0 1 1" pos="0.1 0 0" ref="0.05" range="-.1 .1"/>
        <geom type="sphere" size="0.01" mass="0.1"/></body>
    </body></body></worldbody></mujoco>"""


def test_an_mjcf_becomes_a_urdf_that_moves_as_mujoco_moves(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    file = tmp_path / "m.xml"
    file.write_text(MJCF)
    robot = Robot.from_urdf_text(urdf_from_mjcf(file)[0])
    assert robot.position_names == ("j1", "j2", "s")
    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    generator = np.random.default_rng(1)
    for _ in range(5):
        q = {
            "j1": generator.uniform(-1, 1),
            "j2": generator.uniform(-3, 3),
            "s": generator.uniform(-0.1, 0.1),
        }
        for name, value in q.items():
            data.joint(name).qpos[0] = value
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        position = robot.positions({name: [value] for name, value in q.items()})
        poses = robot.link_poses(position, ["a", "b", "c"])[0]
        for name, pose in zip("abc", poses, strict=True):
            np.testing.assert_allclose(pose[:3, 3], data.body(name).xpos, atol=1e-9)
            np.testing.assert_allclose(pose[:3, :3], data.body(name).xmat.reshape(3, 3), atol=1e-9)
    masses = {link.name: link for link in robot.links}
    assert masses["b"].mass_kg == pytest.approx(0.4) and masses["b"].com_in_link_m[0] == pytest.approx(0.1)
    file.write_text(MJCF.replace('name="j2" axis="1 0 0"', 'name="j2" type="ball"'))
    with pytest.raises(MirrorPostureError, match="ball joint"):
        urdf_from_mjcf(file)


COUPLED = """<mujoco model="m"><compiler angle="radian"/><worldbody><body name="palm"><geom size=".1"/>
  <body name="a"><joint name="f1" axis="0 1 0" range="-1 1" ref="0.2"/><geom size=".02" pos=".2 0 0"/>
    <body name="b" pos=".3 0 0"><joint name="f2" axis="0 -1 0" range="-3 3" ref="-0.1"/><geom size=".02" pos=".1 0 0"/></body></body>
  <body name="c" pos="0 .2 0"><joint name="f3" axis="0 1 0" range="-1 1"/><geom size=".02" pos=".1 0 0"/></body>
  </body></worldbody>
  <equality><joint joint1="f2" joint2="f1" polycoef="0.05 1.5 0 0 0"/>{}</equality></mujoco>"""


def test_couplings_of_an_mjcf_are_kept_or_told(tmp_path: Path) -> None:
    """Before, they were dropped without a word, and the fingers were two free joints. Judged by MuJoCo's own projection."""
    mujoco = pytest.importorskip("mujoco")
    file = tmp_path / "m.xml"
    file.write_text(COUPLED.format(""))
    text, _, warnings = urdf_from_mjcf(file)
    robot = Robot.from_urdf_text(text)
    assert robot.position_names == ("f1", "f3") and warnings == []
    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    for angle in (-0.6, 0.2, 0.7):
        data.qpos[:] = [angle, 0.0, 0.0]
        # The angle at which MuJoCo's constraint is kept: its residual is linear in the follower's position.
        mujoco.mj_forward(model, data)
        data.joint("f2").qpos[0] -= data.efc_pos[0]
        mujoco.mj_forward(model, data)
        assert abs(data.efc_pos[0]) < 1e-12
        pose = robot.link_poses(robot.positions({"f1": [angle]}), ["b"])[0][0]
        np.testing.assert_allclose(pose[:3, :3], data.body("b").xmat.reshape(3, 3), atol=1e-9)
        np.testing.assert_allclose(pose[:3, 3], data.body("b").xpos, atol=1e-9)
    for more, kind in (
        ('<joint name="e" joint1="f3" joint2="f1" polycoef="0 1 0.5 0 0"/>', "joint"),
        ('<joint name="e" joint1="f3"/>', "joint"),
        ('<joint name="e" joint1="f1" joint2="f2"/>', "joint"),
        ('<connect name="e" body1="b" body2="c" anchor="0 0 0"/>', "connect"),
        ('<weld name="e" body1="b" body2="c"/>', "weld"),
    ):
        file.write_text(COUPLED.format(more))
        text, _, warnings = urdf_from_mjcf(file)
        assert Robot.from_urdf_text(text).position_names == ("f1", "f3")
        (told,) = warnings
        assert told.startswith(f"equality e ({kind}) is left out"), told
        file.write_text(COUPLED.format(more.replace("/>", ' active="false"/>')))
        assert urdf_from_mjcf(file)[2] == []
    # fmt: off
    file.write_text(COUPLED.format('<weld name="e" body1="b" body2="c"/>'))
    done = run("init", file, tmp_path / "s", "--camera", "world", "--camera-at", "0,0,1", "--board", "world", "--board-at", "0,0,0.9",
               "--marker", "hand=b@0.1,0,0")
    # fmt: on
    assert "equality e (weld) is left out" in " ".join(done.stderr.split())


SHAPES = """<mujoco><asset><mesh name="wedge/1" vertex="0 0 0  .2 0 0  0 .1 0  0 0 .3"/></asset><worldbody>
  <geom name="floor" type="plane" size="1 1 1"/>
  <body name="arm"><joint name="j" axis="0 0 1" range="-90 90"/>
    <geom type="mesh" mesh="wedge/1" pos="0.01 0.02 0.03" euler="0 0 90" contype="0" conaffinity="0"/>
    <geom type="capsule" size="0.02 0.1" pos="0.5 0 0" group="3"/>
    <geom type="box" size="0.1 0.2 0.3" pos="0 0 1"/>
  </body></worldbody></mujoco>"""


def test_an_mjcf_keeps_its_meshes_where_they_are(tmp_path: Path) -> None:
    """The corners as the file tells them, turned by hand; what is seen and what collides are parted as MuJoCo parts them."""
    pytest.importorskip("mujoco")
    file = tmp_path / "m.xml"
    file.write_text(SHAPES)
    # fmt: off
    run("init", file, tmp_path / "s", "--camera", "world", "--camera-at", "0,0,1", "--board", "world", "--board-at", "0,0,0.9",
        "--marker", "hand=arm@0.1,0,0", "--mirror-size", "50x70", "--mirror-at", "1,0,0.9")
    # fmt: on
    urdf = tmp_path / "s" / "robot.urdf"
    # A name with a slash is marked, so that it is not that of `wedge_1`.
    (kept,) = (tmp_path / "s" / "meshes").iterdir()
    assert re.fullmatch(r"[0-9a-f]{8}-wedge_1\.stl\.coarse\.stl", kept.name)
    seen, missing = shapes_of_links(urdf, kind="visual")
    assert not missing and set(seen) == {"arm"} and len(seen["arm"]) == 2
    corners = np.array([[0, 0, 0], [0, 0.2, 0], [-0.1, 0, 0], [0, 0, 0.3]]) + np.array([0.01, 0.02, 0.03])
    found = np.unique(np.round(seen["arm"][0].vertices_m, 6), axis=0)
    np.testing.assert_allclose(found, corners[np.lexsort(corners.T[::-1])], atol=2e-6)
    hard, _ = shapes_of_links(urdf, kind="collision")
    spans = sorted(tuple(np.ptp(shape.vertices_m, axis=0).round(3)) for shape in hard["arm"])
    assert spans == [(0.04, 0.04, 0.04), (0.04, 0.04, 0.04), (0.04, 0.04, 0.2), (0.2, 0.4, 0.6)]
    ends = sorted(float(shape.vertices_m[:, 2].max().round(3)) for shape in hard["arm"])
    assert ends == [-0.08, 0.1, 0.12, 1.3]
    mirror = tomllib.loads((tmp_path / "s" / "session.toml").read_text())["mirror"]
    assert (mirror["width"], mirror["height"], mirror["center"]) == (0.5, 0.7, [1.0, 0.0, 0.9])


def test_meshes_of_similar_names_stay_apart(tmp_path: Path) -> None:
    """Before, both were `arm_link.stl`: one had the other's shape."""
    pytest.importorskip("mujoco")
    file = tmp_path / "m.xml"
    meshes = "".join(
        f'<mesh name="{name}" vertex="0 0 0  {length} 0 0  0 .1 0  0 0 .3"/>'
        for name, length in (("arm/link", 0.2), ("arm_link", 0.4))
    )
    geoms = '<geom type="mesh" mesh="arm/link"/><geom type="mesh" mesh="arm_link"/>'
    file.write_text(f"<mujoco><asset>{meshes}</asset><worldbody><body>{geoms}</body></worldbody></mujoco>")
    text, found, _ = urdf_from_mjcf(file)
    sizes = {round(float(np.ptp(mesh.vertices_m, axis=0).max()), 3) for mesh in found.values()}
    assert len(found) == len(sizes) == 2 and all(f'filename="{name}"' in text for name in found)


def test_a_plan_takes_the_mirror_that_the_session_tells() -> None:
    told = Mirror(width_m=0.5, center_in_root_m=(1.0, 0.0, 0.9))
    options = PlanOptions(mirror_height_m=0.3).before(told)
    assert options.mirror_size_m == (0.5, 0.3) and options.mirror_at_m == (1.0, 0.0, 0.9)
    assert PlanOptions(mirror_width_m=0.2).before(told).mirror_size_m == (0.2, 0.6)
    assert PlanOptions().before(None).mirror_size_m == (0.4, 0.6)
