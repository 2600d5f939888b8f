"""The columns of a plan's sensitivity against differences of the model itself, and what it tells against plain least squares."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from mirror_posture.camera import Camera
from mirror_posture.plan.causes import Cause, Moment
from mirror_posture.plan.options import MirrorPlace, PlanOptions
from mirror_posture.plan.sensitivity import Sensitivity
from mirror_posture.plan.setting import Setting, read_setting
from mirror_posture.plan.sight import scene_of
from mirror_posture.plan.telling import SURE, what_it_tells
from mirror_posture.robots import Nominal

FRAMES, SECONDS = 20, 2.0


@pytest.fixture(scope="module")
def setting() -> Setting:
    return read_setting(Nominal.load(), PlanOptions())


@pytest.fixture(scope="module")
def sensitivity(setting: Setting) -> Sensitivity:
    return Sensitivity(setting, SECONDS, FRAMES)


@pytest.fixture(scope="module")
def mirror(setting: Setting) -> MirrorPlace:
    camera = scene_of(setting, setting.home[None]).camera_from_base[0]
    at = -camera[:3, :3].T @ camera[:3, 3]
    normal = setting.forward + 0.1 * np.cross(setting.up, setting.forward)
    normal /= np.linalg.norm(normal)
    top = setting.up - (setting.up @ normal) * normal
    return MirrorPlace(at + 0.35 * setting.forward, normal, top / np.linalg.norm(top), 0.6, 0.6)


def moment_of(setting: Setting) -> Moment:
    share = np.linspace(0.35, 0.65, len(setting.low))
    q = setting.low + share * (setting.high - setting.low)
    torque = np.linspace(-0.2, 0.3, len(q))
    return Moment(q, np.where(np.arange(len(q)) % 2, 1.0, -1.0), torque, 7.0)


def pixels(
    setting: Setting, positions: np.ndarray, mirror: MirrorPlace, camera: Camera, foot_m: np.ndarray
) -> np.ndarray:
    """Of the board's outer corners and the markers, (N, 2): reflected at a plane in the camera's frame, then a pinhole with its lens."""
    return seen(camera, points_of(setting, positions), foot_m)


def points_of(setting: Setting, positions: np.ndarray) -> np.ndarray:
    """The board's outer corners and the markers in the camera's frame, (N, 3)."""
    scene = scene_of(setting, positions[None])
    return np.concatenate([scene.corners[0], scene.markers[0]])


def seen(camera: Camera, points: np.ndarray, foot_m: np.ndarray) -> np.ndarray:
    normal = foot_m / np.linalg.norm(foot_m)
    return camera.project(points - 2.0 * (points @ normal - np.linalg.norm(foot_m))[:, None] * normal)


def foot_of(setting: Setting, positions: np.ndarray, mirror: MirrorPlace) -> np.ndarray:
    camera = scene_of(setting, positions[None]).camera_from_base[0]
    normal = camera[:3, :3] @ mirror.normal_in_root
    return float(normal @ (camera[:3, :3] @ mirror.center_in_root_m + camera[:3, 3])) * normal


def without_the_mirror(
    setting: Setting, moment: Moment, mirror: MirrorPlace, weight: np.ndarray
) -> np.ndarray:
    """Projects the mirror's three numbers out of whitened pixels."""
    foot, camera = foot_of(setting, moment.positions, mirror), setting.camera
    step = 1e-6
    by_foot = np.stack(
        [
            (pixels(setting, moment.positions, mirror, camera, foot + step * e)
            - pixels(setting, moment.positions, mirror, camera, foot - step * e)) / (2.0 * step)
            for e in np.eye(3)
        ],
        axis=-1,
    )  # fmt: skip
    columns = (weight[:, None, None] * by_foot).reshape(-1, 3)
    return np.eye(len(columns)) - columns @ np.linalg.pinv(columns)


@pytest.mark.parametrize(
    ("effect", "error"),
    [
        ("joint_offset", lambda m, k: 1.0),
        ("gear_ratio", lambda m, k: m.positions[k]),
        ("gear_eccentricity", lambda m, k: np.sin(m.positions[k])),
        # A play of width w: the joint stays half of it behind the side that it came from.
        ("backlash", lambda m, k: -0.5 * m.side[k]),
        ("joint_compliance", lambda m, k: m.torque_nm[k]),
        ("drift", lambda m, k: m.time_s),
    ],
)
def test_a_joints_columns_are_what_its_error_does_to_the_pixels(
    setting: Setting, sensitivity: Sensitivity, mirror: MirrorPlace, effect: str, error
) -> None:
    ideal = replace(
        setting, nominal=replace(setting.nominal, metadata=replace(setting.nominal.metadata, mirror=None))
    )
    moment = moment_of(setting)
    markers = np.ones(len(setting.nominal.metadata.markers), dtype=bool)
    made = Sensitivity(ideal, SECONDS, FRAMES).jacobian(moment, mirror, markers)
    weight = np.full(4 + len(markers), 1.0 / setting.noise_px)
    # Four corners stand for all of the board's.
    weight[:4] *= np.sqrt(setting.board.corner_count / 4)
    projected = without_the_mirror(setting, moment, mirror, weight)
    tried = 0
    for name in setting.joint_names:
        cause = next((c for c in sensitivity.causes if c.name == f"{effect}@joint:{name}"), None)
        if cause is None:
            continue
        k = setting.nominal.robot.position_index(name)
        step = 1e-6 * np.eye(len(setting.home))[k] * error(moment, k)
        foot = foot_of(setting, moment.positions, mirror)
        change = pixels(setting, moment.positions + step, mirror, setting.camera, foot) - pixels(
            setting, moment.positions - step, mirror, setting.camera, foot
        )
        wanted = projected @ (weight[:, None] * change / 2e-6).ravel()
        found = made[:, cause.columns.start]
        # Pixels' rows are projected by an orthonormal basis: the same up to rounding.
        assert found == pytest.approx(wanted, rel=1e-3, abs=1e-3 * max(1.0, np.abs(wanted).max()))
        tried += int(np.abs(wanted).max() > 1.0)
    assert tried >= 3


@pytest.mark.parametrize("effect", ["camera_mount", "board_mount"])
def test_a_mounts_columns_are_what_its_displacement_does_to_the_pixels(
    setting: Setting, sensitivity: Sensitivity, mirror: MirrorPlace, effect: str
) -> None:
    ideal = replace(
        setting, nominal=replace(setting.nominal, metadata=replace(setting.nominal.metadata, mirror=None))
    )
    moment, markers = moment_of(setting), np.ones(len(setting.nominal.metadata.markers), dtype=bool)
    made = Sensitivity(ideal, SECONDS, FRAMES).jacobian(moment, mirror, markers)
    weight = np.full(4 + len(markers), 1.0 / setting.noise_px)
    weight[:4] *= np.sqrt(setting.board.corner_count / 4)
    projected = without_the_mirror(setting, moment, mirror, weight)
    points, foot = points_of(setting, moment.positions), foot_of(setting, moment.positions, mirror)
    (columns,) = (c.columns for c in sensitivity.causes if c.effect == effect)

    def moved(axis: np.ndarray, turns: bool, step: float) -> np.ndarray:
        out = points.copy()
        if effect == "camera_mount":
            # The camera moves, and all that it sees the other way.
            out -= step * (np.cross(axis, points) if turns else axis)
        else:
            board = points[:4]
            out[:4] += step * (np.cross(axis, board - board.mean(axis=0)) if turns else axis)
        return seen(setting.camera, out, foot)

    for k in range(6):
        axis, turns, step = np.eye(3)[k % 3], k < 3, 1e-6
        change = (moved(axis, turns, step) - moved(axis, turns, -step)) / (2.0 * step)
        wanted = projected @ (weight[:, None] * change).ravel()
        assert made[:, columns.start + k] == pytest.approx(wanted, rel=1e-3, abs=1e-3 * np.abs(wanted).max())


def test_four_corners_tell_about_as_much_as_the_whole_board(
    setting: Setting, sensitivity: Sensitivity, mirror: MirrorPlace
) -> None:
    moment, none = moment_of(setting), np.zeros(len(setting.nominal.metadata.markers), dtype=bool)
    (focal,) = (c.columns.start for c in sensitivity.causes if c.effect == "camera_focal")
    few, all_of_them = (
        sensitivity.jacobian(moment, mirror, none, whole)[:, focal] for whole in (False, True)
    )
    # Outer corners have a longer lever than those inside.
    assert 1.0 < few @ few / (all_of_them @ all_of_them) < 3.5


def test_the_set_up_is_known_by_its_tolerances(setting: Setting) -> None:
    metadata = replace(
        setting.nominal.metadata,
        markers=tuple(replace(m, tolerance_m=0.002) for m in setting.nominal.metadata.markers),
    )
    made = Sensitivity(replace(setting, nominal=replace(setting.nominal, metadata=metadata)), SECONDS, FRAMES)
    known = made.prior_precision()
    for cause in made.causes:
        if cause.effect == "marker_mount":
            assert known[cause.columns] == pytest.approx(1.0 / 0.002**2)
        elif not cause.effect.endswith("_mount"):
            assert (known[cause.columns] == 0.0).all()


def test_sizes_that_are_found_surely_are_those_of_least_squares_beside_the_set_up() -> None:
    random = np.random.default_rng(4)
    typical = (0.035, 3e-3, 3e-3, 3e-3)
    joint = Cause("joint_offset", "joint:a", ("offset_rad",), typical[:1], slice(0, 1))
    mount = Cause("marker_mount", "marker:b", ("dx_m", "dy_m", "dz_m"), typical[1:], slice(1, 4))
    prior = np.array([0.0, *[1.0 / 0.004**2] * 3])
    rows = [
        random.normal(size=(6, 4)) * [80.0, 400.0, 500.0, 300.0] + [[60.0, 300.0, 0.0, 0.0]] for _ in range(5)
    ]
    plan = SimpleNamespace(causes=[joint, mount], width=4, prior_precision=lambda: prior)
    told = {tells.name: tells for tells in what_it_tells(plan, rows)}  # type: ignore[arg-type]
    j = np.concatenate(rows)
    # The joint's deviation with the mount fitted beside it under its tolerance.
    std = np.sqrt(np.linalg.inv(j.T @ j + np.diag(prior))[0, 0])
    assert told["joint_offset@joint:a"].parameters["offset_rad"] == pytest.approx(SURE * std, rel=1e-6)
    # A mount's own tolerance does not tell it: each of its numbers alone.
    alone = SURE / np.sqrt(j[:, 2] @ j[:, 2])
    assert told["marker_mount@marker:b"].parameters["dy_m"] == pytest.approx(alone, rel=1e-6)
