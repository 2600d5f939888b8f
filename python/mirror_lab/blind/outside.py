"""Effects that the vocabulary lacks, with their true places."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from .effects import Cause, Draw, Scene, _direction, _pick, _signed, _size, long_axis
from .truth import Bend, Commands, MarkerSwing, Truth


def _unknown(kind: str, at: str, **sizes: float) -> Cause:
    return {"effect": "unknown", "at": at, "kind": kind, **{k: float(v) for k, v in sizes.items()}}


def second_harmonic(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    """theta = q + a sin(m q + phase), m 3 to 5: teeth, or an elliptic gear."""
    j, a, phase, m = (
        _pick(rng, scene.joints(), "it"),
        _size(rng, 0.012, 0.05),
        rng.uniform(0, 6.28),
        rng.uniform(3, 5),
    )
    truth.servo.append((j, lambda c: a * np.sin(m * c.of(j) + phase)))
    return _unknown("second_harmonic", f"joint:{j}", amplitude_rad=a, order=m)


def quadratic_coupling(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    """theta_J = q_J + c (q_K - middle)²."""
    joints = scene.joints()
    j = _pick(rng, joints, "it")
    k = _pick(
        rng, [x for x in joints if x != j and set(scene.robot.moves(x)) & set(scene.robot.moves(j))], "it"
    )
    low, high = scene.robot.ranges[k]
    c = _signed(rng, 0.02, 0.08) / ((high - low) / 2) ** 2
    truth.servo.append((j, lambda q: c * (q.of(k) - (low + high) / 2) ** 2))
    return _unknown(
        "quadratic_coupling", f"joint:{j}", with_joint_index=scene.robot.commanded.index(k), coefficient=c
    )


def warm_up(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    """theta = q + a exp(-t / T), T a small part of the session: calibrated warm, started cold."""
    j, a = _pick(rng, scene.joints(), "it"), _signed(rng, 0.02, 0.07)
    constant = float(scene.commands.time_s[-1]) * rng.uniform(0.05, 0.15)
    truth.servo.append((j, lambda c: a * (np.exp(-c.time_s / constant))))
    return _unknown("warm_up", f"joint:{j}", amplitude_rad=a, time_constant_s=constant)


def cable(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    """A cable pulls a joint towards a posture, once it is taut: a smooth ramp in the joint's angle and its
    neighbour's."""
    joints = scene.joints()
    j = _pick(rng, joints, "it")
    k = _pick(
        rng, [x for x in joints if x != j and set(scene.robot.moves(x)) & set(scene.robot.moves(j))], "it"
    )
    (jl, jh), (kl, kh) = scene.robot.ranges[j], scene.robot.ranges[k]
    a = _signed(rng, 0.03, 0.09)

    def pull(c: Commands) -> np.ndarray:
        x = (c.of(j) - jl) / (jh - jl) + (c.of(k) - kl) / (kh - kl) - 1.1
        return a * np.logaddexp(0, 8 * x) / 8

    truth.servo.append((j, pull))
    return _unknown("cable", f"joint:{j}", amplitude_rad=a)


def bouc_wen(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    """Hysteresis with memory: z follows Bouc and Wen's law of the joint's path, theta = q - a z."""
    j, a, reach = _pick(rng, scene.joints(), "it"), _size(rng, 0.015, 0.06), rng.uniform(0.6, 1.5)

    def lag(c: Commands) -> np.ndarray:
        path = np.concatenate([[0.0], c.of(j)])
        z, out = 0.0, []
        for before, after in pairwise(path):
            step = (after - before) / 100
            for _ in range(100):
                z += step / reach * (1 - abs(z) * (0.5 + 0.5 * np.sign(step * z)))
            out.append(-a * z)
        return np.array(out)

    truth.servo.append((j, lag))
    return _unknown("bouc_wen", f"joint:{j}", amplitude_rad=a, reach_rad=reach)


def knee(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    """A transmission with a knee: right on one side of an angle, wrong in proportion beyond it."""
    j, a = _pick(rng, scene.joints(), "it"), _size(rng, 0.03, 0.09)
    low, high = scene.robot.ranges[j]
    knee = low + (high - low) * rng.uniform(0.4, 0.6)
    sign = float(rng.choice([-1.0, 1.0]))
    truth.servo.append((j, lambda c: sign * a * np.maximum(0.0, c.of(j) - knee) / (high - knee)))
    return _unknown("knee", f"joint:{j}", amplitude_rad=a, knee_rad=knee)


def marker_swing(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    """A marker on a soft stem hangs along gravity."""
    m = _pick(rng, scene.robot.markers, "it")
    reach = _size(rng, 0.6, 2.0) * scene.robot.length_scale_m
    truth.swings.append(MarkerSwing(m, reach))
    return _unknown("marker_swing", f"marker:{m}", reach_m=reach)


def link_torsion(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    """A link twists about its own long axis under load."""
    robot = scene.robot
    most = max(scene.bending_nm.values())
    bodies = [b for b, m in scene.bending_nm.items() if m > 0.1 * most and robot.next_body(b) is not None]
    # A link whose joint turns about its own long axis would be a compliant joint.
    bodies = [b for b in bodies if abs(long_axis(robot, b) @ robot.bodies[b].axis) < 0.7]
    name = _pick(rng, [robot.bodies[b].name for b in bodies], "it")
    body = robot.index[name]
    compliance = _size(rng, 0.03, 0.12) / scene.bending_nm[body]
    truth.bends.append(Bend(body, long_axis(robot, body), 1 / compliance, np.zeros(3)))
    return _unknown("link_torsion", f"link:{name}", compliance_rad_per_nm=compliance)


def rolling_shear(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    """Rows shift sideways in proportion to their height: a rolling shutter."""
    truth.shear = _signed(rng, 0.004, 0.02)
    return _unknown("rolling_shear", "camera", shear=truth.shear)


def tangential_lens(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    """A decentred lens."""
    p = _size(rng, 0.002, 0.008)
    phase = rng.uniform(0, 6.28)
    truth.distortion = truth.distortion + np.array([0, 0, p * np.cos(phase), p * np.sin(phase), 0])
    return _unknown("tangential_lens", "camera", size=p)


def focal_breathing(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    """The focal length wanders with the lens' temperature, up and down."""
    e, period = _signed(rng, 0.006, 0.02), float(scene.commands.time_s[-1]) * rng.uniform(0.4, 0.8)
    truth.focal_error = lambda t: e * np.sin(2 * np.pi * t / period)
    return _unknown("focal_breathing", "camera", scale_error=e, period_s=period)


def camera_wobble(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    """The camera's mount yields when an arm is raised: its rotation follows one joint of the body."""
    k = _pick(rng, scene.joints(), "it")
    low, high = scene.robot.ranges[k]
    turn = _direction(rng) * _size(rng, 0.008, 0.03)
    truth.camera_sag_rad = lambda c: np.outer((c.of(k) - low) / (high - low) - 0.5, turn)
    return _unknown("camera_wobble", "camera", size_rad=float(np.linalg.norm(turn)))


def board_warp(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    """The board is bent like a piece of a cylinder."""
    width = scene.robot.board_corners[0] * scene.robot.board_square_m
    truth.board_warp_per_m = _signed(rng, 0.15, 0.8) / width
    return _unknown("board_warp", "board", curvature_per_m=truth.board_warp_per_m)


def mirror_cylinder(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    """The mirror is bent in one direction only."""
    c = _signed(rng, 0.02, 0.1) / scene.robot.path_length_m[1]
    truth.curvature_per_m = np.array([c, 0.0] if rng.random() < 0.5 else [0.0, c])
    return _unknown("mirror_cylinder", "mirror", curvature_per_m=c)


OUTSIDE: dict[str, Draw] = {
    f.__name__: f
    for f in (
        second_harmonic,
        quadratic_coupling,
        warm_up,
        cable,
        bouc_wen,
        knee,
        marker_swing,
        link_torsion,
        rolling_shear,
        tangential_lens,
        focal_breathing,
        camera_wobble,
        board_warp,
        mirror_cylinder,
    )
}
"""Every kind outside the vocabulary, by the name that the answer calls it."""
