"""An imperfect robot: every joint and link a little off, as in a kit with hobby servos and printed parts.

Each joint that moves a marker gets an eccentric gear, a zero, a tilted axis and a displaced origin, and either a
little play or a little give. All sizes are normal about zero, so that they differ from joint to joint by far. They
come beside the drawn causes, which are larger; the answer lists them as `small`: to name one of them is right, but
none has to be named.
"""

from __future__ import annotations

import numpy as np

from .effects import Cause, Scene
from .truth import Commands, Loose, ServoError, Truth

PLAY_RAD = 0.006
GIVE_RAD = 0.004
"""Typical droop of a joint under its own load."""
GEAR_RAD = 0.003
ZERO_RAD = 0.003
TILT_RAD = 0.004
ORIGIN_SHARE = 0.15
"""Of the robot's typical error of length."""
PLAY_SHARE = 0.5
"""Of the joints, those with play; the others give."""


def add_small_errors(rng: np.random.Generator, scene: Scene, truth: Truth, scale: float) -> list[Cause]:
    """Adds small errors of every kind to the true machine, `scale` times the typical ones; returns what was added."""
    robot, small = scene.robot, [Cause(effect="geometry", at="robot")]
    moved = {item.joint for item in truth.loose}
    for joint in scene.joints():
        at, body = f"joint:{joint}", robot.body_of_joint(joint)
        size, phase = scale * abs(rng.normal(0, GEAR_RAD)), rng.uniform(0, 2 * np.pi)
        zero = float(scale * rng.normal(0, ZERO_RAD))
        truth.servo.append((joint, _gear(joint, size, phase, zero)))
        small += [
            Cause(effect="gear_eccentricity", at=at, size_rad=size),
            Cause(effect="joint_offset", at=at),
        ]
        shift_m = rng.normal(0, scale * ORIGIN_SHARE * robot.length_scale_m, 3)
        truth.origin_shift_m[body] = truth.origin_shift_m.get(body, np.zeros(3)) + shift_m
        axis = truth.axis.get(body, robot.bodies[body].axis)
        axis = axis + np.cross(rng.normal(0, scale * TILT_RAD, 3), axis)
        truth.axis[body] = axis / np.linalg.norm(axis)
        small.append(Cause(effect="axis_tilt", at=at))
        before = robot.bodies[robot.bodies[body].parent].name
        small.append(Cause(effect="link_length", at=f"link:{before}"))
        plays, amount = rng.random() < PLAY_SHARE, scale * abs(rng.normal())
        if joint in moved:
            continue
        load_nm = max(scene.load_nm[joint], 0.02 * max(scene.load_nm.values()))
        if plays:
            friction_nm = scene.laws.play_friction_share * load_nm
            truth.loose.append(Loose(joint, play_rad=amount * PLAY_RAD, friction_nm=friction_nm))
            small.append(Cause(effect="backlash", at=at, width_rad=amount * PLAY_RAD))
        else:
            give = max(amount * GIVE_RAD, 1e-5) / load_nm
            truth.loose.append(Loose(joint, stiffness=1 / give))
            small.append(Cause(effect="joint_compliance", at=at, compliance_rad_per_nm=give))
    return small


def _gear(joint: str, size_rad: float, phase_rad: float, zero_rad: float) -> ServoError:
    def law(commands: Commands) -> np.ndarray:
        return zero_rad + size_rad * np.sin(commands.of(joint) + phase_rad)

    return law
