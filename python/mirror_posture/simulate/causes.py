"""A diagnosis' causes, added one by one to the simulator's own model: what each effect is in MuJoCo.

Every function changes a `Changed` state (specification, drives, session) and returns one line that says what was changed:
it becomes a comment in the model that is written. Effects without an entry cannot be held by a simulator.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from .._core import MirrorPostureError
from ..diagnosis.applied.urdf import rotation_of_vector
from ..diagnosis.result import Cause
from ..diagnosis.vocabulary import IN_WORDS, joint_terms
from ..session import Session
from .model import STIFF_FRICTION, Simulator, element_of
from .motion import Drive

Floats = npt.NDArray[np.float64]
Values = Mapping[str, float]

PART_ARMATURE_KGM2 = 1e-4
"""Of what lies between a motor and a part that gives way; with less a play beside a spring chatters."""
STIFF_LIMIT = ([0.002, 1.0], [0.999, 0.9999, 0.0001, 0.5, 2.0])
"""The ends of a play: MuJoCo's own defaults give way by a fifth of a typical play."""
FRICTION_BEYOND_LOAD = 1.2
"""Friction in a play, as a share of the joint's largest torque, where the diagnosis found that its load never decides the side."""
LEAST_FRICTION_NM = 1e-4
DAMPING_PER_STIFFNESS_S = 0.02
BEARING_DAMPING_S = 5.0
"""Damping of a play's bearing over its friction: motions die out, the resting place is the same."""


@dataclass
class Changed:
    """What a cause may change."""

    simulator: Simulator
    session: Session
    largest_torque_nm: Mapping[str, float]
    drives: dict[str, list[Drive]] = field(default_factory=dict)
    comments: list[tuple[str, str]] = field(default_factory=list)
    """Name of the changed element of the model, and what was changed."""

    def add(self, cause: Cause) -> str | None:
        """Adds a cause; None where no simulator can hold it. Raises `MirrorPostureError` for a place that is not there."""
        value = {name: estimate.value for name, estimate in cause.parameters.items()}
        place, _, name = cause.at.partition(":")
        terms, law = joint_terms(cause.effect, value), LAWS.get(cause.effect)
        if terms:
            element, said = _joint(self, name, terms, value)
        elif law is not None:
            element, said = law(self, name or place, value)
        else:
            return None
        self.comments.append((element, f"{cause.effect} at {cause.at}: {said}"))
        return said

    def joint(self, name: str) -> Any:
        """A joint of the model. Raises `MirrorPostureError` that lists the joints there are."""
        joint = self.simulator.spec.joint(name)
        if joint is None:
            raise MirrorPostureError(
                f"the model has no joint {name!r} of the diagnosis; it has {', '.join(self.simulator.joints)}"
            )
        return joint

    def drive(self, joint: str, law: Drive) -> None:
        """Adds a fault of a joint's drive."""
        self.joint(joint)
        self.drives.setdefault(joint, []).append(law)


Law = Callable[[Changed, str, Values], tuple[str, str]]


def _joint(changed: Changed, places: str, terms: Values, value: Values) -> tuple[str, str]:
    """A law of a joint, term by term: what a motor is told, what lies behind it, and what its servo is."""
    name, _, other = places.partition("<-joint:")
    if other:
        changed.joint(other)
    element, said = name, []
    if "offset" in terms:
        said.append(_offset(changed, name, terms["offset"]))
    driven = [term for term in DRIVEN if term in terms]
    if driven:
        changed.drive(
            name, lambda q, t: sum(terms[term] * DRIVEN[term](q, t, name, other) for term in driven)
        )
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


def _offset(changed: Changed, name: str, offset_rad: float) -> str:
    joint = changed.joint(name)
    joint.ref = float(joint.ref) - offset_rad * changed.simulator.angle_unit
    return f"ref less {offset_rad:.6f} rad"


def _axis_sign(changed: Changed, name: str, value: Values) -> tuple[str, str]:
    joint = changed.joint(name)
    joint.axis = -np.asarray(joint.axis, float)
    return name, "axis reversed"


def _joints_swapped(changed: Changed, places: str, value: Values) -> tuple[str, str]:
    first, _, second = places.partition("<->joint:")
    changed.drive(first, lambda q, t: q[second] - q[first])
    changed.drive(second, lambda q, t: q[first] - q[second])
    return first, f"the servos of {first} and {second} get each other's commands"


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
    _set_spring(spring, stiffness)
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


def _link_bending(changed: Changed, name: str, value: Values) -> tuple[str, str]:
    body = _body(changed, name)
    tip = _tip(body)
    length = float(np.linalg.norm(tip))
    if length < 1e-6:
        raise MirrorPostureError(f"link_bending at link:{name}: the model's body has no length to bend over")
    stiffness = 1.0 / value["compliance_rad_per_nm"]
    first = np.cross(tip / length, np.eye(3)[int(np.argmin(np.abs(tip)))])
    first /= np.linalg.norm(first)
    for number, axis in enumerate((first, np.cross(tip / length, first)), start=1):
        bend = body.add_joint(
            name=f"{name}_bend_{number}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis, pos=0.5 * tip
        )
        bend.limited, bend.armature = mujoco.mjtLimited.mjLIMITED_FALSE, PART_ARMATURE_KGM2
        _set_spring(bend, stiffness)
    return f"{name}_bend_1", f"two hinges across the link at its middle, stiffness {stiffness:.5g} N m/rad"


def _link_length(changed: Changed, name: str, value: Values) -> tuple[str, str]:
    moved = []
    for body, rotation in _carried(_body(changed, name)):
        body.pos = np.asarray(body.pos, float) + rotation.T @ _shift(value)
        moved.append(body.name)
    if not moved:
        raise MirrorPostureError(f"link_length at link:{name}: this body of the model carries no joint")
    return moved[0], f"moved by ({_millimetres(_shift(value))}) mm in the frame of {name}"


def _axis_tilt(changed: Changed, name: str, value: Values) -> tuple[str, str]:
    joint = changed.joint(name)
    axis = np.asarray(joint.axis, float)
    axis = axis / np.linalg.norm(axis)
    e = np.array([1.0, 0.0, 0.0]) if abs(axis[0]) < 0.8 else np.array([0.0, 1.0, 0.0])
    u = np.cross(axis, e)
    u /= np.linalg.norm(u)
    tilted = (
        axis
        + np.tan(value.get("tilt_1_rad", 0.0)) * u
        + np.tan(value.get("tilt_2_rad", 0.0)) * np.cross(axis, u)
    )
    joint.axis = tilted / np.linalg.norm(tilted)
    return name, "axis tilted"


def _marker_mount(changed: Changed, name: str, value: Values) -> tuple[str, str]:
    marker = next((m for m in changed.session.markers if m.name == name), None)
    if marker is None:
        raise MirrorPostureError(
            f"the session has no marker {name!r}; it has {', '.join(changed.session.marker_names)}"
        )
    element = element_of(changed.simulator.spec, marker.link)
    element.pos = np.asarray(element.pos, float) + _shift(value)
    return marker.link, f"moved by ({_millimetres(_shift(value))}) mm"


def _camera_mount(changed: Changed, name: str, value: Values) -> tuple[str, str]:
    link = _link(changed.session.camera_link, "camera")
    _move(element_of(changed.simulator.spec, link), value)
    return link, "moved against the board"


def _board_mount(changed: Changed, name: str, value: Values) -> tuple[str, str]:
    session, spec = changed.session, changed.simulator.spec
    board, camera = (
        _link(None if session.board is None else session.board.link, "board"),
        _link(session.camera_link, "camera"),
    )
    board_at, camera_at = element_of(spec, board), element_of(spec, camera)
    board_carrier, carrier_from_board = _on_carrier(board_at)
    camera_carrier, carrier_from_camera = _on_carrier(camera_at)
    moved = carrier_from_board @ _motion(value)
    together = board_carrier == camera_carrier
    if together:
        riding = moved @ np.linalg.inv(carrier_from_board) @ carrier_from_camera
        _place(camera_at, _pose(camera_at) @ np.linalg.inv(carrier_from_camera) @ riding)
    _place(board_at, _pose(board_at) @ _motion(value))
    return board, "moved on its link" + (", the camera with it" if together else "")


def _in_lens(change: Callable[[Any, Values], dict[str, Any]]) -> Law:
    def law(changed: Changed, name: str, value: Values) -> tuple[str, str]:
        camera = changed.session.camera
        if camera is None:
            raise MirrorPostureError("the session has no camera; a cause at the camera is of another session")
        fields = change(camera, value)
        changed.session = replace(changed.session, camera=replace(camera, **fields))
        return "", f"camera: {', '.join(fields)}"

    return law


def _focal(camera: Any, value: Values) -> dict[str, Any]:
    factor = 1.0 + value["scale_error"]
    return {"focal_px": (factor * camera.fx_px, factor * camera.fy_px)}


def _center(camera: Any, value: Values) -> dict[str, Any]:
    return {"center_px": (camera.cx_px + value.get("du_px", 0.0), camera.cy_px + value.get("dv_px", 0.0))}


def _lens(camera: Any, value: Values) -> dict[str, Any]:
    first, *rest = camera.distortion or (0.0,) * 5
    model = "plumb_bob" if camera.distortion_model == "none" else camera.distortion_model
    return {"distortion_model": model, "distortion": (first + value["dk1"], *rest)}


def _board_scale(changed: Changed, name: str, value: Values) -> tuple[str, str]:
    board = changed.session.board
    if board is None:
        raise MirrorPostureError("the session has no board; a cause at the board is of another session")
    square_m = (1.0 + value["scale_error"]) * board.square_m
    changed.session = replace(changed.session, board=replace(board, square_m=square_m))
    return "", f"board: squares of {square_m * 1e3:.4f} mm"


def _mirror_glass(changed: Changed, name: str, value: Values) -> tuple[str, str]:
    mirror = changed.session.mirror
    if mirror is None:
        raise MirrorPostureError("the session has no mirror; a cause at the mirror is of another session")
    thickness = max(0.0, value["thickness_m"])
    changed.session = replace(changed.session, mirror=replace(mirror, glass_thickness_m=thickness))
    return "", f"mirror: {thickness * 1e3:.3f} mm of glass"


LAWS: Mapping[str, Law] = {
    "link_bending": _link_bending,
    "link_length": _link_length,
    "axis_tilt": _axis_tilt,
    "axis_sign": _axis_sign,
    "joints_swapped": _joints_swapped,
    "marker_mount": _marker_mount,
    "camera_mount": _camera_mount,
    "board_mount": _board_mount,
    "camera_focal": _in_lens(_focal),
    "camera_center": _in_lens(_center),
    "lens_distortion": _in_lens(_lens),
    "board_scale": _board_scale,
    "mirror_glass": _mirror_glass,
}
"""By effect of docs/effects.md that is no law of a joint: what it is in a simulator."""


def is_held(effect: str) -> bool:
    """Whether a simulator can hold an effect."""
    told = IN_WORDS.get(effect)
    return effect in LAWS or (told is not None and bool(told["joint_law"]))


def _body(changed: Changed, name: str) -> Any:
    body = changed.simulator.spec.body(name)
    if body is None:
        names = ", ".join(body.name for body in changed.simulator.spec.bodies[1:])
        raise MirrorPostureError(f"the model has no body {name!r} of the diagnosis; its bodies: {names}")
    return body


def _carried(body: Any) -> list[tuple[Any, Floats]]:
    """The bodies with joints that a body carries next, with the rotation of their parent's frame in the body's."""
    out: list[tuple[Any, Floats]] = []
    for child in body.bodies:
        if child.joints:
            out.append((child, np.eye(3)))
        else:
            turn = _pose(child)[:3, :3]
            out.extend((below, turn @ rotation) for below, rotation in _carried(child))
    return out


def _on_carrier(element: Any) -> tuple[str, Floats]:
    """The nearest body with joints that an element is fixed to (the world where there is none), and its pose there."""
    if getattr(element, "joints", ()):
        raise MirrorPostureError(
            f"board_mount: {element.name} is itself moved by a joint; give board and camera links of their own, fixed to the body"
        )
    pose, body = _pose(element), element.parent
    while body.name != "world" and not body.joints:
        pose, body = _pose(body) @ pose, body.parent
    return body.name, pose


def _tip(body: Any) -> Floats:
    """Where a link ends, in its frame: the next joint that it carries, else the farthest thing on it."""
    ends: list[Floats] = []

    def visit(child: Any, pose: Floats) -> None:
        here = pose @ _pose(child)
        if child.joints:
            ends.insert(0, here[:3, 3])
            return
        ends.append(here[:3, 3])
        for below in child.bodies:
            visit(below, here)

    jointed = [below for below, _ in _carried(body)]
    for child in body.bodies:
        visit(child, np.eye(4))
    if jointed:
        return ends[0]
    ends.extend(np.asarray(site.pos, float) for site in body.sites)
    return max(ends, key=lambda end: float(np.linalg.norm(end)), default=np.zeros(3))


def _in_series(simulator: Simulator, joint: Any, name: str) -> Any:
    """A further joint of the same body behind a joint: MuJoCo puts the joints of a body in series."""
    part = joint.parent.add_joint(name=name, type=joint.type, axis=joint.axis, pos=joint.pos)
    part.armature, part.limited = PART_ARMATURE_KGM2, mujoco.mjtLimited.mjLIMITED_FALSE
    return part


def _set_spring(part: Any, stiffness: float) -> None:
    _set(part, "stiffness", stiffness)
    _set(part, "damping", DAMPING_PER_STIFFNESS_S * stiffness)


def _set(part: Any, name: str, value: float) -> None:
    # A polynomial in newer releases of MuJoCo, a number in older ones.
    try:
        setattr(part, name, [value, 0.0, 0.0])
    except (TypeError, ValueError):
        setattr(part, name, value)


def _motion(value: Values) -> Floats:
    out = np.eye(4)
    out[:3, :3] = rotation_of_vector(np.array([value.get(f"r{axis}_rad", 0.0) for axis in "xyz"]))
    out[:3, 3] = _shift(value)
    return out


def _move(element: Any, value: Values) -> None:
    _place(element, _pose(element) @ _motion(value))


def _pose(element: Any) -> Floats:
    pose, rotation = np.eye(4), np.zeros(9)
    mujoco.mju_quat2Mat(rotation, np.asarray(element.quat, float) / np.linalg.norm(element.quat))
    pose[:3, :3], pose[:3, 3] = rotation.reshape(3, 3), np.asarray(element.pos, float)
    return pose


def _place(element: Any, pose: Floats) -> None:
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(pose[:3, :3]).ravel())
    element.pos, element.quat = pose[:3, 3], quaternion


def _link(link: str | None, what: str) -> str:
    if not link:
        raise MirrorPostureError(f"the session has no {what}; a cause at the {what} is of another session")
    return link


def _shift(value: Values) -> Floats:
    return np.array([value.get(f"d{axis}_m", 0.0) for axis in "xyz"])


def _millimetres(shift_m: Floats) -> str:
    return ", ".join(f"{x * 1e3:.3f}" for x in shift_m)
