"""A plan's postures, judged by others: MuJoCo's own reading of the URDF, OpenCV's projection, and the diagnosis itself."""

from __future__ import annotations

import json
import math
import os
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pyarrow.csv
import pytest

from mirror_posture import MirrorPostureError, Robot
from mirror_posture.camera import Camera
from mirror_posture.diagnosis import diagnose
from mirror_posture.formats.plan_keys import MOST_VIEWS
from mirror_posture.plan import PlanOptions, read_plan
from mirror_posture.plan.again import read_options
from mirror_posture.plan.options import PITCHES_DEG, YAWS_DEG
from mirror_posture.robots import Nominal
from mirror_posture.robots.protocol import ImagePoints, Look
from mirror_posture.session import load_camera_info
from small_arm import run, setup
from test_schemas import compare, some

mujoco = pytest.importorskip("mujoco")
WIDTH_M, HEIGHT_M = 0.5, 0.5
NAMES = ("pan", "lift", "elbow")


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = setup(tmp_path_factory.mktemp("plan"))
    with pytest.MonkeyPatch.context() as fewer:
        fewer.setattr("mirror_posture.plan.run.DRAWN", 2500)
        fewer.setattr("mirror_posture.plan.run.POOL", 80)
        told = run("plan", folder, "--mirror-size", "50x50", "--postures", 20, "--json").stdout
    (folder / "told.json").write_text(told)
    return folder


def table(file: Path) -> dict[str, np.ndarray]:
    read = pyarrow.csv.read_csv(file)
    return {
        name: np.array(column.to_pylist())
        for name, column in zip(read.column_names, read.columns, strict=True)
    }


def pixels(camera: Camera, points_in_camera: np.ndarray) -> np.ndarray:
    return cv2.projectPoints(
        points_in_camera, np.zeros(3), np.zeros(3), camera.matrix_px, camera.opencv_distortion
    )[0].reshape(-1, 2)


def seen_points(folder: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray, Camera, list[float]]:
    """Of each planned row: where things are, their reflections' pixels, where the light meets the mirror (along its sides)."""
    postures, views = table(folder / "plan" / "postures.csv"), table(folder / "plan" / "views.csv")
    plan = json.loads((folder / "plan" / "plan.json").read_text())
    camera = load_camera_info(folder / "camera.yaml")
    robot = Robot.from_urdf(folder / "robot.urdf")
    q = robot.positions({name: postures[name] for name in NAMES})
    links = ["session_camera_optical", "session_board", "hand_marker", "wrist_marker"]
    grid = np.array([[x, y, 0.0] for y in np.arange(4) - 1.5 for x in np.arange(7) - 3.0]) * 0.02
    direct, mirrored, crossing = [], [], []
    for row, poses in enumerate(robot.link_poses(q, links)):
        points = np.vstack([grid @ poses[1, :3, :3].T + poses[1, :3, 3], poses[2:, :3, 3]])
        normal = np.array([views[f"normal_{a}"][row] for a in "xyz"])
        center = np.array([views[f"center_{a}_m"][row] for a in "xyz"])
        image = points - 2.0 * ((points - center) @ normal)[:, None] * normal
        eye = poses[0, :3, 3]
        share = ((center - eye) @ normal) / ((image - eye) @ normal)
        up = np.array(plan["mirror"]["views"][int(views["view"][row])]["up_in_root"])
        met = eye + share[:, None] * (image - eye) - center
        crossing.append(np.stack([met @ np.cross(up, normal), met @ up], axis=1))
        camera_from = np.linalg.inv(poses[0])
        direct.append(points @ camera_from[:3, :3].T + camera_from[:3, 3])
        mirrored.append(pixels(camera, image @ camera_from[:3, :3].T + camera_from[:3, 3]))
        # Behind the glass is nothing of what is looked at.
        assert ((points - center) @ normal < 0.0).all()
    return np.array(direct), np.array(mirrored), np.array(crossing), camera, list(views["view"])


def test_board_and_balls_are_seen_in_the_mirrors_frame_and_no_real_ball_beside(planned: Path) -> None:
    direct, mirrored, crossing, camera, view = seen_points(planned)
    told = json.loads((planned / "plan" / "plan.json").read_text())
    assert len(view) == told["frames"] >= 18 and len(set(view)) == 3
    size = np.array(camera.size_px)
    inside = ((mirrored > 0) & (mirrored < size - 1)).all(axis=2)
    inside &= (np.abs(crossing) < [WIDTH_M / 2, HEIGHT_M / 2]).all(axis=2)
    assert inside[:, :28].all(), "the board"
    assert inside[:, 28:].any(axis=1).all(), "a ball at least"
    for row in range(len(direct)):
        for ball in direct[row, 28:]:
            if ball[2] > 0:
                u, v = pixels(camera, ball[None])[0]
                assert not (0 <= u < size[0] and 0 <= v < size[1]), "a real ball in the picture"


def test_mujoco_finds_no_collision_on_the_whole_way(planned: Path) -> None:
    """By MuJoCo's own URDF reader and kinematics; without the clearance."""
    text = (planned / "robot.urdf").read_text()
    spec = mujoco.MjSpec.from_string(
        text.replace(
            "</robot>",
            '<mujoco><compiler discardvisual="false" fusestatic="false" balanceinertia="true" boundmass="1e-6" boundinertia="1e-9"/></mujoco></robot>',
        )
    )
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 1
    spec.add_exclude(bodyname1="base", bodyname2="turret")
    model = spec.compile()
    data = mujoco.MjData(model)
    rows = read_plan(planned / "plan" / "postures.csv", Robot.from_urdf(planned / "robot.urdf"))
    counts = json.loads((planned / "plan" / "plan.json").read_text(encoding="utf-8"))
    assert counts["frames"] == len(rows) <= counts["frames_asked"] < counts["drawn"]
    assert counts["markers"] and all(0 < seen <= len(rows) for seen in counts["markers"].values())
    assert sum(counts["not_taken"].values()) > 0
    here = np.zeros(3)
    address = [model.joint(name).qposadr[0] for name in NAMES]
    lowest = np.inf
    for row in rows:
        there = np.array([row.commanded[name] for name in NAMES])
        for name, value in row.commanded.items():
            low, high = model.joint(name).range
            assert low < value < high
        for share in np.linspace(0.05, 1.0, 12):
            data.qpos[address] = here + share * (there - here)
            mujoco.mj_forward(model, data)
            assert data.ncon == 0, (row.frame, share)
        lowest = min(lowest, *(data.xpos[model.body(name).id][2] for name in ("hand_marker", "wrist_marker")))
        here = there
    assert lowest > 0.01, "a ball of 1 cm radius above the table"


def test_every_joint_arrives_from_both_sides(planned: Path) -> None:
    rows = table(planned / "plan" / "postures.csv")
    for name in NAMES:
        change = np.diff(np.concatenate([[0.0], rows[name]]))
        up = (change > 0).sum() / max(1, (change != 0).sum())
        assert 0.3 < up < 0.7, (name, up)


def observed(folder: Path, noise_px: float, wrong: dict[str, float]) -> object:
    """A session of the plan: OpenCV's pixels with noise, where joints have other gears than the model."""
    nominal = Nominal.load(folder)
    rows = table(folder / "plan" / "postures.csv")
    real = folder.parent / "real"
    (real / "plan").mkdir(parents=True, exist_ok=True)
    for name in ("robot.urdf", "camera.yaml", "plan/views.csv", "plan/plan.json"):
        (real / name).write_bytes((folder / name).read_bytes())
    header = ["frame", "posture", *NAMES]
    lines = [",".join(header)]
    for r in range(len(rows["frame"])):
        lines.append(
            ",".join([str(r), str(r), *(repr(float(rows[n][r] * (1.0 + wrong.get(n, 0.0)))) for n in NAMES)])
        )
    (real / "plan" / "postures.csv").write_text("\n".join(lines) + "\n")
    mirrored = seen_points(real)[1]
    mirrored = mirrored + np.random.default_rng(5).normal(0.0, noise_px, mirrored.shape)
    size = np.array(nominal.camera.size_px)
    inside = ((mirrored > 0) & (mirrored < size - 1)).all(axis=2)
    looks = [
        Look(
            {name: float(rows[name][r]) for name in NAMES},
            10.0 * r,
            points=ImagePoints(mirrored[r, :28], inside[r, :28], mirrored[r, 28:], inside[r, 28:]),
        )
        for r in range(len(mirrored))
    ]
    session = nominal.session(looks, list(range(len(looks))))
    noise = replace(session.noise, pixel_std_px=noise_px)
    return replace(session, camera_tolerance_m=0.003, camera_tolerance_rad=math.radians(1.0), noise=noise)


def test_the_diagnosis_finds_what_the_plan_says_it_will(planned: Path) -> None:
    tells = json.loads((planned / "told.json").read_text())["tells"]
    size = next(
        one["parameters"]["scale_error"]
        for one in tells
        if one["effect"] == "gear_ratio" and one["at"] == "joint:elbow"
    )
    found = diagnose(observed(planned, 0.15, {"elbow": 2.0 * size}))
    causes = {(cause.effect, cause.at): cause for cause in found.causes}
    gear = causes[("gear_ratio", "joint:elbow")]
    parameter = gear.parameters["scale_error"]
    assert parameter.value == pytest.approx(2.0 * size, abs=4.0 * parameter.std)
    nothing = diagnose(observed(planned, 0.15, {"elbow": 0.1 * size}))
    assert not nothing.causes  # and what it says that it would have missed is what the plan said:
    foreseen = {(t["effect"], t["at"], k): v for t in tells for k, v in t["parameters"].items()}
    hidden = {(one.effect, one.at, k): v for one in nothing.limits for k, v in one.parameters.items()}
    ratios = [hidden[k] / v for k, v in foreseen.items() if v is not None and hidden[k] is not None]
    assert len(ratios) > 30
    assert np.median(ratios) == pytest.approx(1.0, abs=0.05) and 0.6 < min(ratios) and max(ratios) < 1.4


def test_a_twin_is_told_before_a_picture_is_taken(planned: Path) -> None:
    """A ball on the last link: the last joint's zero is the ball's place turned about its axis; two balls help."""
    tells = {(t["effect"], t["at"]): t for t in json.loads((planned / "told.json").read_text())["tells"]}
    offset = {joint: tells[("joint_offset", f"joint:{joint}")]["parameters"]["offset_rad"] for joint in NAMES}
    # Balls that may sit 3 mm elsewhere hide the elbow's zero, and the board's own turn about the vertical (1°) that of the turret.
    assert offset["elbow"] > 0.05 and offset["pan"] > 0.02 > 3 * offset["lift"]
    assert all(
        size is not None
        for t in tells.values()
        for size in t["parameters"].values()
        if t["effect"] == "gear_ratio"
    )


def test_what_cannot_be_planned_says_why(planned: Path, tmp_path: Path) -> None:
    told = run("plan", planned, "--mirror-size", "5x5", code=1).stderr
    assert "the board is not to be seen in the mirror" in " ".join(told.split())
    assert "JOINT=DEGREES" in run("plan", planned, "--home", "pan", code=1).stderr
    assert "pan" in run("plan", planned, "--hold", "pen", code=1).stderr
    assert "WIDTHxHEIGHT" in run("plan", planned, "--mirror-size", "big", code=1).stderr
    with pytest.raises(MirrorPostureError, match="postures"):
        PlanOptions(postures=1)
    (tmp_path / "postures.csv").write_text("frame,posture,pan\n0,0,x\n")
    file, robot = tmp_path / "postures.csv", Robot.from_urdf(planned / "robot.urdf")
    with pytest.raises(MirrorPostureError, match=r"column .pan.: got .x., needed a finite number"):
        read_plan(file, robot)
    for text, told in (
        ("frame,posture,pan\n0.5,0,0\n", "whole number"),
        ("frame,posture,pan\n0,-1,0\n", "whole number"),
        ("frame,posture,pan\n0,0,0\n0,1,0\n", "twice"),
        ("frame,posture,pan, pan\n0,0,0,0\n", "twice"),
        ("frame,posture,pan\n0,0,nan\n", "finite number"),
        ("frame,posture" + ",x" * 6000 + "\n", "at most 5000 columns"),
    ):
        file.write_text(text)
        with pytest.raises(MirrorPostureError, match=told):
            read_plan(file, robot)
    file.unlink()
    os.mkfifo(file)
    with pytest.raises(MirrorPostureError, match="no regular file"):
        read_plan(file, robot)


def test_pinocchio_and_coal_find_no_collision_and_all_in_sight(planned: Path) -> None:
    """A second engine, of which the product uses nothing; of SO-101 and G1 by hand: plan_by_pinocchio.py."""
    pytest.importorskip("pinocchio")
    from plan_by_pinocchio import judge

    found = judge(planned)
    assert found.postures >= 18 and found.pairs >= 10 and found.left_out == []
    assert found.collisions == [] and found.board_unseen == [] and found.real_balls == []
    assert found.glass_m > 0.03 and min(found.balls_seen) >= 1


def test_the_second_engine_would_see_a_bad_plan(planned: Path, tmp_path: Path) -> None:
    pytest.importorskip("pinocchio")
    from plan_by_pinocchio import judge

    for name in (
        "robot.urdf",
        "camera.yaml",
        "session.toml",
        "plan/views.csv",
        "plan/plan.json",
        "plan/postures.csv",
    ):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes((planned / name).read_bytes())
    # Folded into the base; and a mirror two metres aside.
    header, *rows = (planned / "plan" / "postures.csv").read_text().splitlines()
    rows[0] = "0,0,0.0,-0.4,-2.2"
    (tmp_path / "plan" / "postures.csv").write_text("\n".join([header, *rows]) + "\n")
    header, *rows = (planned / "plan" / "views.csv").read_text().splitlines()
    cells = rows[1].split(",")
    cells[header.replace('"', "").split(",").index("center_y_m")] = "2.0"
    (tmp_path / "plan" / "views.csv").write_text(
        "\n".join([header, rows[0], ",".join(cells), *rows[2:]]) + "\n"
    )
    found = judge(tmp_path)
    assert {0} <= {frame for frame, _, _ in found.collisions} <= {0, 1}
    assert found.board_unseen == [1] and found.balls_seen[1] == 0


def target_of(planned: Path, row: int) -> list[object]:
    """A posture of the plan, as `correct` takes it."""
    rows = table(planned / "plan" / "postures.csv")
    return [word for name in NAMES for word in ("--joint", f"{name}={float(rows[name][row])!r}rad")]


def test_a_correction_looks_from_the_plans_viewpoints(planned: Path, tmp_path: Path) -> None:
    posture = target_of(planned, 3)
    out = tmp_path / "corrected"
    hidden = ("--hide", "joint_offset@joint:lift:offset_rad=0.04")
    words = ("correct", "twin", "--session", planned, "--plan", planned / "plan", *posture, *hidden)
    words = (*words, "--no-pictures", "--stand-error-deg", 0)
    told = run(*words, "--out", out)
    assert "viewpoints of the plan's mirror for a look" in told.output
    ended = json.loads((out / "outcome.json").read_text())
    assert ended["stop"]["kind"] == "converged"
    assert ended["best_command"]["lift"] == pytest.approx(ended["target_posture"]["lift"] - 0.04, abs=0.01)
    header = json.loads((out / "correction.json").read_text())["settings"]["planned"]
    assert len(header["usual"]) >= 3 and len(header["usual"] + header["further"]) == 6
    # By OpenCV: board and ball are in the picture of each, as far from its edges as a plan asks, and nothing of the arm reaches the glass.
    robot, camera = Robot.from_urdf(planned / "robot.urdf"), load_camera_info(planned / "camera.yaml")
    rows = table(planned / "plan" / "postures.csv")
    q = np.array([[rows[name][3] for name in NAMES]])
    links = ["base", "session_camera_optical", "session_board", "hand_marker"]
    poses = np.linalg.inv(robot.link_poses(q, links)[0][:1]) @ robot.link_poses(q, links)[0]
    points = np.array(
        [poses[2, :3, :3] @ [x, y, 0.0] + poses[2, :3, 3] for x in (-0.06, 0.06) for y in (-0.03, 0.03)]
    )
    points = np.vstack([points, poses[3, :3, 3]])
    for yaw, pitch, distance in (*header["usual"], *header["further"]):
        normal = np.array([math.cos(pitch) * math.cos(yaw), math.cos(pitch) * math.sin(yaw), math.sin(pitch)])
        at = poses[2, :3, 3] + distance * normal
        assert (points @ normal < at @ normal - 0.01).all()
        image = points - 2.0 * ((points - at) @ normal)[:, None] * normal
        seen = pixels(camera, (image - poses[1, :3, 3]) @ poses[1, :3, :3])
        assert ((seen > 10.0) & (seen < np.array(camera.size_px) - 11.0)).all()
    # What is resumed keeps them, though the plan has gone.
    assert run(*words[:4], "--out", out, "--resume", "--json").stdout


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--joint", "pan=0", "--joint", "lift=-20", "--joint", "elbow=-120"), "touches"),
        (("--joint", "pan=40"), "needed two ways to turn"),
        (("--joint", "pan=1", "--view", "0,0", "--view", "9,0"), "--view and --plan"),
    ],
)
def test_a_target_that_the_plans_room_does_not_allow_is_refused(
    planned: Path, tmp_path: Path, words: tuple[str, ...], said: str
) -> None:
    out = tmp_path / "corrected"
    told = run(
        "correct", "twin", "--session", planned, "--plan", planned / "plan", *words, "--no-pictures", "--out", out, code=1
    )  # fmt: skip
    assert said in " ".join(told.stderr.split()) and not out.exists()


def test_a_broken_plan_is_named(planned: Path, tmp_path: Path) -> None:
    from mirror_posture.plan.again import read_planned_room

    nominal = Nominal.load(planned)
    for change, said in (
        (lambda plan: plan.pop("options"), "options is missing"),
        (lambda plan: plan["options"].update(clearance_m="wide"), "plan.json"),
        (lambda plan: plan["options"].update(home={"pen": 0.1}), "pen"),
        (lambda plan: plan["options"].update(table_m=math.inf), "plan.json"),
        (lambda plan: plan["options"].update(mirror_at_m=[0.5, 0.0]), "plan.json"),
        (
            lambda plan: plan["options"].update(clearence_m=0.02),
            r"options.clearence_m is no key .*clearance_m",
        ),
        (lambda plan: plan.update(version=2), "version"),
    ):
        plan = json.loads((planned / "plan" / "plan.json").read_text())
        change(plan)
        for name in ("views.csv", "postures.csv"):
            (tmp_path / name).write_bytes((planned / "plan" / name).read_bytes())
        (tmp_path / "plan.json").write_text(json.dumps(plan))
        with pytest.raises(MirrorPostureError, match=said):
            read_planned_room(tmp_path, nominal)
    with pytest.raises(MirrorPostureError, match="there is no such file"):
        read_planned_room(tmp_path / "nowhere", nominal)


def test_a_plan_that_is_there_is_judged_as_when_it_was_made(planned: Path, tmp_path: Path) -> None:
    folder = tmp_path / "session"
    shutil.copytree(planned, folder)
    made = json.loads((planned / "plan" / "plan.json").read_text())
    judged = json.loads(run("plan", folder, "--judge", "--json").stdout)
    assert judged["cannot be taken"] == []
    for key in ("markers", "frames", "joints", "noise_px"):
        assert judged[key] == made[key], key
    assert judged["mirror"]["distance_from_board_m"] == pytest.approx(made["mirror"]["distance_from_board_m"])
    for view, before in zip(judged["mirror"]["views"], made["mirror"]["views"], strict=True):
        assert view["yaw_rad"] == pytest.approx(before["yaw_rad"], abs=1e-9)
        assert view["pitch_rad"] == pytest.approx(before["pitch_rad"], abs=1e-9)
    for one, before in zip(judged["tells"], made["tells"], strict=True):
        assert (one["effect"], one["at"]) == (before["effect"], before["at"])
        for name, size in before["parameters"].items():
            assert one["parameters"][name] == (None if size is None else pytest.approx(size, rel=1e-6))
    # A row is changed by hand: beyond a limit, into the table, out of sight.
    lines = (folder / "plan" / "postures.csv").read_text().splitlines()
    cells = lines[3].split(",")
    lines[3] = ",".join([*cells[:2], "0.0", "1.9", "0.0"])
    (folder / "plan" / "postures.csv").write_text("\n".join(lines) + "\n")
    told = run("plan", folder, "--judge", code=1)
    assert f"1 of {made['frames']} rows cannot be taken: frame {cells[0]}: " in " ".join(told.stderr.split())
    # Fewer rows tell less.
    (folder / "plan" / "postures.csv").write_text("\n".join(lines[:3] + lines[4:12]) + "\n")
    fewer = json.loads(run("plan", folder, "--judge", "--json").stdout)
    gear = [
        next(one["parameters"]["scale_error"] for one in document["tells"] if one["effect"] == "gear_ratio")
        for document in (fewer, made)
    ]
    assert gear[0] > gear[1]


def test_a_rehearsal_has_the_glass_that_was_planned_for(
    planned: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sizes: list[tuple[float, float]] = []

    class Painter:
        missing: tuple[str, ...] = ()

        def __init__(self, nominal: Nominal, size_m: tuple[float, float], preview: bool) -> None:
            sizes.append(size_m)

        def draw(self, *_: object) -> np.ndarray:
            return np.zeros((4, 4, 3), np.uint8)

        def close(self) -> None: ...

    monkeypatch.setattr("mirror_posture.shapes.mesh_pictures.MeshPainter", Painter)
    words = ["render", tmp_path / "look.png", "--template", planned, "--meshes", "--preview"]
    run(*words, "--plan", planned / "plan")
    run(*words, "--plan", planned / "plan", "--mirror-size", "30x40")
    run(*words, "--joint", "lift=30")
    assert sizes == [(WIDTH_M, HEIGHT_M), (0.3, 0.4), (0.4, 0.6)]


def test_the_schema_takes_a_real_plan_and_what_the_reader_takes(planned: Path, tmp_path: Path) -> None:
    document = json.loads((planned / "plan" / "plan.json").read_text())
    # One of each list is enough.
    document["mirror"]["views"] = document["mirror"]["views"][:1]
    told = next(one for one in document["tells"] if one["twins"])
    document["tells"] = [{**told, "twins": told["twins"][:1]}]
    file = tmp_path / "plan.json"

    def read(tree: object) -> object:
        file.write_text(json.dumps(tree))
        return read_options(file)

    assert read(document) == replace(read_options(planned / "plan" / "plan.json"))
    mistyped = [(f"{name} is mistyped", {**document, f"{name}s": document[name]}) for name in document]
    documents = [("as it is", document), *mistyped, *some(document, 9)]
    taken, refused = compare("plan", documents, read)
    assert taken > 20 and refused > 200
    assert MOST_VIEWS == len(YAWS_DEG) * len(PITCHES_DEG)


def test_a_mirror_whose_place_was_told_is_turned_there_and_not_moved(planned: Path, tmp_path: Path) -> None:
    from mirror_posture.plan.again import read_planned_room

    plan = json.loads((planned / "plan" / "plan.json").read_text())
    for name in ("views.csv", "postures.csv"):
        (tmp_path / name).write_bytes((planned / "plan" / name).read_bytes())
    q = np.array([table(planned / "plan" / "postures.csv")[name][3] for name in NAMES])
    nominal, moves, ways = Nominal.load(planned), [], []
    for told in (
        {"mirror_at_m": None},
        {"mirror_at_m": plan["mirror"]["views"][0]["center_in_root_m"]},
        {"mirror_fixed": True},
    ):
        (tmp_path / "plan.json").write_text(json.dumps({**plan, "options": {**plan["options"], **told}}))
        room = read_planned_room(tmp_path, nominal)
        moved = room.moved(room.mirrors[0], q, [0], 1.5)
        moves.append(float(np.linalg.norm(moved.center_in_root_m - room.mirrors[0].center_in_root_m)))
        ways.append(len(room.mirrors))
    assert moves[0] > 0.1 and moves[1:] == [0.0, 0.0]
    assert ways[0] == ways[1] > 50 and ways[2] == len(plan["mirror"]["views"])


def test_a_thumb_before_any_corner_of_the_board_hides_it(planned: Path, tmp_path: Path) -> None:
    """A ball of 8 mm on the way from the mirror to one corner, squares of 20 mm: the view is not planned."""
    from mirror_posture.plan.again import read_planned_room

    rows, views = table(planned / "plan" / "postures.csv"), table(planned / "plan" / "views.csv")
    q = np.array([rows[name][0] for name in NAMES])
    robot = Robot.from_urdf(planned / "robot.urdf")
    eye, board = (np.linalg.solve(p0, p) for p0, p in [
        (robot.link_poses(q[None], ["base", link])[0]) for link in ("session_camera_optical", "session_board")
    ])  # fmt: skip
    normal = np.array([views[f"normal_{a}"][0] for a in "xyz"])
    center = np.array([views[f"center_{a}_m"][0] for a in "xyz"])
    behind = eye[:3, 3] - 2.0 * ((eye[:3, 3] - center) @ normal) * normal
    for name in ("camera.yaml", "session.toml"):
        (tmp_path / name).write_bytes((planned / name).read_bytes())
    text = (planned / "robot.urdf").read_text()
    for x, y, hides in ((0, 1, True), (2, 1, True), (6, 3, True), (12, 1, False)):
        corner = board[:3, :3] @ np.array([(x - 3.0) * 0.02, (y - 1.5) * 0.02, 0.0]) + board[:3, 3]
        at = corner + 0.1 * (behind - corner) / np.linalg.norm(behind - corner)
        thumb = '<link name="thumb"><visual><geometry><sphere radius="0.004"/></geometry></visual></link><joint name="thumb" type="fixed"><parent link="turret"/><child link="thumb"/><origin xyz="{}"/></joint></robot>'
        turret = robot.link_poses(q[None], ["base", "turret"])[0]
        turret = np.linalg.solve(turret[0], turret[1])
        place = turret[:3, :3].T @ (at - turret[:3, 3])
        (tmp_path / "robot.urdf").write_text(
            text.replace("</robot>", thumb.format(" ".join(map(repr, place.tolist()))))
        )
        room = read_planned_room(planned / "plan", Nominal.load(tmp_path))
        good, why = room.takeable([room.mirrors[int(views["view"][0])]], q, [])
        assert (list(why) == ["the robot hides the board from the mirror"]) == hides == (not good), (
            x,
            y,
            why,
        )
