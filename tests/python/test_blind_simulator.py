"""The blind simulator against physics that is known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="blind sessions need MuJoCo")

from mirror_lab.blind import optics, robots
from mirror_lab.blind.body import Body
from mirror_lab.blind.drawn_robots import small_humanoid
from mirror_lab.blind.kinematics import Change, chain, moments
from mirror_lab.blind.truth import Commands, Loose, Truth

GRAVITY = np.array([0.0, 0.0, -9.81])
JOINT = "r_shoulder_pitch"


@pytest.fixture(scope="module")
def scene() -> tuple[robots.Robot, Commands]:
    rng = np.random.default_rng(2)
    robot = small_humanoid(rng)
    low = np.array([robot.ranges[j][0] for j in robot.commanded])
    high = np.array([robot.ranges[j][1] for j in robot.commanded])
    q = low + rng.random((14, len(low))) * (high - low)
    return robot, Commands(robot.commanded, q, 2.0 * np.arange(14))


def _error(robot: robots.Robot, commands: Commands, truth: Truth) -> np.ndarray:
    k = robot.commanded.index(JOINT)
    poses = Body(robot, truth, GRAVITY).run(commands)
    return poses.theta_rad[:, k] - commands.of(JOINT)


def test_without_faults_mujoco_and_plain_kinematics_agree(scene: tuple[robots.Robot, Commands]) -> None:
    robot, commands = scene
    poses = Body(robot, Truth(), GRAVITY).run(commands)
    at = chain(robot, commands, Change())
    for k, m in enumerate(robot.markers):
        np.testing.assert_allclose(poses.marker_m[:, k], at.position_m[robot.index[f"{m}_marker"]], atol=1e-9)


def test_a_spring_yields_by_the_torque_of_gravity_where_it_comes_to_rest(
    scene: tuple[robots.Robot, Commands],
) -> None:
    robot, commands = scene
    stiffness = 2.0
    error = _error(robot, commands, Truth(loose=[Loose(JOINT, stiffness=stiffness)]))
    body = robot.body_of_joint(JOINT)
    settled = chain(robot, commands, Change(joint_rad={JOINT: error}))
    torque = moments(robot, settled, GRAVITY, body) @ robot.bodies[body].axis
    assert np.abs(error).max() > 0.005
    np.testing.assert_allclose(error * stiffness, torque, atol=2e-3 * np.abs(torque).max())


def test_play_lies_on_the_side_of_the_load_at_half_its_width(scene: tuple[robots.Robot, Commands]) -> None:
    robot, commands = scene
    error = _error(robot, commands, Truth(loose=[Loose(JOINT, play_rad=0.04, friction_nm=1e-3)]))
    body = robot.body_of_joint(JOINT)
    torque = moments(robot, chain(robot, commands, Change()), GRAVITY, body) @ robot.bodies[body].axis
    clear = np.abs(torque) > 5e-3
    assert clear.sum() >= 8
    np.testing.assert_allclose(error[clear], 0.02 * np.sign(torque[clear]), atol=2e-4)


def test_play_follows_the_last_motion_where_friction_beats_the_load(
    scene: tuple[robots.Robot, Commands],
) -> None:
    robot, commands = scene
    error = _error(robot, commands, Truth(loose=[Loose(JOINT, play_rad=0.04, friction_nm=5.0)]))
    motion = np.diff(np.concatenate([[0.0], commands.of(JOINT)]))
    clear = np.abs(motion) > 0.05
    np.testing.assert_allclose(error[clear], -0.02 * np.sign(motion[clear]), atol=5e-4)


def test_a_sticking_servo_stops_short_by_its_dead_band(scene: tuple[robots.Robot, Commands]) -> None:
    robot, commands = scene
    stiffness, band = 60.0, 0.02
    error = _error(
        robot, commands, Truth(loose=[Loose(JOINT, stiffness=stiffness, friction_nm=stiffness * band)])
    )
    motion = np.diff(np.concatenate([[0.0], commands.of(JOINT)]))
    clear = np.abs(motion) > 0.1
    np.testing.assert_allclose(error[clear], -band * np.sign(motion[clear]), atol=0.25 * band)


def _mirror(n: int, rng: np.random.Generator, **kind: object) -> tuple[optics.Mirror, np.ndarray]:
    normal = np.array([0.0, 0.0, 1.0]) + rng.normal(0, 0.1, (n, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    point = rng.uniform([-0.2, -0.2, -0.05], [0.2, 0.2, 0.1], (n, 3))
    return optics.Mirror(normal, rng.uniform(0.25, 0.4, n), **kind), point  # type: ignore[arg-type]


def test_the_ray_through_glass_bends_by_snell_and_arrives() -> None:
    mirror, point = _mirror(50, np.random.default_rng(0), glass_m=0.006)
    seen = optics.apparent(mirror, point)
    direction = seen / np.linalg.norm(seen, axis=1)[:, None]
    # Walk the ray: to the front, refracted in, off the silver, refracted out, to the height of the point.
    for d, n, distance, p in zip(direction, mirror.normal, mirror.distance_m, point, strict=True):
        hit = d * (distance / (d @ n))
        across = (d - (d @ n) * n) / 1.52
        inside = across + np.sqrt(1 - across @ across) * n
        leaves = hit + 2 * mirror.glass_m * (across / (inside @ n))
        out = d - 2 * (d @ n) * n
        travelled = (p - leaves) @ out
        np.testing.assert_allclose(leaves + travelled * out, p, atol=1e-9)


@pytest.mark.parametrize("curvature", [0.3, -0.3])
def test_a_spherical_mirror_obeys_the_law_of_reflection(curvature: float) -> None:
    mirror, point = _mirror(50, np.random.default_rng(1), curvature_per_m=np.full(2, curvature))
    seen = optics.apparent(mirror, point)
    direction = seen / np.linalg.norm(seen, axis=1)[:, None]
    center = (mirror.distance_m - 1 / curvature)[:, None] * mirror.normal
    # Where the ray meets the sphere: the root of |t d − c|² = R² near the mirror's vertex.
    along = np.einsum("ni,ni->n", direction, center)
    root = np.sqrt(along**2 - np.einsum("ni,ni->n", center, center) + 1 / curvature**2)
    hit = direction * (along + np.sign(curvature) * root)[:, None]
    normal = (hit - center) * curvature
    out = direction - 2 * np.einsum("ni,ni->n", direction, normal)[:, None] * normal
    to_point = point - hit
    np.testing.assert_allclose(np.cross(out, to_point), 0, atol=1e-8)


def test_a_ball_is_seen_where_its_outline_is_and_a_thin_pane_is_nearly_a_bare_mirror() -> None:
    mirror, point = _mirror(20, np.random.default_rng(3))
    lens = optics.Lens(np.full(2, 700.0), np.array([400.0, 300.0]), np.zeros(5), (800, 600))
    seen = optics.apparent(mirror, point)
    radius = 0.01
    nearer = seen.copy()
    nearer[:, 2] -= radius**2 / seen[:, 2]
    np.testing.assert_allclose(optics.ball_images(lens, mirror, point, radius), lens.image(nearer), atol=4e-3)
    thin = optics.Mirror(mirror.normal, mirror.distance_m, glass_m=1e-9)
    np.testing.assert_allclose(lens.image(optics.apparent(thin, point)), lens.image(seen), atol=1e-4)


def test_the_image_of_a_point_beside_a_curved_mirror_or_behind_it_is_near_the_point() -> None:
    heights = np.concatenate([np.geomspace(1e-6, 0.3, 40), -np.geomspace(1e-6, 0.1, 10)])
    for curvature in (-0.05, 0.05):
        n = len(heights)
        mirror = optics.Mirror(
            np.tile([0.0, 0.0, 1.0], (n, 1)), np.ones(n), curvature_per_m=np.full(2, curvature)
        )
        beside = np.array([0.4, 0.2])
        sag = (1 - np.sqrt(1 - (curvature * beside) @ (curvature * beside))) / curvature
        point = np.column_stack([np.tile(beside, (n, 1)), 1 - sag - heights])
        seen = optics.apparent(mirror, point)
        assert np.isfinite(seen).all()
        # What lies on the surface is its own image, whatever the surface's shape.
        np.testing.assert_array_less(
            np.linalg.norm(seen - point, axis=1), 2.2 * np.abs(heights) + 2.2 * abs(sag) * (heights < 0)
        )
