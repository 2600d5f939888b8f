"""The user's simulator with the causes of a motion in it: an MJCF with a comment at each change."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .effects import EFFECTS, Causes, gains
from .rollouts import Rollouts

NOT_IN_A_MODEL: Mapping[str, str] = {
    "latency": "delay the pictures by {0:.5f} s against the log",
    "servo_lag": "filter the commands with a time constant of {0:.5f} s",
    "velocity_limit": "let the command change by at most {0:.5f} rad/s",
    "joint_offset": "the joint is {0:+.6f} rad off its command: correct its zero",
    "gear_ratio": "the joint turns {0:+.6f} rad more for each rad of its command",
    "joint_compliance": "the output yields by {0:.6g} rad/(N m) behind the servo",
    "backlash": "the output has a play of {0:.6f} rad behind the servo",
}
"""Causes that a model of rigid joints on servos cannot represent; a comment at the joint says so."""


def patched_model(rollouts: Rollouts, causes: Causes) -> str:
    """The model as MuJoCo executes it, with the causes that a model can hold, and a comment at each of them."""
    simulator = rollouts.simulator
    spec = simulator.spec.copy()
    _state_gains(rollouts, spec)
    comments: list[tuple[str, str]] = []
    for (effect, at), values in causes.items():
        name = at.partition(":")[2]
        said = NOT_IN_A_MODEL.get(effect, "see diagnosis.json").format(*values)
        if EFFECTS[effect].needs_servo:
            said = _changed(spec, simulator.servos[name], effect, name, values)
        comments.append((name, f"{effect} at {at}: {said}"))
    spec.compile()
    lines = str(spec.to_xml()).splitlines()
    for name, comment in comments:
        at_line = next((i for i, line in enumerate(lines) if name and f'name="{name}"' in line), 1)
        indent = lines[at_line][: len(lines[at_line]) - len(lines[at_line].lstrip())]
        lines.insert(at_line, f"{indent}<!-- {comment.replace('--', '- -')} -->")
    return "\n".join(lines) + "\n"


def _state_gains(rollouts: Rollouts, spec: Any) -> None:
    """Writes what the compiled servos have: a damping given as a ratio (`dampratio`) is a number only there, and a change of inertia would change it."""
    for joint, actuator in zip(rollouts.joints, rollouts.actuator, strict=True):
        servo = spec.actuator(rollouts.simulator.servos[joint])
        servo.gainprm[0] = rollouts.model.actuator_gainprm[actuator, 0]
        servo.biasprm[1:3] = rollouts.model.actuator_biasprm[actuator, 1:3]


def _changed(spec: Any, actuator: str, effect: str, name: str, values: tuple[float, ...]) -> str:
    joint, servo = spec.joint(name), spec.actuator(actuator)
    if effect == "servo_gain":
        stiffness, damping = gains(values)
        kp, kv = float(servo.gainprm[0]) * stiffness, -float(servo.biasprm[2]) * damping
        servo.gainprm[0], servo.biasprm[1], servo.biasprm[2] = kp, -kp, -kv
        _scale_damping(joint, damping)
        return f"kp {stiffness:.4f} times, now {kp:.6g}; kv {damping:.4f} times, now {kv:.6g}"
    if effect == "viscous_friction":
        _add_damping(joint, values[0])
        return f"damping {values[0]:+.6g} N m s/rad"
    if effect == "coulomb_friction":
        joint.frictionloss = float(joint.frictionloss) + values[0]
        return f"frictionloss {values[0]:+.6g} N m"
    if effect == "reflected_inertia":
        joint.armature = float(joint.armature) + values[0]
        return f"armature {values[0]:+.6g} kg m2"
    most = values[0] / abs(float(servo.gear[0]))
    servo.forcelimited, servo.forcerange = 1, [-most, most]
    return f"forcerange {most:.6g} N m"


def _damping(joint: object) -> list[float]:
    value = joint.damping  # type: ignore[attr-defined]
    return [float(x) for x in value] if hasattr(value, "__len__") else [float(value)]


def _set_damping(joint: object, value: list[float]) -> None:
    # A polynomial in newer releases of MuJoCo, a number in older ones.
    joint.damping = value if len(value) > 1 else value[0]  # type: ignore[attr-defined]


def _add_damping(joint: object, more: float) -> None:
    first, *rest = _damping(joint)
    _set_damping(joint, [first + more, *rest])


def _scale_damping(joint: object, factor: float) -> None:
    first, *rest = _damping(joint)
    _set_damping(joint, [factor * first, *rest])
