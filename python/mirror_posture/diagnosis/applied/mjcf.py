"""Writes causes that a URDF cannot describe as an MJCF for MuJoCo: play, friction, springs and gear ratios."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from ..._core import MirrorPostureError
from ...arrays import Floats
from ...robot import Robot
from ...session import Session
from ..parts import Cause
from ..recording import to_core
from ..vocabulary import IN_WORDS, joint_terms

MECHANICAL = tuple(name for name, effect in IN_WORDS.items() if effect["written_to"] == "mjcf")
DROOP_RAD = 1e-3
"""Droop of a servo under the largest gravity torque of the session: small compared with the diagnosed
errors, stable to simulate."""
LEAST_STIFFNESS = 1.0
"""N m/rad: of joints that bear no load."""
LEAST_MASS_KG, LEAST_INERTIA = 1e-4, 1e-8
"""MuJoCo refuses moving bodies without mass; a URDF often has some."""
SERVO_RATE = 60.0
"""rad/s: natural frequency that the rotors' inertia gives the servos. Without it a joint and its play would turn one
and the same inertia; the statics do not depend on it."""
STOP_TIME_S = 0.005
"""Time constant of the ends of a play; MuJoCo needs two time steps (of 2 ms) at least."""
PLAY_DAMPING = 0.02
"""Damping of a joint in series, as a share of its servo's stiffness, N m s/rad per N m/rad."""
ROUNDING = 1e-12
"""A component of gravity that is a smaller share of it is 0."""
NOT_WRITTEN = "not written"
"""How a line starts that tells why something is not in the file."""
HINGE, SLIDE = ("hinge", "rad", "N m", "N m/rad"), ("slide", "m", "N", "N/m")
"""What MuJoCo calls the kind of a joint, and the units of its position, its load and its stiffness."""
NO_SPRING = f"{NOT_WRITTEN}: a compliance that is not above 0 is no spring"


def write_mjcf(
    session: Session, urdf_text: str, causes: Sequence[Cause], file: Path
) -> dict[tuple[str, str], str]:
    """Writes the robot with position servos and these causes; returns what was written, by effect and place.

    The session is the corrected one, whose robot is told by `urdf_text`.

    Play is a limited joint of the same kind in series with its joint, compliance a sprung one, stiction a friction loss of
    the servo's stiffness times the dead band and a sprung joint for its droop, bending a pair of sprung hinges across the
    link at its middle, a gear ratio the servo's gear.
    Nothing is written, and an empty mapping returned, where MuJoCo is not installed.

    Raises:
        MirrorPostureError: a robot that MuJoCo cannot load.
    """
    try:
        import mujoco
    except ImportError:
        return {}
    robot = Robot.from_urdf_text(urdf_text)
    try:
        spec = mujoco.MjSpec.from_string(_without_pictures(urdf_text))
        spec.compiler.fusestatic = False
        spec.compiler.boundmass, spec.compiler.boundinertia = LEAST_MASS_KG, LEAST_INERTIA
        spec.compiler.balanceinertia = True
        spec.option.gravity = _gravity_in_world(session, robot)
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        stiffness = _servo_stiffness(session, robot)
        for name, value in stiffness.items():
            servo = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
            servo.set_to_position(kp=value, dampratio=1.0)
            spec.joint(name).armature = value / SERVO_RATE**2
        told = {
            (cause.effect, cause.at): _add(mujoco, spec, session, robot, cause, stiffness) for cause in causes
        }
        spec.compile()
        file.write_text(spec.to_xml(), encoding="utf-8")
        # The result on disk counts, not the one in memory.
        mujoco.MjModel.from_xml_path(str(file))
    except ValueError as error:
        raise MirrorPostureError(f"{session.robot_file}: MuJoCo cannot load the robot: {error}") from error
    return told


def _add(
    mujoco: Any, spec: Any, session: Session, robot: Robot, cause: Cause, stiffness: dict[str, float]
) -> str:
    name = cause.at.partition(":")[2]
    value = {key: estimate.value for key, estimate in cause.parameters.items()}
    if cause.at.startswith("link:"):
        return _add_bending(mujoco, spec, session, robot, name, value["compliance_rad_per_nm"])
    child = next(j.child_link for j in robot.joints if j.name == name)
    # The axis of the corrected robot, which a tilt may have moved.
    body, axis, servo = spec.body(child), spec.joint(name).axis, stiffness.get(name, LEAST_STIFFNESS)
    kind = spec.joint(name).type
    word, unit, load, per = SLIDE if kind == mujoco.mjtJoint.mjJNT_SLIDE else HINGE
    terms = joint_terms(cause.effect, value)
    done = []
    if "play" in terms:
        half = terms["play"] / 2.0
        play = _in_series(body, f"{name}_play", kind, axis, 0.0, PLAY_DAMPING * servo)
        # A stop as hard as the time step allows: MuJoCo's default yields by a fifth of a typical play.
        play.armature, play.solref_limit = servo / SERVO_RATE**2, [STOP_TIME_S, 1.0]
        play.limited, play.range = mujoco.mjtLimited.mjLIMITED_TRUE, [-half, half]
        done.append(f"{word} {name}_play in series, from {-half:.5f} to {half:.5f} {unit}")
    if "dead_band" in terms:
        loss = servo * terms["dead_band"]
        spec.joint(name).frictionloss = loss
        done.append(f"frictionloss {loss:.4g} {load} of joint {name} (servo of {servo:.4g} {per})")
    if (spring_name := spring_of(name, terms)) is not None:
        spring = 1.0 / terms["compliance"]
        _in_series(body, spring_name, kind, axis, spring)
        done.append(f"{word} {spring_name} in series with a stiffness of {spring:.4g} {per}")
    elif "compliance" in terms:
        done.append(NO_SPRING)
    if "share" in terms:
        gear = 1.0 / (1.0 + terms["share"])
        spec.actuator(name).gear = [gear, 0, 0, 0, 0, 0]
        done.append(f"gear {gear:.6f} of the servo {name}")
    return ", ".join(done)


def _add_bending(mujoco: Any, spec: Any, session: Session, robot: Robot, link: str, compliance: float) -> str:
    if compliance <= 0.0:
        return NO_SPRING
    # Of the corrected robot, whose mounts and lengths may differ.
    bends = {
        name: (middle, axes) for name, middle, axes in to_core(replace(session, robot=robot)).link_bends()
    }
    if link not in bends:
        raise MirrorPostureError(
            f"link_bending: got the link {link!r}, needed one that moves what is observed in {session.folder}: {', '.join(bends)}"
        )
    middle, axes = bends[link]
    names = [f"{link}_bend_{number}" for number in range(1, len(axes) + 1)]
    for name, axis in zip(names, np.array(axes), strict=True):
        hinge = _in_series(spec.body(link), name, mujoco.mjtJoint.mjJNT_HINGE, axis, 1.0 / compliance)
        hinge.pos = middle
    told = f"{', '.join(names[:-1])} and {names[-1]}"
    return f"hinges {told} with a stiffness of {1.0 / compliance:.4g} N m/rad"


def spring_of(joint: str, terms: Mapping[str, float]) -> str | None:
    """Name of the sprung joint behind a joint: stiction's droop and a compliance may be at one joint. None where it yields
    to no load."""
    if terms.get("compliance", 0.0) <= 0.0:
        return None
    return f"{joint}_droop" if "dead_band" in terms else f"{joint}_spring"


def _in_series(
    body: Any, name: str, kind: Any, axis: np.ndarray, stiffness: float, damping: float | None = None
) -> Any:
    """A further joint of the same body: MuJoCo puts the joints of a body in series."""
    return body.add_joint(
        name=name,
        type=kind,
        axis=axis,
        stiffness=stiffness,
        # Two springs on one and the same inertia (a droop and a compliance) would be singular without rotors of their own.
        armature=stiffness / SERVO_RATE**2,
        damping=PLAY_DAMPING * stiffness if damping is None else damping,
    )


def _gravity_in_world(session: Session, robot: Robot) -> Floats:
    """The session's gravity, which is in its root link's frame, in the frame of the robot's first link: that is MuJoCo's world."""
    rest = np.zeros((1, len(robot.position_names)))
    first, root = robot.link_poses(rest, [robot.link_names[0], session.root_link])[0]
    gravity: Floats = first[:3, :3].T @ root[:3, :3] @ session.gravity_m_per_s2
    # What is left of a turn by π is rounding.
    gravity[np.abs(gravity) < ROUNDING * np.linalg.norm(gravity)] = 0.0
    return gravity


def _servo_stiffness(session: Session, robot: Robot) -> dict[str, float]:
    """Stiffness of each joint's servo, N m/rad, from the largest torque that gravity puts on it in the session."""
    torque = np.abs(
        robot.gravity_torques(session.positions, session.gravity_m_per_s2, session.root_link)
    ).max(axis=0)
    return {
        name: max(LEAST_STIFFNESS, float(torque[i]) / DROOP_RAD)
        for i, name in enumerate(robot.position_names)
    }


def _without_pictures(urdf_text: str) -> str:
    """The URDF without shapes: their mesh files may be elsewhere, and touching bodies would push each
    other."""
    robot = ElementTree.fromstring(urdf_text)
    for link in robot.findall("link"):
        for tag in ("visual", "collision"):
            for shape in link.findall(tag):
                link.remove(shape)
    return ElementTree.tostring(robot, encoding="unicode")
