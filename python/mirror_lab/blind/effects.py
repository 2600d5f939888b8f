"""The vocabulary's effects in this simulator: a place and a size are drawn, and the true machine is
changed.

Sizes run from hardly visible to large. `Laws` defines how far the true laws differ from the vocabulary's
simple ones. The answer names the effect, its place and its parameters as the vocabulary defines them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import NoPlaceError
from .robots import Robot
from .truth import Bend, Commands, Loose, Truth

Array = NDArray[np.float64]
Cause = dict[str, Any]


@dataclass(frozen=True)
class Laws:
    """Departures of the true laws from the vocabulary's: each a share, 0 is the simple law."""

    play_load_share: float = 0.0
    play_friction_share: float = 0.05
    """Friction at a loose joint over the typical torque of gravity there: above 1, motion decides the
    side."""
    stiffening: float = 0.0
    stiction_droop_share: float = 0.15
    """Droop of a sticking servo over its dead band."""
    drift_bow: float = 0.0
    bend_at: float = 0.5
    """Where along a link it bends: its middle is equivalent to a uniform beam's bending."""


@dataclass
class Scene:
    """The inputs of a draw: the nominal robot, the commands, the loads of gravity, the laws."""

    robot: Robot
    commands: Commands
    gravity: Array
    load_nm: dict[str, float]
    """RMS torque of gravity by commanded joint."""
    bending_nm: dict[int, float]
    """RMS moment of gravity across a link by body."""
    laws: Laws
    frames: int

    def joints(self, loaded: bool = False) -> list[str]:
        """Commanded joints that move a marker; with `loaded`, those on which gravity acts."""
        moving = [
            j for j in self.robot.commanded if self.robot.moves(j) and np.ptp(self.commands.of(j)) > 1e-3
        ]
        if not loaded:
            return moving
        most = max(self.load_nm[j] for j in moving)
        return [j for j in moving if self.load_nm[j] > 0.03 * most]


Draw = Callable[[np.random.Generator, Scene, Truth], Cause]


def _size(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _signed(rng: np.random.Generator, low: float, high: float) -> float:
    return _size(rng, low, high) * float(rng.choice([-1.0, 1.0]))


def _pick(rng: np.random.Generator, names: list[str], what: str) -> str:
    if not names:
        raise NoPlaceError(f"this robot has no place for {what}")
    return str(names[int(rng.integers(len(names)))])


def _direction(rng: np.random.Generator) -> Array:
    v = rng.normal(size=3)
    result: Array = v / np.linalg.norm(v)
    return result


def joint_offset(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    j, a = _pick(rng, scene.joints(), "joint_offset"), _signed(rng, 0.008, 0.06)
    truth.servo.append((j, lambda c: np.full(len(c.q_rad), a)))
    return {"effect": "joint_offset", "at": f"joint:{j}", "offset_rad": a}


def gear_ratio(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    j, e = _pick(rng, scene.joints(), "gear_ratio"), _signed(rng, 0.012, 0.07)
    truth.servo.append((j, lambda c: e * c.of(j)))
    return {"effect": "gear_ratio", "at": f"joint:{j}", "scale_error": e}


def gear_eccentricity(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    j, size, phase = (
        _pick(rng, scene.joints(), "gear_eccentricity"),
        _size(rng, 0.012, 0.06),
        rng.uniform(0, 2 * np.pi),
    )
    s, k = size * np.cos(phase), size * np.sin(phase)
    truth.servo.append((j, lambda c: s * np.sin(c.of(j)) + k * np.cos(c.of(j)) - k))
    return {"effect": "gear_eccentricity", "at": f"joint:{j}", "sin_rad": float(s), "cos_rad": float(k)}


def backlash(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    j, width = _pick(rng, scene.joints(), "backlash"), _size(rng, 0.015, 0.08)
    friction = scene.laws.play_friction_share * max(scene.load_nm[j], 0.02 * max(scene.load_nm.values()))
    truth.loose.append(
        Loose(j, play_rad=width, play_load_share=scene.laws.play_load_share, friction_nm=friction)
    )
    return {"effect": "backlash", "at": f"joint:{j}", "width_rad": width, "friction_nm": friction}


def stiction(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    j, band = _pick(rng, scene.joints(), "stiction"), _size(rng, 0.008, 0.035)
    load = max(scene.load_nm[j], 0.02 * max(scene.load_nm.values()))
    stiffness = load / (scene.laws.stiction_droop_share * band)
    truth.loose.append(Loose(j, stiffness=stiffness, friction_nm=stiffness * band))
    return {
        "effect": "stiction",
        "at": f"joint:{j}",
        "deadband_rad": band,
        "droop_rad_per_nm": 1 / stiffness,
        "tolerated": [{"effect": "joint_compliance", "at": f"joint:{j}"}],
    }


def joint_compliance(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    j, droop = _pick(rng, scene.joints(loaded=True), "joint_compliance"), _size(rng, 0.010, 0.06)
    compliance = droop / scene.load_nm[j]
    truth.loose.append(
        Loose(j, stiffness=1 / compliance, stiffening=scene.laws.stiffening, reference_rad=1.5 * droop)
    )
    return {"effect": "joint_compliance", "at": f"joint:{j}", "compliance_rad_per_nm": compliance}


def link_tip(robot: Robot, body: int) -> Array:
    """End of a link in its frame: the next joint's origin, or the middle of its markers, or its centre of
    mass."""
    following = robot.next_body(body)
    if following is None:
        tip = robot.bodies[body].com_m
        markers = [
            robot.bodies[i]
            for m in robot.markers
            if robot.bodies[i := robot.index[f"{m}_marker"]].parent == body
        ]
        if markers:
            tip = np.mean([b.xyz_m for b in markers], axis=0)
    else:
        tip, i = np.zeros(3), following
        while i != body:
            tip = robot.bodies[i].xyz_m + robot.bodies[i].rotation @ tip
            i = robot.bodies[i].parent
    return tip


def long_axis(robot: Robot, body: int) -> Array:
    """Unit vector along a link, from its joint to its tip."""
    tip = link_tip(robot, body)
    length = float(np.linalg.norm(tip))
    return tip / length if length > 1e-6 else np.array([0.0, 0.0, 1.0])


def transverse_axes(robot: Robot, body: int) -> tuple[Array, Array]:
    """Two unit vectors across a link, in its frame."""
    along = long_axis(robot, body)
    helper = np.eye(3)[int(np.argmin(np.abs(along)))]
    first = np.cross(along, helper)
    first /= np.linalg.norm(first)
    return first, np.cross(along, first)


def link_bending(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    robot = scene.robot
    most = max(scene.bending_nm.values())
    links = [robot.bodies[b].name for b, m in scene.bending_nm.items() if m > 0.03 * most]
    name = _pick(rng, links, "link_bending")
    body = robot.index[name]
    compliance = _size(rng, 0.008, 0.045) / scene.bending_nm[body]
    for axis in transverse_axes(robot, body):
        truth.bends.append(Bend(body, axis, 1 / compliance, scene.laws.bend_at * link_tip(robot, body)))
    return {"effect": "link_bending", "at": f"link:{name}", "compliance_rad_per_nm": compliance}


def link_length(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    robot = scene.robot
    carried = {}
    for j in scene.joints():
        body = robot.body_of_joint(j)
        following = robot.next_body(body)
        if following is not None and robot.bodies[following].parent == body:
            carried[robot.bodies[body].name] = following
    name = _pick(rng, sorted(carried), "link_length")
    size = _size(rng, 0.4, 2.2) * robot.length_scale_m
    if rng.random() < 0.6:
        shift = long_axis(robot, robot.index[name]) * size * float(rng.choice([-1.0, 1.0]))
    else:
        shift = _direction(rng) * size
    truth.origin_shift_m[carried[name]] = truth.origin_shift_m.get(carried[name], np.zeros(3)) + shift
    return {"effect": "link_length", "at": f"link:{name}", **_xyz(shift)}


def _xyz(shift: Array) -> dict[str, float]:
    return {"dx_m": float(shift[0]), "dy_m": float(shift[1]), "dz_m": float(shift[2])}


def axis_tilt(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    robot = scene.robot
    j, size, phase = (
        _pick(rng, scene.joints(), "axis_tilt"),
        _size(rng, 0.012, 0.06),
        rng.uniform(0, 2 * np.pi),
    )
    body = robot.body_of_joint(j)
    axis = robot.bodies[body].axis
    helper = np.array([1.0, 0, 0]) if abs(axis[0]) < 0.8 else np.array([0, 1.0, 0])
    u = np.cross(axis, helper)
    u /= np.linalg.norm(u)
    one, two = size * np.cos(phase), size * np.sin(phase)
    tilted = axis + np.tan(one) * u + np.tan(two) * np.cross(axis, u)
    truth.axis[body] = tilted / np.linalg.norm(tilted)
    return {"effect": "axis_tilt", "at": f"joint:{j}", "tilt_1_rad": float(one), "tilt_2_rad": float(two)}


def joint_coupling(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    joints = scene.joints()
    j = _pick(rng, joints, "joint_coupling")
    # Tendons and differentials couple joints of one limb.
    limb = [k for k in joints if k != j and set(scene.robot.moves(k)) & set(scene.robot.moves(j))]
    k, c = _pick(rng, limb, "joint_coupling"), _signed(rng, 0.015, 0.07)
    truth.servo.append((j, lambda q: c * q.of(k)))
    return {"effect": "joint_coupling", "at": f"joint:{j}<-joint:{k}", "coupling": c}


def drift(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    j = _pick(rng, scene.joints(), "drift")
    span = float(scene.commands.time_s[-1])
    rate, bow = _signed(rng, 0.015, 0.07) / span, scene.laws.drift_bow
    truth.servo.append((j, lambda c: rate * c.time_s * (1 + bow * (1 - c.time_s / span))))
    return {"effect": "drift", "at": f"joint:{j}", "rate_rad_per_s": rate}


def marker_mount(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    m = _pick(rng, scene.robot.markers, "marker_mount")
    shift = _direction(rng) * _size(rng, 0.4, 2.0) * scene.robot.length_scale_m
    truth.origin_shift_m[scene.robot.index[f"{m}_marker"]] = shift
    return {"effect": "marker_mount", "at": f"marker:{m}", **_xyz(shift)}


def camera_mount(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    turn = _direction(rng) * _size(rng, 0.006, 0.03)
    shift = _direction(rng) * _size(rng, 0.3, 1.5) * scene.robot.length_scale_m
    truth.camera_turn_rad, truth.camera_shift_m = turn, shift
    return {
        "effect": "camera_mount",
        "at": "camera",
        "rx_rad": float(turn[0]),
        "ry_rad": float(turn[1]),
        "rz_rad": float(turn[2]),
        **_xyz(shift),
    }


def camera_focal(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    truth.focal_scale = _signed(rng, 0.005, 0.03)
    return {"effect": "camera_focal", "at": "camera", "scale_error": truth.focal_scale}


def camera_center(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    size, phase = _size(rng, 2.5, 12.0), rng.uniform(0, 2 * np.pi)
    truth.center_shift_px = size * np.array([np.cos(phase), np.sin(phase)])
    return {
        "effect": "camera_center",
        "at": "camera",
        "du_px": truth.center_shift_px[0],
        "dv_px": truth.center_shift_px[1],
    }


def lens_distortion(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    k = _signed(rng, 0.015, 0.08)
    truth.distortion = truth.distortion + np.array([k, 0, 0, 0, 0])
    return {"effect": "lens_distortion", "at": "camera", "dk1": k}


def board_scale(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    truth.board_scale = _signed(rng, 0.006, 0.04)
    return {"effect": "board_scale", "at": "board", "scale_error": truth.board_scale}


def mirror_glass(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    truth.glass_m = _size(rng, 0.003, 0.009)
    return {"effect": "mirror_glass", "at": "mirror", "thickness_m": truth.glass_m}


def mirror_curvature(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    length = scene.robot.path_length_m[1]
    c = _signed(rng, 0.012, 0.08) / length
    truth.curvature_per_m = np.array([c, c])
    return {"effect": "mirror_curvature", "at": "mirror", "curvature_per_m": c}


def _constant(a: float) -> Callable[[Commands], Array]:
    return lambda c: np.full(len(c.q_rad), a)


def geometry(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    """Manufacturing tolerance: every link, axis and zero a little off."""
    robot = scene.robot
    spread_m, spread_rad = _size(rng, 0.1, 0.4) * robot.length_scale_m, _size(rng, 0.002, 0.008)
    for j in scene.joints():
        body = robot.body_of_joint(j)
        offset = float(rng.normal(0, spread_rad))
        truth.servo.append((j, _constant(offset)))
        truth.origin_shift_m[body] = truth.origin_shift_m.get(body, np.zeros(3)) + rng.normal(0, spread_m, 3)
        if body not in truth.axis:
            axis = robot.bodies[body].axis
            tilt = rng.normal(0, spread_rad, 3)
            axis = axis + np.cross(tilt, axis)
            truth.axis[body] = axis / np.linalg.norm(axis)
    return {"effect": "geometry", "at": "robot", "spread_m": spread_m, "spread_rad": spread_rad}


def pairing(rng: np.random.Generator, scene: Scene, truth: Truth) -> Cause:
    length = int(rng.integers(max(6, scene.frames // 25), max(8, scene.frames // 5)))
    first = int(rng.integers(8, scene.frames - length - 8))
    shift = int(rng.choice([-3, -2, -1, 1, 2, 3]))
    truth.pairing = (first, first + length - 1, shift)
    return {
        "effect": "pairing",
        "at": "data",
        "first_frame": first,
        "last_frame": first + length - 1,
        "shift_rows": shift,
    }


VOCABULARY: dict[str, Draw] = {
    f.__name__: f
    for f in (
        joint_offset,
        gear_ratio,
        gear_eccentricity,
        backlash,
        stiction,
        joint_compliance,
        link_bending,
        link_length,
        axis_tilt,
        joint_coupling,
        drift,
        marker_mount,
        camera_mount,
        camera_focal,
        camera_center,
        lens_distortion,
        board_scale,
        mirror_glass,
        mirror_curvature,
        geometry,
        pairing,
    )
}
"""Every effect of the vocabulary, by its public name."""
