"""The embedded robot and the pictures drawn of it: what is in view, what is hidden, what is written."""

from __future__ import annotations

import json
import math
import shutil
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from mirror_posture import MirrorPostureError, load_session
from mirror_posture.render import (
    DEMO_OFFSETS_RAD,
    DEMO_POSTURES,
    DEMO_VIEWS,
    EMBEDDED_FOLDER,
    Painter,
    PictureOptions,
    View,
    render_session,
    view_planes,
)
from small_arm import run, setup

SHRINK = 8
"""Tests of geometry draw pictures of an eighth of the size: the same rays' angles in a fraction of the time."""
PAPER_POSTURE = DEMO_POSTURES[0]


@pytest.fixture(scope="module")
def template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The embedded robot with a camera of an eighth of the resolution."""
    folder = tmp_path_factory.mktemp("template") / "embedded"
    shutil.copytree(EMBEDDED_FOLDER, folder)
    info = yaml.safe_load((folder / "camera.yaml").read_text())
    info["image_width"] //= SHRINK
    info["image_height"] //= SHRINK
    k = info["camera_matrix"]["data"]
    for i in (0, 4):
        k[i] /= SHRINK
    for i in (2, 5):
        k[i] = (k[i] + 0.5) / SHRINK - 0.5
    (folder / "camera.yaml").write_text(yaml.safe_dump(info))
    return folder


@pytest.fixture(scope="module")
def painter(template: Path) -> Painter:
    return Painter.load(template)


def truth_of(painter: Painter, posture: dict[str, float], view: View) -> dict:
    plane = view_planes([view], painter.board_in_root_m)[0]
    return painter.draw(painter.link_poses(posture), plane, PictureOptions(samples=1, edge_samples=1)).truth


def seen_fraction(truth: dict, marker: str) -> float:
    via = truth["markers"][marker]["mirror"]
    return 0.0 if via is None else via["visible_fraction"]


def test_embedded_robot_is_of_the_class_it_claims() -> None:
    robot = ElementTree.parse(EMBEDDED_FOLDER / "robot.urdf").getroot()
    moving = [j for j in robot.iter("joint") if j.get("type") == "revolute"]
    assert len(moving) == 20
    assert sum(float(m.get("value", 0)) for m in robot.iter("mass")) == pytest.approx(1.6, abs=0.01)
    for inertia in robot.iter("inertia"):
        x, y, z = sorted(float(inertia.get(axis, 0)) for axis in ("ixx", "iyy", "izz"))
        # The printed digits (four) allow the flattest solids to touch the triangle inequality.
        assert 0.0 < x and z <= (x + y) * 1.001


def test_between_board_and_hand_lie_three_joints() -> None:
    robot = ElementTree.parse(EMBEDDED_FOLDER / "robot.urdf").getroot()
    above = {j.find("child").get("link"): j for j in robot.iter("joint")}  # type: ignore[union-attr]
    link, moving = "r_hand_marker", []
    while link in above:
        joint = above[link]
        if joint.get("type") != "fixed":
            moving.append(joint.get("name"))
        link = joint.find("parent").get("link")  # type: ignore[union-attr]
    assert moving == ["r_elbow", "r_shoulder_roll", "r_shoulder_pitch"]
    assert above["chest_board"].find("parent").get("link") == link  # type: ignore[union-attr]


def test_board_lies_75_mm_below_the_camera(painter: Painter) -> None:
    poses = painter.link_poses({})
    assert poses["camera_optical"][2, 3] - poses["chest_board"][2, 3] == pytest.approx(0.075)
    assert poses["chest_board"][:3, 2] == pytest.approx([1.0, 0.0, 0.0], abs=1e-9)


def test_view_planes_stand_at_their_distance_and_angle(painter: Painter) -> None:
    board = painter.board_in_root_m
    views = [
        View(math.radians(a), math.radians(b), d) for a, b, d in ((0, 0, 0.15), (15, 0, 0.2), (-10, 9, 0.3))
    ]
    for view, plane in zip(views, view_planes(views, board), strict=True):
        n, center = np.array(plane.normal_in_root), np.array(plane.center_in_root_m)
        assert np.linalg.norm(n) == pytest.approx(1.0)
        assert n @ (center - board) == pytest.approx(view.distance_m)
        assert math.atan2(n[1], n[0]) == pytest.approx(view.yaw_rad)
        assert math.asin(n[2]) == pytest.approx(view.pitch_rad)
    with pytest.raises(MirrorPostureError, match="above 0 m"):
        view_planes([View(distance_m=0.0)], board)


@pytest.mark.parametrize("distance_m", [0.15, 0.2, 0.25, 0.3])
@pytest.mark.parametrize("yaw_deg", [-15, 0, 15, 18])
def test_board_is_in_view(painter: Painter, distance_m: float, yaw_deg: int) -> None:
    truth = truth_of(painter, {}, View(math.radians(yaw_deg), 0.0, distance_m))
    assert all(truth["corners_visible"])


def test_board_at_25_degrees_needs_the_head_to_follow(painter: Painter) -> None:
    view = View(math.radians(25.0))
    assert not all(truth_of(painter, {}, view)["corners_visible"])
    assert all(truth_of(painter, {"head_yaw": math.radians(10.0)}, view)["corners_visible"])


@pytest.mark.parametrize("yaw_deg", [0, 15])
def test_right_hand_of_the_papers_posture_is_in_view(painter: Painter, yaw_deg: int) -> None:
    truth = truth_of(painter, dict(PAPER_POSTURE), View(math.radians(yaw_deg)))
    assert all(truth["corners_visible"])
    assert seen_fraction(truth, "r_hand") > 0.9
    assert seen_fraction(truth, "r_forearm") > 0.9


def test_feet_need_a_distance(painter: Painter) -> None:
    near, far = (truth_of(painter, {}, View(distance_m=d)) for d in (0.15, 0.25))
    for foot in ("r_foot", "l_foot"):
        assert seen_fraction(near, foot) == 0.0
        assert seen_fraction(far, foot) > 0.9


def test_every_demo_frame_shows_board_and_most_markers(painter: Painter) -> None:
    hands = ("r_hand", "l_hand", "r_forearm", "l_forearm")
    for posture in DEMO_POSTURES:
        views_of = dict.fromkeys(hands, 0)
        for view in DEMO_VIEWS:
            truth = truth_of(painter, dict(posture), view)
            assert all(truth["corners_visible"])
            for name in hands:
                views_of[name] += seen_fraction(truth, name) > 0.9
        # Every marker can be triangulated: two views at least.
        assert min(views_of.values()) >= 2, (posture, views_of)


def test_session_loads_and_tells_the_hidden_truth(template: Path, painter: Painter, tmp_path: Path) -> None:
    done = []
    folder = render_session(
        tmp_path / "demo",
        DEMO_POSTURES[:2],
        DEMO_VIEWS[:2],
        offsets_rad=DEMO_OFFSETS_RAD,
        template=template,
        progress=lambda n, total: done.append((n, total)),
    )
    assert done == [(1, 4), (2, 4), (3, 4), (4, 4)]
    session = load_session(folder)
    assert not session.warnings
    assert not session.detected
    assert session.frames.posture.tolist() == [0, 0, 1, 1]
    assert session.mirror is not None and session.mirror.glass_thickness_m == 0.003
    truth = json.loads((folder / "truth.json").read_text())
    for row, told in enumerate(truth["frames"]):
        picture = cv2.imread(str(session.image_files[row]))
        assert picture is not None and picture.shape == (600 // SHRINK, 800 // SHRINK, 3)
        commanded = dict(zip(session.frames.joint_names, session.frames.commanded[row], strict=True))
        actual = {name: q + DEMO_OFFSETS_RAD.get(name, 0.0) for name, q in commanded.items()}
        for name in ("r_hand", "l_hand"):
            at = np.array(told["markers"][name]["root_m"])
            assert at == pytest.approx(painter.link_poses(actual)[f"{name}_marker"][:3, 3], abs=1e-12)
            # What is hidden is large enough to measure.
            assert np.linalg.norm(at - painter.link_poses(commanded)[f"{name}_marker"][:3, 3]) > 0.001


def test_poses_of_a_simulator_are_drawn_as_they_are(template: Path, painter: Painter, tmp_path: Path) -> None:
    bent = {"r_elbow": 0.1}
    folder = render_session(tmp_path / "a", [{}], [View()], offsets_rad=bent, template=template)
    plane = view_planes([View()], painter.board_in_root_m)[0]
    drawn = painter.draw(painter.link_poses(bent), plane).picture
    np.testing.assert_array_equal(cv2.imread(str(folder / "images/000.png"))[..., ::-1], drawn)


def test_a_session_with_pictures_says_what_its_template_says(template: Path, tmp_path: Path) -> None:
    """Before, the tolerances of the camera's mount and the keys that the format does not know were left out."""
    own = shutil.copytree(template, tmp_path / "own")
    told = (own / "session.toml").read_text().replace("[camera_mount]", "[camera_mount]\ntolerance_m = 0.002")
    (own / "session.toml").write_text(told + '\n[operator]\nname = "Zoë"\n', encoding="utf-8")
    session = load_session(render_session(tmp_path / "a", [{}], [View()], template=own))
    assert session.camera_tolerance_m == 0.002
    assert session.metadata["operator"] == {"name": "Zoë"}


def test_a_folder_is_written_whole_or_not_at_all(template: Path, tmp_path: Path) -> None:
    def breaks(done: int, total: int) -> None:
        raise RuntimeError("the computer fell over")

    with pytest.raises(RuntimeError, match="fell over"):
        render_session(tmp_path / "s", [{}, {}], [View()], progress=breaks, template=template)
    assert list(tmp_path.iterdir()) == []
    render_session(tmp_path / "s", [{}], [View()], template=template)
    with pytest.raises(MirrorPostureError, match="there already"):
        render_session(tmp_path / "s", [{}], [View()], template=template)


def test_the_same_seed_gives_the_same_picture(painter: Painter) -> None:
    plane = view_planes([View()], painter.board_in_root_m)[0]
    poses = painter.link_poses({})
    one, again, other = (painter.draw(poses, plane, seed=seed).picture for seed in (3, 3, 4))
    assert np.array_equal(one, again)
    assert not np.array_equal(one, other)


def test_what_cannot_be_drawn_is_refused(template: Path, painter: Painter, tmp_path: Path) -> None:
    with pytest.raises(MirrorPostureError, match="r_elbow"):
        render_session(tmp_path / "x", [{}], [View()], offsets_rad={"r_elbo": 0.1}, template=template)
    with pytest.raises(MirrorPostureError, match="0 postures"):
        render_session(tmp_path / "x", [], [View()], template=template)
    plane = view_planes([View()], painter.board_in_root_m)[0]
    poses = painter.link_poses({})
    with pytest.raises(MirrorPostureError, match="thickness"):
        painter.draw(poses, plane, PictureOptions(glass_thickness_m=-1.0))
    with pytest.raises(MirrorPostureError, match="rigid"):
        painter.draw({**poses, "head": np.diag([1.0, 1.0, -1.0, 1.0])}, plane)
    with pytest.raises(MirrorPostureError, match="camera_optical"):
        painter.draw({"base_link": np.eye(4)}, plane)
    assert list(tmp_path.iterdir()) == []


def test_the_demonstrations_postures_are_not_of_every_robot(tmp_path: Path) -> None:
    """Before, it named a joint that nobody had typed, and not what to do."""
    session = setup(tmp_path)
    told = run("render", tmp_path / "drawn", "--template", session, "--postures", 1, code=1).stderr
    assert f"{session / 'robot.urdf'}: has no joint l_elbow, " in told
    assert "of the demonstration's postures; its joints: pan, lift, elbow; is it another robot's?" in told
    assert "--meshes" in told and not (tmp_path / "drawn").exists()


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (["--mirror-size", "30x40"], "--mirror-size: without --meshes it changes nothing"),
        (["--meshes", "--seed", "3", "--no-noise"], "--noise, --seed: is of pictures without --meshes"),
        (["--meshes", "--plan", "plan", "--joint", "pan=3", "--yaw", "4"], "the plan has its own postures and mirrors"),
    ],
)  # fmt: skip
def test_options_that_would_change_nothing_are_refused(
    words: list[str], problem: str, tmp_path: Path
) -> None:
    """Before, they were taken without a word."""
    assert problem in run("render", tmp_path / "drawn", *words, code=1).stderr
    assert not (tmp_path / "drawn").exists()
