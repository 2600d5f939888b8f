"""One session whose effect is withheld, in memory: draw a robot, postures, causes and noise; move the body, trace
the light."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from . import optics, robots
from .accidents import ACCIDENTS
from .body import Body, BodyPoses
from .described_robots import DESCRIBED, described_robot
from .drawing import View
from .drawn_robots import random_robot, small_humanoid
from .effects import VOCABULARY, Cause, Laws, Scene, transverse_axes
from .errors import BlindError, NoPlaceError
from .given_robots import SUFFIXES, from_file
from .imperfect import add_small_errors
from .known_robots import talos, unitree_g1, ur10
from .mistakes import MISTAKES, SLIPS, Told, draw_mistakes
from .mounting import Mounting, draw_mounting, rotation_of
from .noise import Noise, add_outliers, blob_errors, corner_errors, draw_noise
from .outside import OUTSIDE
from .resting import rest_elsewhere
from .truth import Commands, Truth
from .views import Plan, place_mirrors, plan_postures

Array = NDArray[np.float64]


PICTURE_CORNER_PX, PICTURE_BLOB_PX = 0.06, 0.1
"""Noise of a good detector on the drawn pictures, with which identifiability is judged."""


@dataclass(frozen=True)
class Options:
    """The settings of the drawing."""

    robots: Sequence[str] = ("small", "g1", "talos", "ur10", "random")
    causes: tuple[int, int] = (0, 4)
    outside_share: float = 0.15
    """Share of sessions with an effect that the vocabulary does not have."""
    outside_beside: float = 0.0
    """Share of the sessions with causes of the vocabulary that have an effect from outside it beside them."""
    none_share: float = 0.12
    simple_laws: bool = False
    plain_noise: bool = False
    frames: tuple[int, int] = (120, 310)
    least_postures: int = 45
    """The least number of postures, whatever the number of frames."""
    pictures: bool = False
    """Whether the session has pictures instead of image points."""
    renderer: str = "own"
    """What draws them: `own`, or `mitsuba`, which takes a hundred times as long."""
    by_hand: bool = False
    """Whether board, camera and markers are mounted by hand, and the zeros set so."""
    mistakes: bool = False
    """Whether each session has a whole mistake of a first day instead of other causes."""
    accidents: bool = False
    """Whether each session has one accident of its log or names instead, for which the vocabulary has no single word."""
    noise_told: bool = True
    """Whether the session states its noise."""
    rest_rad: float = 0.0
    """How far each joint rests from its logged position, in each posture by itself: one standard deviation."""
    imperfect: float = 0.0
    """How large small errors of every joint and link are: 1 is a kit of hobby servos."""


@dataclass
class Case:
    """A session in memory: the nominal side, what was seen, and the answer."""

    name: str
    robot: robots.Robot
    gravity: Array
    lens: optics.Lens
    nominal_lens: optics.Lens
    plan: Plan
    pixel_std_told: float
    corners_px: Array
    """(F, C, 2) as measured; NaN where not seen."""
    blobs_px: Array
    clean_corners_px: Array
    clean_blobs_px: Array
    mirror: optics.Mirror
    noise: Noise
    truth: Truth
    answer: dict[str, Any] = field(default_factory=dict)
    view: View | None = None
    """The scene of the pictures, where the session has pictures."""
    picture_of_frame: NDArray[np.int_] | None = None
    renderer: str = "own"
    mounting: Mounting | None = None
    told: Told | None = None
    """What is written where it differs from what was done."""
    noise_told: bool = True
    logged_off_rad: Array | None = None
    """(P, J): logged less true positions of the postures, where joints rest elsewhere."""


def _exp(turn: Array) -> Array:
    """Rotation matrix of a rotation vector."""
    angle = float(np.linalg.norm(turn))
    if angle == 0:
        return np.eye(3)
    x, y, z = turn / angle
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    result: Array = np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k
    return result


def camera_poses(poses: BodyPoses, truth: Truth, commands: Commands) -> tuple[Array, Array]:
    """The real camera's origins (P, 3) and rotations (P, 3, 3) in the root's frame."""
    rotation = poses.camera_rotation
    origin = poses.camera_m + np.einsum("pij,j->pi", rotation, truth.camera_shift_m)
    turned = rotation @ _exp(truth.camera_turn_rad)
    if truth.camera_sag_rad is not None:
        turned = np.stack([r @ _exp(v) for r, v in zip(turned, truth.camera_sag_rad(commands), strict=True)])
    return origin, turned


def scene_of(robot: robots.Robot, plan: Plan, gravity: Array, laws: Laws) -> Scene:
    """Typical loads of gravity at joints and across links, from a few of the postures."""
    body = Body(robot, Truth(), gravity)
    some = plan.commands.q_rad[:: max(1, len(plan.commands.q_rad) // 40)]
    torque = body.gravity_torque(some, robot.commanded)
    load = {j: float(np.sqrt(np.mean(torque[:, k] ** 2))) for k, j in enumerate(robot.commanded)}
    bending = body_moments(robot, body, some, gravity)
    return Scene(robot, plan.commands, gravity, load, bending, laws, len(plan.posture_of_frame))


def body_moments(robot: robots.Robot, body: Body, q: Array, gravity: Array) -> dict[int, float]:
    """RMS moment of gravity across each commanded link that carries a marker, N m, about its joint's
    origin."""
    m, d = body.model, body.data
    at = [body.address[j] for j in robot.commanded]
    links = [robot.body_of_joint(j) for j in robot.commanded if set(robot.moves(j)) - {"camera", "board"}]
    axes = {b: transverse_axes(robot, b) for b in links}
    squares = dict.fromkeys(links, 0.0)
    for row in q:
        d.qpos[:] = 0
        d.qpos[at] = row
        mujoco.mj_forward(m, d)
        for b in links:
            i = m.body(f"L:{robot.bodies[b].name}").id
            arm = d.subtree_com[i] - d.xpos[i]
            moment = d.xmat[i].reshape(3, 3).T @ np.cross(arm, m.body_subtreemass[i] * gravity)
            squares[b] += sum(float(moment @ a) ** 2 for a in axes[b]) / len(q)
    return {b: float(np.sqrt(s)) for b, s in squares.items()}


def draw_laws(rng: np.random.Generator, simple: bool) -> Laws:
    friction = float(rng.choice([rng.uniform(0.01, 0.2), rng.uniform(1.5, 3.0)], p=[0.75, 0.25]))
    if simple:
        return Laws(play_friction_share=friction)
    return Laws(
        play_load_share=float(rng.uniform(0, 0.12)),
        play_friction_share=friction,
        stiffening=float(rng.uniform(0, 0.15)),
        stiction_droop_share=float(rng.uniform(0.05, 0.4)),
        drift_bow=float(rng.uniform(-0.1, 0.1)),
        bend_at=float(rng.uniform(0.45, 0.55)),
    )


KINDS: dict[str, Callable[[np.random.Generator], robots.Robot]] = {
    "small": small_humanoid,
    "g1": unitree_g1,
    "talos": talos,
    "ur10": ur10,
    "random": random_robot,
    **{name: partial(described_robot, name) for name in DESCRIBED},
}
"""Robots that can be drawn by name."""


def draw_robot(kind: str, rng: np.random.Generator) -> robots.Robot:
    """A robot by its kind, or from the URDF or MJCF of that path."""
    if kind in KINDS:
        return KINDS[kind](rng)
    if Path(kind).suffix in SUFFIXES:
        return from_file(Path(kind), rng)
    raise BlindError(f"unknown robot {kind!r}; known are {', '.join(KINDS)}, and a URDF or MJCF file")


def draw_lens(robot: robots.Robot, rng: np.random.Generator, rich: bool) -> tuple[optics.Lens, optics.Lens]:
    """The nominal lens, with one radial coefficient as the file tells it, and the real one, which has more
    of them."""
    width, height = robot.image_size
    f = rng.uniform(*robot.focal_px)
    focal = np.array([f, f * rng.uniform(0.997, 1.003)])
    center = np.array([width / 2, height / 2]) + rng.uniform(-12, 12, 2)
    k = np.array([rng.uniform(-0.05, 0.05), 0, 0, 0, 0])
    nominal = optics.Lens(focal, center, k, robot.image_size)
    more = rng.normal(size=5) * np.array([0, 2e-4, 4e-6, 4e-6, 2e-4]) if rich else np.zeros(5)
    return nominal, optics.Lens(focal, center, k + more, robot.image_size)


@dataclass
class Seen:
    """What the real camera sees, without noise."""

    corners_px: Array
    """(F, C, 2)"""
    blobs_px: Array
    """(F, M, 2)"""
    view: View
    found: NDArray[np.bool_]
    """Indices of the planned frames that are visible in a mirror."""

    @property
    def mirror(self) -> optics.Mirror:
        return self.view.mirror


def see(
    robot: robots.Robot,
    truth: Truth,
    lens: optics.Lens,
    plan: Plan,
    poses: BodyPoses,
    mirror: optics.Mirror | None,
    rng: np.random.Generator,
) -> Seen:
    """The noise-free pixels of a session, and the scene before the camera; mirrors are placed where none are
    given."""
    origin, rotation = camera_poses(poses, truth, plan.commands)
    of = plan.posture_of_frame
    board = robots.board_points(robot, truth.board_scale, truth.board_warp_per_m)
    corners_root = poses.board_m[:, None] + np.einsum("pij,cj->pci", poses.board_rotation, board)
    corners = np.einsum("pji,pcj->pci", rotation, corners_root - origin[:, None])[of]
    arms = np.einsum("pji,pmj->pmi", rotation, poses.marker_m - origin[:, None])[of]
    found = np.ones(len(of), dtype=bool)
    if mirror is None:
        mirror, found = place_mirrors(robot, rng, lens, corners, arms)
        mirror.glass_m, mirror.curvature_per_m = truth.glass_m, truth.curvature_per_m
        corners, arms, mirror = corners[found], arms[found], mirror.rows(np.flatnonzero(found))
    time = plan.time_of_frame_s[found]
    factor = np.full(len(time), 1 + truth.focal_scale)
    if truth.focal_error is not None:
        factor = factor * (1 + truth.focal_error(time))

    def repeated(k: int) -> tuple[optics.Mirror, Array]:
        return mirror.rows(np.repeat(np.arange(len(time)), k)), np.repeat(factor, k)

    frames, c, m = len(time), corners.shape[1], arms.shape[1]
    mirror_c, factor_c = repeated(c)
    corners_px = lens.image(optics.apparent(mirror_c, corners.reshape(-1, 3)), factor_c).reshape(frames, c, 2)
    mirror_m, factor_m = repeated(m)
    blobs = optics.ball_images(lens, mirror_m, arms.reshape(-1, 3), robot.marker_diameter_m / 2, factor_m)
    kept = of[found]
    view = View(
        np.einsum("pji,pj->pi", rotation, poses.board_m - origin)[kept],
        (np.swapaxes(rotation, 1, 2) @ poses.board_rotation)[kept],
        arms,
        mirror,
        factor,
        robot.board_square_m * (1 + truth.board_scale),
        truth.board_warp_per_m,
    )
    return Seen(corners_px, blobs.reshape(frames, m, 2), view, found)


Part = Literal["all", "named", "outside"]
"""Which of a session's causes are in it."""


def simulate(
    name: str,
    kind: str,
    draws: Sequence[str],
    rng: np.random.Generator,
    options: Options,
    part: Part = "all",
) -> Case:
    """One session with the named causes (of the vocabulary or outside it, whole mistakes, slips), in memory.

    Where one from outside the vocabulary stands beside others, `part` tells whether the session has all of them, only those that have a
    name, or only that from outside: each at the same place and of the same size.
    """
    made = MISTAKES | ACCIDENTS
    mistakes = [d for d in draws if d in made]
    slips = [d for d in draws if d in SLIPS]
    draws = [d for d in draws if d not in made and d not in SLIPS]
    beside = [d for d in draws if d in OUTSIDE] if len(draws) > 1 else []
    draws = [d for d in draws if d not in beside]
    robot = draw_robot(kind, rng)
    tilt = rng.normal(0, 0.12, 2) if rng.random() < 0.35 else np.zeros(2)
    gravity = 9.81 * np.array(
        [np.sin(tilt[0]), np.cos(tilt[0]) * np.sin(tilt[1]), -np.cos(tilt[0]) * np.cos(tilt[1])]
    )
    gravity = np.round(gravity, 6)
    nominal_lens, real = draw_lens(robot, rng, rich=not options.simple_laws)
    plan = plan_postures(robot, rng, options.frames, options.least_postures)
    laws = draw_laws(rng, options.simple_laws)
    noise = draw_noise(rng, robot.image_size[0], options.plain_noise)
    if options.pictures:
        noise = Noise(PICTURE_CORNER_PX, PICTURE_BLOB_PX)
    scene = scene_of(robot, plan, gravity, laws)
    truth = Truth()
    causes: list[Cause] = []
    for effect in draws:
        causes.append(_draw_apart(effect, rng, scene, truth, causes))
    # A generator of its own: with and without it the other causes and the mounts are the same.
    apart = rng.spawn(1)[0] if beside else rng
    if part == "outside":
        truth = Truth()
    for effect in beside if part != "named" else []:
        causes.append(_draw_apart(effect, apart, scene, truth, causes))
    if part == "outside":
        causes = causes[-len(beside) :]
    small: list[Cause] = []
    if options.imperfect > 0:
        # A generator of its own: with and without small errors causes and mounts are the same. Not all that follows is, because mirrors
        # are placed by what is seen.
        small = add_small_errors(rng.spawn(1)[0], scene, truth, options.imperfect)
    lens = optics.Lens(
        real.focal_px,
        real.center_px + truth.center_shift_px,
        real.distortion + truth.distortion,
        real.size_px,
        truth.shear,
    )
    mounting = draw_mounting(rng, robot) if options.by_hand else None
    if mounting is not None:
        mounting.add_to(truth, robot)
    poses = Body(robot, truth, gravity).run(plan.commands)
    if mounting is not None:
        mounting.moved(poses)
    seen = see(robot, truth, lens, plan, poses, None, rng)
    for slip in slips:
        causes.append(_slipped(slip, rng, robot, truth, lens, plan, poses, seen))
    corners, blobs, mirror = seen.corners_px, seen.blobs_px, seen.mirror
    kept = Plan(plan.commands, plan.posture_of_frame[seen.found], plan.time_of_frame_s[seen.found])
    corners_px = corners + corner_errors(noise, rng, len(corners), robot.board_corners)
    blobs_px = add_outliers(noise, rng, blobs + blob_errors(noise, rng, *blobs.shape[:2]))
    size = np.array(robot.image_size)
    for px in (corners_px, blobs_px):
        px[np.any(~((px >= 0) & (px <= size - 1)), axis=-1)] = np.nan
    blobs_px[rng.random(blobs_px.shape[:2]) < rng.choice([0.0, 0.0, 0.03])] = np.nan
    source = np.arange(len(corners_px))
    if truth.pairing is not None:
        first, last, shift = truth.pairing
        last = min(last, len(corners_px) - 4)
        source[first : last + 1] += shift
        corners_px, blobs_px = corners_px[source], blobs_px[source]
        causes[[c["effect"] for c in causes].index("pairing")]["last_frame"] = last
    told = round(float((noise.corner_px + noise.blob_px) / 2 * rng.uniform(0.85, 1.2)), 3)
    nominal = Body(robot, Truth(), gravity).run(plan.commands)
    gap = marker_gap(poses, nominal, kept.posture_of_frame)
    case = Case(
        name,
        robot,
        gravity,
        lens,
        nominal_lens,
        kept,
        told,
        corners_px,
        blobs_px,
        corners,
        blobs,
        mirror,
        noise,
        truth,
    )
    if options.pictures:
        case.view, case.picture_of_frame, case.renderer = seen.view, source, options.renderer
    case.answer = {
        "id": name,
        "robot": robot.kind,
        "causes": causes,
        "pixel_std_corner": noise.corner_px,
        "pixel_std_blob": noise.blob_px,
        "outlier_fraction": noise.outlier_fraction,
        "true_marker_gap_rms_m": gap,
        "noise": noise.answer(),
        "laws": vars(laws),
        "lens": [float(x) for x in lens.distortion],
        "unsettled_postures": poses.unsettled,
    }
    if mounting is not None:
        case.mounting = mounting
        case.answer["setup"] = mounting.answer(robot)
        case.answer["zeros_rad"], case.answer["tolerances_stated"] = mounting.zeros_rad, mounting.stated
    if small:
        case.answer["small"] = small
    case.noise_told = options.noise_told
    if mistakes:
        if options.rest_rad > 0:
            # The true log, which a mistake then changes, already has the joints elsewhere.
            rest_elsewhere(case, options.rest_rad, rng.spawn(1)[0])
        case.told = draw_mistakes(rng, mistakes, case, made)
    return case


SLIP_M, SLIP_RAD = 0.008, 0.025
"""Typical slip: of glue that gives, or a camera that was knocked."""


def _slipped(
    slip: str,
    rng: np.random.Generator,
    robot: robots.Robot,
    truth: Truth,
    lens: optics.Lens,
    plan: Plan,
    poses: BodyPoses,
    seen: Seen,
) -> Cause:
    """From a row on a part is displaced: that row and all later ones are computed again, with the same mirrors."""
    rows = np.flatnonzero(seen.found)
    kept = Plan(plan.commands, plan.posture_of_frame[rows], plan.time_of_frame_s[rows])
    first = int(rng.integers(len(rows) // 4, 3 * len(rows) // 4))
    shift = rng.normal(0, SLIP_M / np.sqrt(3), 3)
    turn = np.zeros(3) if slip == "slip_marker" else rng.normal(0, SLIP_RAD / np.sqrt(3), 3)
    later, slipped = copy.deepcopy(poses), copy.copy(truth)
    at = slip.removeprefix("slip_")
    if at == "marker":
        k = int(rng.integers(len(robot.markers)))
        at = f"marker:{robot.markers[k]}"
        if truth.loose or truth.bends:
            raise NoPlaceError("a marker slips on a body that stands still between rows only")
        again = copy.copy(truth)
        again.origin_shift_m = dict(truth.origin_shift_m)
        index = robot.index[f"{robot.markers[k]}_marker"]
        again.origin_shift_m[index] = again.origin_shift_m.get(index, np.zeros(3)) + shift
        later.marker_m = Body(robot, again, np.array([0, 0, -9.81])).run(plan.commands).marker_m
    elif at == "board":
        later.board_m = later.board_m + later.board_rotation @ shift
        later.board_rotation = later.board_rotation @ rotation_of(turn)
    else:
        # The slip is given in the camera's frame before it.
        before = rotation_of(truth.camera_turn_rad)
        slipped.camera_shift_m = truth.camera_shift_m + before @ shift
        slipped.camera_turn_rad = _turn_of(before @ rotation_of(turn))
    after = see(robot, slipped, lens, kept, later, seen.mirror, rng)
    seen.corners_px[first:], seen.blobs_px[first:] = after.corners_px[first:], after.blobs_px[first:]
    told = dict(zip(("dx_m", "dy_m", "dz_m"), shift.tolist(), strict=True))
    if slip != "slip_marker":
        told |= dict(zip(("rx_rad", "ry_rad", "rz_rad"), turn.tolist(), strict=True))
    return {
        "effect": "slip",
        "at": at,
        "first_frame": first,
        **told,
        "mistake": slip,
        "detectable": True,
        "identifiable": True,
        "rivals": [],
    }


def _turn_of(rotation: Array) -> Array:
    """Rotation vector of a small rotation."""
    axis = np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    sine = float(np.linalg.norm(axis)) / 2
    result: Array = axis / 2 * (np.arcsin(min(sine, 1.0)) / sine if sine > 0 else 1.0)
    return result


def marker_gap(poses: BodyPoses, nominal: BodyPoses, of: NDArray[np.int_]) -> float:
    """RMS distance of true from nominal markers, both in the root's frame, m."""
    return float(np.sqrt(np.mean(np.sum((poses.marker_m - nominal.marker_m)[of] ** 2, axis=-1))))


def _draw_apart(
    effect: str, rng: np.random.Generator, scene: Scene, truth: Truth, causes: list[Cause]
) -> Cause:
    """Draw an effect at a place that no other cause has taken."""
    law = VOCABULARY.get(effect) or OUTSIDE.get(effect)
    if law is None:
        raise BlindError(f"unknown effect {effect!r}; known are {', '.join([*VOCABULARY, *OUTSIDE])}")
    taken = {c["at"].split("<-")[0] for c in causes}
    for _ in range(100):
        trial = copy.copy(truth)
        for key, value in vars(truth).items():
            if isinstance(value, (list, dict)):
                setattr(trial, key, copy.copy(value))
        cause = law(rng, scene, trial)
        if cause["at"].split("<-")[0] not in taken:
            vars(truth).update(vars(trial))
            return cause
    raise NoPlaceError(f"no free place left for {effect!r}")
