"""The joint law in MuJoCo, term by term: the motor's command, the parts behind the motor, the servo."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import mujoco
import numpy as np

from mirror_posture.arrays import Floats

from .changed import Changed, Values
from .model import STIFF_FRICTION, Simulator

PART_ARMATURE_KGM2 = 1e-4
"""Inertia of the part between a motor and an elastic part; with less a play together with a spring
chatters."""

STIFF_LIMIT = ([0.002, 1.0], [0.999, 0.9999, 0.0001, 0.5, 2.0])
"""The ends of a play: MuJoCo's own defaults yield by a fifth of a typical play."""

FRICTION_BEYOND_LOAD = 1.2
"""Friction in a play, as a share of the joint's largest torque, where the diagnosis found that its load never decides the side."""

LEAST_FRICTION_NM = 1e-4

DAMPING_PER_STIFFNESS_S = 0.02

BEARING_DAMPING_S = 5.0
"""Damping of a play's bearing over its friction: motions die out, the resting place is the same."""

DRIVEN: Mapping[str, Callable[[Mapping[str, Floats], Floats, str, str], Floats]] = {
    "share": lambda q, t, name, other: q[name],
    "sine": lambda q, t, name, other: np.sin(q[name]),
    "cosine_less_one": lambda q, t, name, other: np.cos(q[name]) - 1.0,
    "coupling": lambda q, t, name, other: q[other],
    "rate": lambda q, t, name, other: t,
}
"""The terms of a joint's law that a motor makes: by what each is multiplied, q the commands (rad), t the time (s)."""

TOLD = {
    "share": "{:.6f} q",
    "sine": "{:.6f} sin q",
    "cosine_less_one": "{:.6f} (cos q - 1) rad",
    "coupling": "{:.6f} times the command of {other}",
    "rate": "{:.3e} rad/s times the time",
}


def change_joint(changed: Changed, places: str, terms: Values, value: Values) -> tuple[str, str]:
    """The law of a joint, term by term: the motor's command, the parts behind the motor, and the servo."""
    name, _, other = places.partition("<-joint:")
    if other:
        changed.joint(other)
    element, said = name, []
    if "offset" in terms:
        said.append(_offset(changed, name, terms["offset"]))
    driven = [term for term in DRIVEN if term in terms]
    if driven:

        def added(q: Mapping[str, Floats], t: Floats) -> Floats:
            parts = [terms[term] * DRIVEN[term](q, t, name, other) for term in driven]
            return np.sum(parts, axis=0)  # type: ignore[no-any-return, unused-ignore]

        changed.drive(name, added)
        told = (TOLD[term].format(terms[term], other=other) for term in driven)
        said.append(f"the servo adds {' + '.join(told)}")
    if "play" in terms:
        element, text = _play(changed, name, terms["play"], value)
        said.append(text)
    if "dead_band" in terms:
        said.append(_friction(changed, name, terms))
    elif "compliance" in terms:
        element, text = _spring(changed, name, terms["compliance"])
        said.append(text)
    return element, ", ".join(said)


def _offset(changed: Changed, name: str, offset_rad: float) -> str:
    joint = changed.joint(name)
    joint.ref = float(joint.ref) - offset_rad * changed.simulator.angle_unit
    return f"ref less {offset_rad:.6f} rad"


def _play(changed: Changed, name: str, width_rad: float, value: Values) -> tuple[str, str]:
    joint, half = changed.joint(name), 0.5 * width_rad
    play = _in_series(changed.simulator, joint, f"{name}_play")
    unit = changed.simulator.angle_unit
    play.limited, play.range = mujoco.mjtLimited.mjLIMITED_TRUE, [-half * unit, half * unit]
    play.solref_limit, play.solimp_limit = STIFF_LIMIT
    beyond = FRICTION_BEYOND_LOAD * changed.largest_torque_nm.get(name, 0.0)
    friction = max(LEAST_FRICTION_NM, value.get("friction_nm", beyond))
    # Friction holds the output against the frame, not against the motor that turns within the play.
    bearing = changed.simulator.spec.add_tendon(name=f"{name}_bearing")
    bearing.wrap_joint(name, 1.0)
    bearing.wrap_joint(play.name, 1.0)
    bearing.frictionloss = friction
    bearing.solref_friction, bearing.solimp_friction = STIFF_FRICTION
    _set(bearing, "damping", BEARING_DAMPING_S * friction)
    return (
        play.name,
        f"hinge in series with {name}, {-half:.5f} to {half:.5f} rad, bearing friction {friction:.4g} N m",
    )


def _spring(changed: Changed, name: str, compliance_rad_per_nm: float) -> tuple[str, str]:
    spring = _in_series(changed.simulator, changed.joint(name), f"{name}_spring")
    stiffness = 1.0 / compliance_rad_per_nm
    set_spring(spring, stiffness)
    return spring.name, f"hinge in series with {name}, stiffness {stiffness:.5g} N m/rad"


def _friction(changed: Changed, name: str, terms: Values) -> str:
    """Friction against a servo of finite stiffness, which makes it droop too: the compliance is the servo's own."""
    joint, spec = changed.joint(name), changed.simulator.spec
    droop = terms.get("compliance", 0.0)
    servo = next(a for a in spec.actuators if a.target == name)
    stiffness = float(servo.gainprm[0])
    if droop > 1e-9:
        stiffness = min(stiffness, 1.0 / droop)
        servo.set_to_position(kp=stiffness, kv=2.0 * stiffness / 80.0)
    joint.frictionloss = stiffness * terms["dead_band"]
    joint.solref_friction, joint.solimp_friction = STIFF_FRICTION
    return f"frictionloss {joint.frictionloss:.4g} N m against a servo of {stiffness:.4g} N m/rad"


def _in_series(simulator: Simulator, joint: Any, name: str) -> Any:
    """A further joint of the same body behind a joint: MuJoCo puts the joints of a body in series."""
    part = joint.parent.add_joint(name=name, type=joint.type, axis=joint.axis, pos=joint.pos)
    part.armature, part.limited = PART_ARMATURE_KGM2, mujoco.mjtLimited.mjLIMITED_FALSE
    return part


def set_spring(part: Any, stiffness: float) -> None:
    _set(part, "stiffness", stiffness)
    _set(part, "damping", DAMPING_PER_STIFFNESS_S * stiffness)


def _set(part: Any, name: str, value: float) -> None:
    # A polynomial in newer releases of MuJoCo, a number in older ones.
    try:
        setattr(part, name, [value, 0.0, 0.0])
    except (TypeError, ValueError):
        setattr(part, name, value)
