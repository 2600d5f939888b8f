"""Measuring, detection, correction and diagnosis beside named peers in one run, the results compared.

    python benches/side_by_side.py [--markers 100000] [--views 1000] [--postures 100000] [--frames 130]

Times are the best of several runs. The per-item loops run on a part of the batch and are scaled up.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import time
from collections.abc import Callable
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import cv2
import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from mirror_posture import Board, Camera
from mirror_posture.mirror import Rig, estimate_mirrors
from mirror_posture.triangulate import two_view_markers

FOCAL_PX = 693.0
MATRIX = np.array([[FOCAL_PX, 0.0, 399.5], [0.0, FOCAL_PX, 299.5], [0.0, 0.0, 1.0]])
LENS = np.array([-0.21, 0.07, 8e-4, -6e-4, 0.01])
BOARD_M = np.array([0.0, 0.075, 0.0])
LOOP_PART = 2_000
"""Items on which a per-item loop is timed: it is linear in their number."""


def best_s(run: Callable[[], Any], repeats: int = 5) -> tuple[float, Any]:
    """Best wall time of some runs, s, and the result."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        result = run()
        times.append(time.perf_counter() - start)
    return min(times), result


def scene(count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Reflected boards (N, 2, 3) and marker pixels (N, 2, 2) of random mirrors and markers."""
    markers = rng.uniform([-0.09, 0.02, 0.0], [0.09, 0.1, 0.04], (count, 3))
    normals = rng.normal([0.0, 0.0, 1.0], [0.02, 0.02, 0.0], (count, 2, 3))
    normals[:, 1, 0] += 0.25
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    offsets = rng.uniform(0.14, 0.16, (count, 2))

    def reflected(points: np.ndarray) -> np.ndarray:
        distance = offsets - np.einsum("nki,nki->nk", normals, points)
        return points + 2.0 * distance[..., None] * normals

    boards = reflected(np.broadcast_to(BOARD_M, (count, 2, 3)))
    seen = reflected(np.repeat(markers[:, None], 2, axis=1)).reshape(-1, 3)
    pixels = cv2.projectPoints(seen, np.zeros(3), np.zeros(3), MATRIX, LENS)[0].reshape(count, 2, 2)
    return boards, pixels + rng.normal(0.0, 0.2, pixels.shape)


def one_marker(boards: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """The paper's measurement of one marker as one writes it with NumPy and OpenCV."""
    directions, origins = [], []
    undistorted = cv2.undistortPoints(pixels[:, None], MATRIX, LENS)[:, 0]
    for reflected, (x, y) in zip(boards, undistorted, strict=True):
        across = reflected - BOARD_M
        normal = across / np.linalg.norm(across)
        offset = normal @ (reflected + BOARD_M) / 2.0
        ray = np.array([x, y, 1.0])
        ray /= np.linalg.norm(ray)
        origins.append(2.0 * offset * normal)
        directions.append(ray - 2.0 * (normal @ ray) * normal)
    between = origins[1] - origins[0]
    cross = np.cross(directions[0], directions[1])
    squared = cross @ cross
    t = np.cross(between, directions[1]) @ cross / squared
    s = np.cross(between, directions[0]) @ cross / squared
    return (origins[0] + t * directions[0] + origins[1] + s * directions[1]) / 2.0


def all_markers(boards: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """The same for all markers at once in vectorised NumPy (OpenCV undistorts all pixels in one call)."""
    undistorted = cv2.undistortPoints(pixels.reshape(-1, 1, 2), MATRIX, LENS).reshape(-1, 2, 2)
    across = boards - BOARD_M
    normals = across / np.linalg.norm(across, axis=2, keepdims=True)
    offsets = np.einsum("nki,nki->nk", normals, boards + BOARD_M) / 2.0
    rays = np.concatenate([undistorted, np.ones((*undistorted.shape[:2], 1))], axis=2)
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)
    origins = 2.0 * offsets[..., None] * normals
    directions = rays - 2.0 * np.einsum("nki,nki->nk", normals, rays)[..., None] * normals
    between = origins[:, 1] - origins[:, 0]
    cross = np.cross(directions[:, 0], directions[:, 1])
    squared = np.einsum("ni,ni->n", cross, cross)
    t = np.einsum("ni,ni->n", np.cross(between, directions[:, 1]), cross) / squared
    s = np.einsum("ni,ni->n", np.cross(between, directions[:, 0]), cross) / squared
    return (
        origins[:, 0] + t[:, None] * directions[:, 0] + origins[:, 1] + s[:, None] * directions[:, 1]
    ) / 2.0


class Report:
    """A table of peers, each with its time beside ours."""

    def __init__(self, title: str, unit: str) -> None:
        self.table = Table(title=title)
        for column in ("who", f"µs a {unit}", "ours is faster by", "largest difference"):
            self.table.add_column(column, justify="left" if column == "who" else "right")

    def add(self, who: str, seconds: float, ours_s: float | None, difference: str) -> None:
        ratio = "" if ours_s is None else f"{seconds / ours_s:.1f}"
        self.table.add_row(who, "" if np.isnan(seconds) else f"{seconds * 1e6:.3f}", ratio, difference)


def markers_report(camera: Camera, count: int) -> Report:
    boards, pixels = scene(count, np.random.default_rng(1))
    ours_s, ours = best_s(lambda: two_view_markers(camera, BOARD_M, boards, pixels))
    vector_s, vector = best_s(lambda: all_markers(boards, pixels))
    part = min(count, LOOP_PART)
    loop_s, loop = best_s(lambda: np.array([one_marker(boards[i], pixels[i]) for i in range(part)]), 2)
    report = Report(f"{count:,} two-view markers (two planes by Eq. 2, two virtual rays, midpoint)", "marker")
    each = ours_s / count
    report.add("mirror_posture.two_view_markers", each, None, "")
    report.add(
        "NumPy, vectorised", vector_s / count, each, f"{difference_m(ours.points_in_camera_m, vector)}"
    )
    report.add(
        "NumPy and OpenCV, loop", loop_s / part, each, f"{difference_m(ours.points_in_camera_m[:part], loop)}"
    )
    return report


def difference_m(ours: np.ndarray, theirs: np.ndarray) -> str:
    """OpenCV's undistortion stops after some steps, ours when it is exact: that is the difference."""
    return f"{np.abs(ours - theirs).max() * 1e6:.3f} µm"


def mirrors_report(camera: Camera, count: int) -> Report:
    rng = np.random.default_rng(2)
    iy, ix = np.divmod(np.arange(35), 7)
    board = np.column_stack([(ix - 3) * 0.014, (iy - 2) * 0.014, np.zeros(35)])
    normals = rng.normal([0.1, 0.05, 1.0], [0.1, 0.1, 0.0], (count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = board + BOARD_M
    reflected = points + 2.0 * (0.15 - normals @ points.T)[..., None] * normals[:, None]
    corners = cv2.projectPoints(reflected.reshape(-1, 3), np.zeros(3), np.zeros(3), MATRIX, LENS)[0]
    corners = corners.reshape(count, 35, 2) + rng.normal(0.0, 0.2, (count, 35, 2))
    camera_from_board = np.eye(4)
    camera_from_board[:3, 3] = BOARD_M
    rig = Rig(camera, Board(7, 5, 0.014), camera_from_board)
    ours_s, ours = best_s(lambda: estimate_mirrors(rig, corners))
    pair_s, pair = best_s(lambda: estimate_mirrors(rig, corners, estimator="point_pair"))

    def opencv() -> np.ndarray:
        found = []
        for view in corners[:LOOP_PART]:
            _, rotation, shift = cv2.solvePnP(board, view, MATRIX, LENS, flags=cv2.SOLVEPNP_IPPE)
            rotation, shift = cv2.solvePnPRefineLM(board, view, MATRIX, LENS, rotation, shift)
            across = shift[:, 0] - BOARD_M
            normal = across / np.linalg.norm(across)
            found.append(normal * (normal @ (shift[:, 0] + BOARD_M) / 2.0))
        return np.array(found)

    theirs_s, theirs = best_s(opencv, 2)
    part = len(theirs)
    report = Report(f"{count:,} mirrors from 35 corners", "view")
    report.add("mirror_posture, maximum likelihood with covariance", ours_s / count, None, "")
    report.add("mirror_posture, Eq. 2 with covariance", pair_s / count, ours_s / count, "")
    report.add(
        "OpenCV solvePnP (IPPE, refined), Eq. 2 without covariance, loop",
        theirs_s / part,
        ours_s / count,
        f"{difference_m(pair.foot_points_m[:part], theirs)} (Eq. 2)",
    )
    assert ours.valid.all()
    return report


def kinematics_report(count: int) -> Report:
    import pinocchio

    from mirror_posture.robot import Robot

    # The robots' package is a namespace of files: its own loader would import meshes too.
    root = Path(pinocchio.__file__).parents[4] / "share/example-robot-data/robots"
    urdf = next(root.glob("g1_description/**/g1_29dof_rev_1_0.urdf"))
    robot = Robot.from_urdf(urdf)
    model = pinocchio.buildModelFromUrdf(str(urdf))
    data = model.createData()
    names = list(model.names)[1:]
    rng = np.random.default_rng(3)
    postures = rng.uniform(-0.5, 0.5, (count, len(robot.position_names)))
    order = [robot.position_names.index(name) for name in names]
    ours_s, ours = best_s(lambda: robot.forward_kinematics(postures))
    part = min(count, 20_000)

    def theirs() -> np.ndarray:
        out = np.empty((part, model.nframes, 3))
        for row, posture in enumerate(postures[:part]):
            pinocchio.framesForwardKinematics(model, data, posture[order])
            out[row] = [frame.translation for frame in data.oMf]
        return out

    def only() -> None:
        for posture in postures[:part]:
            pinocchio.framesForwardKinematics(model, data, posture[order])

    theirs_s, _ = best_s(only, 2)
    with_results_s, seen = best_s(theirs, 1)
    links = [i for i, frame in enumerate(model.frames) if frame.name in robot.link_names]
    mine = [robot.link_names.index(model.frames[i].name) for i in links]
    off = np.abs(ours[:part][:, mine][..., :3, 3] - seen[:, links]).max()
    report = Report(f"{count:,} postures, poses of all links, {urdf.stem}", "posture")
    report.add("mirror_posture.Robot.forward_kinematics", ours_s / count, None, "")
    report.add("pinocchio, loop, results left in place", theirs_s / part, ours_s / count, "")
    report.add("pinocchio, loop, positions copied out", with_results_s / part, ours_s / count, f"{off:.1e} m")
    return report


def detection_report() -> Report:
    """A drawn picture of the embedded robot: board and balls found, beside OpenCV's board alone."""
    from mirror_posture.detect import detect_picture, predictions_from_session, setup_from_session
    from mirror_posture.render import DEMO_POSTURES, View, render_session
    from mirror_posture.session import load_session

    with TemporaryDirectory() as name:
        folder = Path(name) / "session"
        render_session(folder, DEMO_POSTURES[:1], [View(0.1, 0.05)])
        session = load_session(folder)
        picture = cv2.imread(str(session.image_files[0]))
    board, prediction = session.board, predictions_from_session(session)[0]
    assert board is not None
    setup = setup_from_session(session)
    ours_s, ours = best_s(lambda: detect_picture(picture, setup, prediction), 3)

    def opencv() -> np.ndarray:
        gray = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
        flags = cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_NORMALIZE_IMAGE
        _, corners = cv2.findChessboardCornersSB(gray, board.corners, flags=flags)
        return np.asarray(corners).reshape(-1, 2)

    theirs_s, theirs = best_s(opencv, 3)
    seen = next(view for view in ours.boards if view.ok)
    assert seen.corners_px is not None
    # OpenCV numbers the mirrored board otherwise: each of its corners is compared with the nearest of ours.
    away = np.linalg.norm(theirs[:, None] - seen.corners_px[None], axis=2).min(axis=1)
    report = Report("One picture of 800 × 600 px", "picture")
    report.add("mirror_posture: labelled board and balls, with covariances", ours_s, None, "")
    report.add("OpenCV findChessboardCornersSB, without balls", theirs_s, ours_s, f"{away.max():.2f} px")
    return report


def correction_report() -> Report:
    """One damped step of three markers and nine joints, beside the same pseudo-inverse in NumPy."""
    from mirror_posture.correct import correction_step

    rng = np.random.default_rng(5)
    jacobian, error = rng.normal(0.0, 0.1, (9, 9)), rng.normal(0.0, 0.01, 9)
    damping, gain = 0.01, 0.2
    wide, free = np.full(9, 3.0), [True] * 9

    def step() -> Any:
        return correction_step(
            jacobian, error.reshape(3, 3), np.stack([1e-6 * np.eye(3)] * 3), np.zeros(9), -wide, wide, free,
            gain=gain, largest_step_rad=10.0, mu_m_per_rad=damping,
        )  # fmt: skip

    ours_s, ours = best_s(step, 20)

    def numpy() -> np.ndarray:
        return gain * jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + damping**2 * np.eye(9), error)

    theirs_s, theirs = best_s(numpy, 20)
    report = Report("One damped step of 9 joints", "step")
    report.add("mirror_posture.correct.correction_step", ours_s, None, "")
    report.add("NumPy", theirs_s, ours_s, f"{np.abs(ours.change - theirs).max():.1e} rad")
    return report


def diagnosis_report(frames: int) -> Report:
    """A session with one hidden joint offset: a diagnosis, beside SciPy's fit of each single offset and gear ratio.

    The peer takes the measured markers, fits one number a joint and cause, and puts the least sum of squares first; it
    has no alternatives, no held-out regions and no other effects.
    """
    from scipy.optimize import least_squares

    import mirror_posture as mp
    from mirror_lab.blind.make import make_cases
    from mirror_lab.blind.simulate import Options

    with TemporaryDirectory() as name:
        plan = [("one", "small", ["joint_offset"])]
        (folder,) = make_cases(
            Path(name), 1, 3, Options(robots=("small",), frames=(frames, frames + 1)), plan
        )
        session = mp.load_session(folder)
        ours_s, found = best_s(lambda: mp.diagnose(session), 1)
        truth = json.loads((Path(name) / "answers" / "one.json").read_text(encoding="utf-8"))
        urdf = session.robot_file.read_text(encoding="utf-8")
    markers = mp.measure(session).markers
    good = np.flatnonzero(markers.measured)
    first = np.array([np.flatnonzero(session.frames.posture == markers.posture[k])[0] for k in good])
    base = np.array(session.positions)[first]
    robot = session.robot

    def points(positions: np.ndarray) -> np.ndarray:
        poses = robot.link_poses(positions, [session.camera_link, *(m.link for m in session.markers)])
        camera_from = np.linalg.inv(poses[:, :1]) @ poses
        return camera_from[np.arange(len(good)), 1 + markers.marker[good], :3, 3]

    def scipy() -> str:
        best = (np.inf, "")
        for column, joint in enumerate(robot.position_names):
            for effect in ("joint_offset", "gear_ratio"):

                def residual(x: np.ndarray, column: int = column, effect: str = effect) -> np.ndarray:
                    moved = base.copy()
                    moved[:, column] += x[0] if effect == "joint_offset" else x[0] * base[:, column]
                    return (points(moved) - markers.point_in_camera_m[good]).ravel()

                best = min(best, (least_squares(residual, [0.0]).cost, f"{effect}@joint:{joint}"))
        return best[1]

    theirs_s, named = best_s(scipy, 1)
    ours = ", ".join(f"{cause.effect}@{cause.at}" for cause in found.causes) or found.verdict
    report = Report(f"A session of {frames} frames, one cause hidden: {_told(truth)}", "session")
    report.add(f"mirror_posture.diagnose: {ours}", ours_s, None, "")
    report.add(f"SciPy least_squares of each offset and gear: {named}", theirs_s, ours_s, "")
    try:
        # Its import takes seconds and is not timed.
        importlib.import_module("figaroh.calibration.calibration_tools")
    except ImportError:
        report.add("figaroh: left out, needs the package `figaroh`", float("nan"), None, "")
    else:
        figaroh_s, offset = best_s(lambda: figaroh_offset(session, urdf, markers), 1)
        report.add(f"figaroh, zeros of each marker's chain: {offset}", figaroh_s, ours_s, "")
    return report


def figaroh_offset(session: Any, urdf: str, markers: Any) -> str:
    """figaroh's calibration of the joints' zeros, marker by marker, from the camera's frame to the marker's.

    It has no mirrors and no causes to choose from: given are the measured markers; named is the zero that is the most of its own
    standard deviations from 0. Base and tip of each chain are told to be known, as they are in the session.
    """
    import pinocchio
    from figaroh.calibration import BaseCalibration
    from figaroh.calibration.calibration_tools import calc_updated_fkm

    class Zeros(BaseCalibration):
        def cost_function(self, var: np.ndarray) -> Any:
            moved = calc_updated_fkm(self.model, self.data, var, self.q_measured, self.calib_config)
            return self.PEE_measured - moved

    robot = pinocchio.RobotWrapper(pinocchio.buildModelFromXML(urdf))
    best = (0.0, "")
    with TemporaryDirectory() as name, redirect_stdout(StringIO()):
        table, config = Path(name) / "measured.csv", Path(name) / "figaroh.json"
        for k, marker in enumerate(session.markers):
            rows = np.flatnonzero(markers.measured & (markers.marker == k))
            first = [np.flatnonzero(session.frames.posture == markers.posture[row])[0] for row in rows]
            header = ",".join([*session.robot.position_names, "x1", "y1", "z1"])
            measured = np.hstack([np.array(session.positions)[first], markers.point_in_camera_m[rows]])
            np.savetxt(table, measured, delimiter=",", header=header, comments="")
            task = {
                "enabled": True,
                "type": "kinematic_calibration",
                "kinematics": {"base_frame": session.camera_link, "tool_frame": marker.link},
                "measurements": {
                    "markers": [{"measurable_dof": [True] * 3 + [False] * 3}],
                    "poses": {"base_pose": [0.0] * 6, "tool_pose": [0.0] * 6},
                },
                "parameters": {"calibration_level": "joint_offset"},
                "data": {"source_file": str(table), "number_of_samples": len(rows)},
            }
            # JSON is YAML.
            config.write_text(json.dumps({"robot": {"name": "robot"}, "tasks": {"calibration": task}}))
            zeros = Zeros(robot, str(config))
            zeros.calib_config.update(known_baseframe=True, known_tipframe=True)
            zeros.initialize()
            zeros.solve(enable_logging=False)
            told = zip(zeros.calib_config["param_name"], zeros.LM_result.x, zeros.std_dev, strict=True)
            for parameter, value, std in told:
                best = max(best, (abs(value) / std, f"joint_offset@joint:{parameter.split('_', 1)[1]}"))
    return best[1]


def _told(answer: Any) -> str:
    return ", ".join(f"{cause['effect']}@{cause['at']}" for cause in answer["causes"])


def main(
    markers: Annotated[int, typer.Option(help="Two-view markers in the batch.")] = 100_000,
    views: Annotated[int, typer.Option(help="Views of the board in the batch.")] = 10_000,
    postures: Annotated[int, typer.Option(help="Postures in the batch.")] = 100_000,
    frames: Annotated[int, typer.Option(help="Frames of the diagnosed session.")] = 130,
) -> None:
    """Measuring, detection, correction and diagnosis beside NumPy, OpenCV, pinocchio, SciPy and figaroh."""
    console = Console()
    camera = Camera((800, 600), (FOCAL_PX, FOCAL_PX), (399.5, 299.5), "plumb_bob", LENS.tolist())
    console.print(markers_report(camera, markers).table)
    console.print(mirrors_report(camera, views).table)
    try:
        console.print(kinematics_report(postures).table)
    except (ImportError, StopIteration):
        console.print("kinematics: left out, needs the packages `pin` and `example-robot-data`")
    console.print(detection_report().table)
    console.print(correction_report().table)
    if missing := [name for name in ("scipy", "mirror_lab") if importlib.util.find_spec(name) is None]:
        console.print(f"diagnosis: left out, needs the packages {' and '.join(missing)}")
    else:
        console.print(diagnosis_report(frames).table)


if __name__ == "__main__":
    typer.run(main)
