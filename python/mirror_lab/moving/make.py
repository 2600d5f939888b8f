"""Makes one session in motion whose causes are withheld, with the user's MJCF of the robot and a second
session for checking only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from ..blind import optics
from ..blind.drawn_robots import two_arms
from ..blind.made_of import begin_set
from ..blind.noise import Noise, add_outliers, blob_errors, corner_errors, draw_noise
from ..blind.robots import Robot, board_points
from ..blind.seal import seal
from ..blind.simulate import draw_lens, draw_robot
from ..blind.views import place_mirrors
from ..blind.whole_file import remove_unfinished, whole_folder
from .causes import LAWS, Body, Usual
from .engine import KEPT_S, Engine, Servos, Track
from .shows import LAWS_OF_POSITION, Bent, rivals_of
from .write import write_session

Array = NDArray[np.float64]

ROBOTS = ("small", "random", "ur10")
TWO_ARMS = "two-arms"
"""A kind of this judge's own: fourteen joints."""
LOG_RATE_HZ, PICTURES_HZ = 100.0, 30.0
TICK_RAD = 2 * np.pi / 4096
EXPOSED = 3
"""Moments of an exposure whose images are averaged."""


@dataclass(frozen=True)
class Shutter:
    """s: of a row, and from the first row to the last."""

    exposure_s: float
    readout_s: float


def make_case(
    folder: Path,
    kind: str,
    effects: Sequence[str],
    rng: np.random.Generator,
    seconds: float = 20.0,
    sealed_in: Path | None = None,
) -> dict[str, Any]:
    """Writes `folder` (the session, with `model.xml`) and `folder-unseen` (another motion of the same body); returns the answer.

    `sealed_in`: a folder to which the answer goes, with its seal in the session.
    """
    robot = two_arms(rng) if kind == TWO_ARMS else draw_robot(kind, rng)
    gravity = np.array([0.0, 0.0, -9.81])
    moving = [j for j in robot.commanded if robot.ranges[j][1] - robot.ranges[j][0] > 0.05]
    engine = Engine(robot.urdf, moving, gravity)
    low = np.array([robot.ranges[j][0] for j in moving])
    high = np.array([robot.ranges[j][1] for j in moving])
    inertia = np.mean([engine.inertia(rng.uniform(low, high)) for _ in range(10)], axis=0)
    armature = inertia * rng.uniform(0.2, 0.6, len(moving))
    rate, ratio = rng.uniform(25, 45, len(moving)), rng.uniform(0.6, 1.0, len(moving))
    stiffness = rate**2 * (inertia + armature)
    damping = 2 * ratio * rate * (inertia + armature)
    times = np.arange(0.0, seconds + 0.5, 1 / LOG_RATE_HZ)
    commands = draw_motion(rng, times, low, high)
    unseen = draw_motion(rng, times, low, high)
    ideal = Servos.ideal(stiffness, damping, armature)
    nominal = engine.run(times[: len(times) // 2], commands[: len(times) // 2], ideal)
    usual = Usual(
        np.sqrt(np.mean(nominal.load**2, axis=0)) + 1e-9,
        np.quantile(np.abs(nominal.torque), 0.998, axis=0),
        np.quantile(np.abs(np.gradient(commands, times, axis=0)), 0.998, axis=0),
        inertia,
    )
    zero = np.zeros(len(moving))
    body = Body(ideal, zero.copy(), zero.copy(), zero.copy(), float(rng.uniform(0, 0.1)), zero.copy())
    causes: list[dict[str, Any]] = []
    visible = [j for j, name in enumerate(moving) if set(robot.moves(name)) - {"camera", "board"}]
    for effect in effects:
        for _ in range(50):
            j = int(rng.choice(visible))
            at = f"joint:{moving[j]}"
            if not any(c["at"] == at for c in causes):
                break
        causes.append(LAWS[effect](rng, body, usual, j, moving[j], robot.markers))
    nominal_lens, lens = draw_lens(robot, rng, rich=False)
    noise = draw_noise(rng, robot.image_size[0])
    shutter = Shutter(float(rng.uniform(0.002, 0.01)), float(rng.choice([0.0, rng.uniform(0.008, 0.02)])))
    told = round(float((noise.corner_px + noise.blob_px) / 2 * rng.uniform(0.85, 1.2)), 3)
    model = _users_model(robot, moving, stiffness, damping, armature)
    seen = []
    lawful = [moving.index(c["at"][6:]) for c in causes if c["effect"] in LAWS_OF_POSITION]
    for motion in (commands, unseen):
        track = engine.run(times, motion, body.servos)
        pictures = _see(robot, engine, track, body, lens, noise, shutter, rng, seconds, nominal_lens, lawful)
        if motion is commands:
            _tell_rivals(causes, moving, track, body, pictures, noise.blob_px)
        seen.append(((times, motion, _readings(track, times)), pictures))
    answer = {
        "id": folder.name, "robot": kind, "causes": causes, "noise": noise.answer(), "seconds": seconds,
        "shutter": vars(shutter),
    }  # fmt: skip
    # The session is written last, after its second motion and its answer.
    for place, (log, pictures) in zip(
        (folder.with_name(f"{folder.name}-unseen"), folder), reversed(seen), strict=True
    ):
        with whole_folder(place) as part:
            write_session(part, robot, gravity, nominal_lens, told, shutter, moving, log, pictures)
            (part / "model.xml").write_text(model, encoding="utf-8")
            if place == folder and sealed_in is not None:
                seal(answer, sealed_in / f"{folder.name}.json", part / "seal.json")
    return answer


def draw_motion(rng: np.random.Generator, times: Array, low: Array, high: Array) -> Array:
    """(S, joints): three sines a joint about a drawn centre within its range, with rests of about a second in between."""
    # The rests are pauses of the sines' time.
    pace = np.ones(len(times))
    for start in rng.uniform(2, times[-1] - 2, max(1, int(times[-1] / 8))):
        pace *= 1 - np.exp(-(((times - start) / 0.5) ** 4))
    clock = np.cumsum(pace) * (times[1] - times[0])
    out = np.empty((len(times), len(low)))
    for j in range(len(low)):
        weight = rng.uniform(0.3, 1.0, 3)
        weight /= weight.sum()
        wave = sum(
            w * np.sin(2 * np.pi * f * clock + p)
            for w, f, p in zip(
                weight, rng.uniform([0.1, 0.25, 0.5], [0.25, 0.5, 1.1]), rng.uniform(0, 6.3, 3), strict=True
            )
        )
        half = 0.5 * (high[j] - low[j]) * rng.uniform(0.6, 0.95)
        out[:, j] = 0.5 * (low[j] + high[j]) + np.minimum(half, 0.8) * wave
    return np.round(out, 6)


def _readings(track: Track, time_s: Array) -> Array:
    """(S, joints): what encoders of the motors read, in ticks."""
    return np.asarray(np.round(track.at(time_s) / TICK_RAD) * TICK_RAD)


def _positions(track: Track, body: Body, time_s: Array) -> Array:
    """Where the links stand at times of any shape: (..., joints)."""
    q, load, side = _position_load_side(track, time_s)
    usual = np.sqrt(np.mean(track.load**2, axis=0)) + 1e-12
    give = body.give * load * (1 - body.stiffening * np.minimum(np.abs(load) / (3 * usual), 1))
    return np.asarray(q * (1 + body.scale) + body.offset + give + 0.5 * body.play * side)


def _position_load_side(track: Track, time_s: Array) -> tuple[Array, Array, Array]:
    """At times of any shape, by joint: the motor's position, the load, and on which side of a play the joint lies."""
    usual = np.sqrt(np.mean(track.load**2, axis=0)) + 1e-12
    return track.at(time_s), track.at(time_s, track.load), track.at(time_s, _sides(track.load, usual))


def _tell_rivals(
    causes: list[dict[str, Any]], joints: list[str], track: Track, body: Body, seen: Seen, noise_px: float
) -> None:
    """Adds to each cause with a law of position the other laws that explain these pictures as well."""
    q, load, side = _position_load_side(track, seen.shown_s)
    for cause in causes:
        if cause["effect"] in LAWS_OF_POSITION:
            j = joints.index(cause["at"][6:])
            bent = Bent(q[:, j], load[:, j], side[:, j], seen.by_joint[j])
            true = {
                "joint_offset": body.offset[j], "gear_ratio": body.scale[j] * bent.position,
                "joint_compliance": body.give[j] * bent.load, "backlash": 0.5 * body.play[j] * bent.side,
            }[cause["effect"]]  # fmt: skip
            cause["rivals"] = rivals_of(cause, true, bent, noise_px)


def _sides(load: Array, usual: Array) -> Array:
    """The side of its play on which each joint rests: it changes within 8 ms after its load has changed sign by 3 % of the typical load."""
    out = np.empty_like(load)
    goal = np.where(load[0] >= 0, 1.0, -1.0)
    now = goal.copy()
    share = 1 - np.exp(-KEPT_S / 0.004)
    for i, row in enumerate(load):
        goal = np.where(np.abs(row) > 0.03 * usual, np.sign(row), goal)
        now = now + share * (goal - now)
        out[i] = now
    return out


@dataclass
class Seen:
    """What is written of the pictures."""

    stamp_s: Array
    corners_px: Array
    blobs_px: Array
    shown_s: Array
    """The body's time at each picture."""
    by_joint: dict[int, Array]
    """(F, M, 2) of the joints asked for: derivatives of the markers' images without noise, px/rad."""


BEND_RAD = 1e-4


def _see(
    robot: Robot, engine: Engine, track: Track, body: Body, lens: optics.Lens, noise: Noise, shutter: Shutter,
    rng: np.random.Generator, seconds: float, nominal_lens: optics.Lens, asked: Sequence[int] = (),
) -> Seen:  # fmt: skip
    stamps = np.arange(0.1, seconds, 1 / PICTURES_HZ)
    stamps = stamps + rng.normal(0, 0.0008, len(stamps))
    middle = stamps + 0.5 * (shutter.exposure_s + shutter.readout_s)

    def scene(time_s: Array, bend: int | None = None) -> tuple[Array, Array]:
        """Board corners (N, C, 3) and markers (N, M, 3) in the camera's frame at times (N,) of the pictures' clock.

        `bend`: a joint that stands farther by `BEND_RAD`.
        """
        q = _positions(track, body, time_s - body.latency_s)
        if bend is not None:
            q[:, bend] += BEND_RAD
        links = [robot.camera_link, robot.board_link, *(f"{m}_marker" for m in robot.markers)]
        poses = engine.frames(q, links)
        camera = poses[:, 0] @ _pose(body.camera_turn, body.camera_shift)
        into = np.linalg.inv(camera)
        board = np.column_stack([board_points(robot), np.ones(len(board_points(robot)))])
        corners = np.einsum("nij,cj->nci", into @ poses[:, 1], board)[..., :3]
        points = np.stack(
            [
                poses[:, 2 + k] @ np.append(body.marker_shift.get(m, np.zeros(3)), 1.0)
                for k, m in enumerate(robot.markers)
            ],
            axis=1,
        )
        return corners, np.einsum("nij,nmj->nmi", into, points)[..., :3]

    corners, arms = scene(middle)
    mirror, found = place_mirrors(robot, rng, lens, corners, arms)
    mirror, stamps = mirror.rows(np.flatnonzero(found)), stamps[found]
    frames, markers, count = len(stamps), len(robot.markers), corners.shape[1]
    repeat = np.repeat(np.arange(frames), markers)

    def images(marker_time: Array, bend: int | None = None) -> Array:
        """(F, M, 2) of markers at their own moments (F, M)."""
        points = np.empty((frames, markers, 3))
        for m in range(markers):
            points[:, m] = scene(marker_time[:, m], bend)[1][:, m]
        out: Array = optics.ball_images(
            lens, mirror.rows(repeat), points.reshape(-1, 3), robot.marker_diameter_m / 2
        )
        return out.reshape(frames, markers, 2)

    start = stamps[:, None] + np.zeros((1, markers))
    centre = start + 0.5 * (shutter.exposure_s + shutter.readout_s)
    blobs = images(centre)
    by_joint = {j: (images(centre, j) - blobs) / BEND_RAD for j in asked}
    row = np.clip(np.nan_to_num(blobs[..., 1], nan=lens.size_px[1] / 2), 0, lens.size_px[1])
    at_row = start + shutter.readout_s * row / lens.size_px[1]
    share = (np.arange(EXPOSED) + 0.5) / EXPOSED
    blobs = np.mean([images(at_row + s * shutter.exposure_s) for s in share], axis=0)
    # Corners are exposed row by row, as the markers are; within a picture their motion is a parabola in time.
    parts = [scene(stamps + 0.5 * shutter.exposure_s + s * shutter.readout_s)[0] for s in (0.0, 0.5, 1.0)]

    def corner_images(points: Array) -> Array:
        seen = lens.image(
            optics.apparent(mirror.rows(np.repeat(np.arange(frames), count)), points.reshape(-1, 3))
        )
        return np.asarray(seen.reshape(frames, count, 2))

    middle_row = np.nan_to_num(corner_images(parts[1])[..., 1], nan=lens.size_px[1] / 2)
    s = np.clip(middle_row / lens.size_px[1], 0, 1)[..., None]
    at_own_row = (
        2 * (s - 0.5) * (s - 1) * parts[0] - 4 * s * (s - 1) * parts[1] + 2 * s * (s - 0.5) * parts[2]
    )
    seen = corner_images(at_own_row)
    corners_px = seen + corner_errors(noise, rng, frames, robot.board_corners)
    blobs_px = add_outliers(noise, rng, blobs + blob_errors(noise, rng, frames, markers))
    size = np.array(robot.image_size)
    for px in (corners_px, blobs_px):
        px[np.any(~((px >= 0) & (px <= size - 1)), axis=-1)] = np.nan
    blobs_px[rng.random(blobs_px.shape[:2]) < 0.01] = np.nan
    return Seen(stamps, corners_px, blobs_px, centre[:, 0] - body.latency_s, by_joint)


def _pose(turn: Array, shift: Array) -> Array:
    out = np.eye(4)
    angle = float(np.linalg.norm(turn))
    if angle > 0:
        x, y, z = turn / angle
        k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        out[:3, :3] += np.sin(angle) * k + (1 - np.cos(angle)) * k @ k
    out[:3, 3] = shift
    return out


def _users_model(robot: Robot, joints: list[str], stiffness: Array, damping: Array, armature: Array) -> str:
    """The user's simulator: the URDF as MJCF with position servos of the nominal gains."""
    text = robot.urdf.replace(
        f'<robot name="{robot.urdf.split(chr(34))[1]}">',
        f'<robot name="{robot.urdf.split(chr(34))[1]}"><mujoco><compiler fusestatic="false" balanceinertia="true" '
        'boundmass="1e-6" boundinertia="1e-9" discardvisual="true"/></mujoco>',
        1,
    )
    spec = mujoco.MjSpec.from_string(text)
    for name, k, d, a in zip(joints, stiffness, damping, armature, strict=True):
        joint = spec.joint(name)
        joint.armature, joint.limited = a, mujoco.mjtLimited.mjLIMITED_FALSE
        # The drawn robots' URDFs state an effort that no motor of theirs has.
        joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
        servo = spec.add_actuator(name=f"servo_{name}", target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        servo.set_to_position(kp=k, kv=d)
    spec.compile()
    return str(spec.to_xml())


def make_cases(
    out: Path,
    cases: int,
    seed: int,
    robots: Sequence[str] = ROBOTS,
    causes: tuple[int, int] = (0, 3),
    seconds: float = 20.0,
    only: Sequence[str] = (),
) -> list[Path]:
    """Writes moving sessions with 0 to 3 drawn causes (of `only`, if told); the answers, sealed, to the folder `answers`. Sessions that
    exist are not made again.

    Raises:
        ValueError: an effect in `only` of which the judge has no law, or numbers of causes that contradict each other or `only`;
            `BlindError`, where the folder's sessions were made with another seed or other options.
    """
    if unknown := sorted(set(only) - set(LAWS)):
        raise ValueError(f"effects: got {', '.join(unknown)}, needed some of {', '.join(sorted(LAWS))}")
    laws = sorted(set(only)) or sorted(LAWS)
    if not 0 <= causes[0] <= causes[1]:
        raise ValueError(
            f"causes: got at least {causes[0]} and at most {causes[1]}; needed a least number up to the largest"
        )
    if causes[0] > len(laws):
        raise ValueError(
            f"causes: got at least {causes[0]} of {', '.join(laws)}; needed at most {len(laws)}, since a session has each effect once"
        )
    begin_set(out, seed, {"robots": robots, "causes": causes, "seconds": seconds, "only": sorted(set(only))})
    made = []
    for place in (out, out / "answers"):
        remove_unfinished(place)
    for number in range(cases):
        rng = np.random.default_rng([seed, number])
        kind = robots[number % len(robots)]
        count = (
            int(rng.choice([0, 1, 2, 3], p=[0.2, 0.4, 0.25, 0.15]))
            if causes == (0, 3)
            else int(rng.integers(causes[0], causes[1] + 1))
        )
        effects = [str(e) for e in rng.choice(laws, size=min(count, len(laws)), replace=False)]
        name = f"case-{number:04d}"
        if not ((out / name / "seal.json").is_file() and (out / "answers" / f"{name}.json").is_file()):
            make_case(out / name, kind, effects, rng, seconds, out / "answers")
        made.append(out / name)
    return made
