"""The joint law in MuJoCo, term by term: the motor's command, the parts behind the motor, the servo."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
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
    "cosine_less_one": "{:.6f} (cos q - 1) {unit}",
    "coupling": "{:.6f} times the command of {other}",
    "rate": "{:.3e} {unit}/s times the time",
}


@dataclass(frozen=True)
class Words:
    """What a joint's part is called, with the units of its positions, loads and stiffness."""

    part: str
    unit: str
    load: str
    stiffness: str


HINGE, SLIDE = Words("hinge", "rad", "N m", "N m/rad"), Words("slide", "m", "N", "N/m")


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
        unit = _words(changed.joint(name)).unit
        told = (TOLD[term].format(terms[term], other=other, unit=unit) for term in driven)
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


def _words(joint: Any) -> Words:
    return SLIDE if joint.type == mujoco.mjtJoint.mjJNT_SLIDE else HINGE


def _offset(changed: Changed, name: str, offset: float) -> str:
    joint = changed.joint(name)
    joint.ref = float(joint.ref) - offset * changed.simulator.unit_of(joint)
    return f"ref less {offset:.6f} {_words(joint).unit}"


def _play(changed: Changed, name: str, width: float, value: Values) -> tuple[str, str]:
    joint, simulator = changed.joint(name), changed.simulator
    beyond = FRICTION_BEYOND_LOAD * changed.largest_torque_nm.get(name, 0.0)
    friction = max(LEAST_FRICTION_NM, value.get("friction_nm", beyond))
    play, bearing = simulator.spec.joint(f"{name}_play"), simulator.spec.tendon(f"{name}_bearing")
    unit, half = simulator.unit_of(joint), 0.5 * width
    if play is None:
        play = _in_series(simulator, joint, f"{name}_play")
        play.limited = mujoco.mjtLimited.mjLIMITED_TRUE
        play.solref_limit, play.solimp_limit = STIFF_LIMIT
        # Friction holds the output against the frame, not against the motor that turns within the play.
        bearing = simulator.spec.add_tendon(name=f"{name}_bearing")
        bearing.wrap_joint(name, 1.0)
        bearing.wrap_joint(play.name, 1.0)
        bearing.solref_friction, bearing.solimp_friction = STIFF_FRICTION
    else:
        half += float(play.range[1]) / unit
        friction = max(friction, float(bearing.frictionloss))
    play.range = [-half * unit, half * unit]
    bearing.frictionloss = friction
    _set(bearing, "damping", BEARING_DAMPING_S * friction)
    words = _words(joint)
    return (
        play.name,
        f"{words.part} in series with {name}, {-half:.5f} to {half:.5f} {words.unit}, bearing friction {friction:.4g} {words.load}",
    )


def _spring(changed: Changed, name: str, compliance: float) -> tuple[str, str]:
    joint, simulator = changed.joint(name), changed.simulator
    spring = simulator.spec.joint(f"{name}_spring")
    if spring is None:
        spring = _in_series(simulator, joint, f"{name}_spring")
    stiffness = soften(spring, compliance)
    words = _words(joint)
    return (
        spring.name,
        f"{words.part} in series with {name}, stiffness {stiffness:.5g} {words.stiffness}",
    )


def _friction(changed: Changed, name: str, terms: Values) -> str:
    """Friction against a servo of finite stiffness, which makes it droop too: the compliance is the servo's own."""
    joint, servo = changed.joint(name), changed.simulator.servo(name)
    droop, gear = terms.get("compliance", 0.0), float(servo.gear[0])
    stiffness = float(servo.gainprm[0]) * gear**2
    if droop > 1e-9:
        stiffness = min(stiffness, 1.0 / droop)
        servo.set_to_position(kp=stiffness / gear**2, kv=2.0 * stiffness / gear**2 / 80.0)
    joint.frictionloss = stiffness * terms["dead_band"]
    joint.solref_friction, joint.solimp_friction = STIFF_FRICTION
    words = _words(joint)
    return f"frictionloss {joint.frictionloss:.4g} {words.load} against a servo of {stiffness:.4g} {words.stiffness}"


def _in_series(simulator: Simulator, joint: Any, name: str) -> Any:
    """A further joint of the same body behind a joint: MuJoCo puts the joints of a body in series."""
    part = joint.parent.add_joint(name=name, type=joint.type, axis=joint.axis, pos=joint.pos)
    part.armature, part.limited = PART_ARMATURE_KGM2, mujoco.mjtLimited.mjLIMITED_FALSE
    return part


def soften(part: Any, compliance: float) -> float:
    """Makes an elastic part give by so much more, and returns its stiffness: springs in series add what they give.

    A spring may be a cause by itself and also one of the small errors.
    """
    before = float(np.ravel(part.stiffness)[0])
    stiffness = 1.0 / (compliance + (1.0 / before if before > 0.0 else 0.0))
    _set(part, "stiffness", stiffness)
    _set(part, "damping", DAMPING_PER_STIFFNESS_S * stiffness)
    return stiffness


def _set(part: Any, name: str, value: float) -> None:
    # A polynomial in newer releases of MuJoCo, a number in older ones.
    try:
        setattr(part, name, [value, 0.0, 0.0])
    except (TypeError, ValueError):
        setattr(part, name, value)
