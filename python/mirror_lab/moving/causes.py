"""The causes of a moving body, drawn at random: this simulator's laws of each effect, and their sizes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .engine import Servos

Array = NDArray[np.float64]
Cause = dict[str, Any]


@dataclass
class Body:
    """The real body's departures from the nominal one; arrays are by joint."""

    servos: Servos
    offset: Array
    scale: Array
    give: Array
    stiffening: float
    play: Array
    latency_s: float = 0.0
    marker_shift: dict[str, Array] = field(default_factory=dict)
    camera_turn: Array = field(default_factory=lambda: np.zeros(3))
    camera_shift: Array = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True)
class Usual:
    """Typical values of the nominal motion, by joint: RMS load, largest torque, largest speed, inertia."""

    load: Array
    torque: Array
    speed: Array
    inertia: Array


Law = Callable[[np.random.Generator, Body, Usual, int, str, list[str]], Cause]


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def latency(
    rng: np.random.Generator, body: Body, usual: Usual, j: int, name: str, markers: list[str]
) -> Cause:
    body.latency_s = float(rng.uniform(0.006, 0.05))
    return {"effect": "latency", "at": "camera", "latency_s": body.latency_s}


def servo_lag(
    rng: np.random.Generator, body: Body, usual: Usual, j: int, name: str, markers: list[str]
) -> Cause:
    body.servos.lag_s[j] = rng.uniform(0.012, 0.06)
    return {"effect": "servo_lag", "at": f"joint:{name}", "time_constant_s": float(body.servos.lag_s[j])}


def servo_gain(
    rng: np.random.Generator, body: Body, usual: Usual, j: int, name: str, markers: list[str]
) -> Cause:
    factor = float(rng.choice([rng.uniform(0.25, 0.6), rng.uniform(1.7, 3.0)], p=[0.7, 0.3]))
    damping = float(np.sqrt(factor) * rng.uniform(0.8, 1.2))
    body.servos.stiffness[j] *= factor
    body.servos.damping[j] *= damping
    return {
        "effect": "servo_gain", "at": f"joint:{name}", "stiffness_scale_error": factor - 1,
        "damping_scale_error": damping - 1,
    }  # fmt: skip


def viscous_friction(
    rng: np.random.Generator, body: Body, usual: Usual, j: int, name: str, markers: list[str]
) -> Cause:
    body.servos.viscous[j] = rng.uniform(0.4, 1.5) * body.servos.damping[j]
    return {
        "effect": "viscous_friction",
        "at": f"joint:{name}",
        "viscous_nms_per_rad": float(body.servos.viscous[j]),
    }


def coulomb_friction(
    rng: np.random.Generator, body: Body, usual: Usual, j: int, name: str, markers: list[str]
) -> Cause:
    # The error that friction leaves: friction over stiffness, as an angle.
    body.servos.friction[j] = rng.uniform(0.012, 0.04) * body.servos.stiffness[j]
    return {
        "effect": "coulomb_friction",
        "at": f"joint:{name}",
        "friction_nm": float(body.servos.friction[j]),
    }


def reflected_inertia(
    rng: np.random.Generator, body: Body, usual: Usual, j: int, name: str, markers: list[str]
) -> Cause:
    more = float(rng.uniform(1.0, 3.0) * (usual.inertia[j] + body.servos.armature[j]))
    body.servos.armature[j] += more
    return {"effect": "reflected_inertia", "at": f"joint:{name}", "inertia_kgm2": more}


def torque_limit(
    rng: np.random.Generator, body: Body, usual: Usual, j: int, name: str, markers: list[str]
) -> Cause:
    body.servos.torque_limit[j] = rng.uniform(0.45, 0.7) * usual.torque[j]
    return {"effect": "torque_limit", "at": f"joint:{name}", "limit_nm": float(body.servos.torque_limit[j])}


def velocity_limit(
    rng: np.random.Generator, body: Body, usual: Usual, j: int, name: str, markers: list[str]
) -> Cause:
    body.servos.velocity_limit[j] = rng.uniform(0.45, 0.75) * usual.speed[j]
    return {
        "effect": "velocity_limit",
        "at": f"joint:{name}",
        "limit_rad_per_s": float(body.servos.velocity_limit[j]),
    }


def joint_offset(
    rng: np.random.Generator, body: Body, usual: Usual, j: int, name: str, markers: list[str]
) -> Cause:
    body.offset[j] = _sign(rng) * rng.uniform(0.008, 0.035)
    return {"effect": "joint_offset", "at": f"joint:{name}", "offset_rad": float(body.offset[j])}


def gear_ratio(
    rng: np.random.Generator, body: Body, usual: Usual, j: int, name: str, markers: list[str]
) -> Cause:
    body.scale[j] = _sign(rng) * rng.uniform(0.015, 0.05)
    return {"effect": "gear_ratio", "at": f"joint:{name}", "scale_error": float(body.scale[j])}


def joint_compliance(
    rng: np.random.Generator, body: Body, usual: Usual, j: int, name: str, markers: list[str]
) -> Cause:
    body.give[j] = rng.uniform(0.01, 0.03) / usual.load[j]
    return {"effect": "joint_compliance", "at": f"joint:{name}", "compliance_rad_per_nm": float(body.give[j])}


def backlash(
    rng: np.random.Generator, body: Body, usual: Usual, j: int, name: str, markers: list[str]
) -> Cause:
    body.play[j] = rng.uniform(0.02, 0.05)
    return {"effect": "backlash", "at": f"joint:{name}", "width_rad": float(body.play[j])}


def marker_mount(
    rng: np.random.Generator, body: Body, usual: Usual, j: int, name: str, markers: list[str]
) -> Cause:
    marker = str(rng.choice(markers))
    shift = rng.normal(size=3)
    shift *= rng.uniform(0.003, 0.006) / np.linalg.norm(shift)
    body.marker_shift[marker] = shift
    return {
        "effect": "marker_mount",
        "at": f"marker:{marker}",
        **{f"d{a}_m": float(x) for a, x in zip("xyz", shift, strict=True)},
    }


def camera_mount(
    rng: np.random.Generator, body: Body, usual: Usual, j: int, name: str, markers: list[str]
) -> Cause:
    body.camera_turn, body.camera_shift = rng.normal(0, 0.012, 3), rng.normal(0, 0.002, 3)
    return {"effect": "camera_mount", "at": "camera"}


LAWS: dict[str, Law] = {
    law.__name__: law
    for law in (
        latency, servo_lag, servo_gain, viscous_friction, coulomb_friction, reflected_inertia, torque_limit,
        velocity_limit, joint_offset, gear_ratio, joint_compliance, backlash, marker_mount, camera_mount,
    )
}  # fmt: skip
"""The judge's law of each effect of docs/moving.md."""
