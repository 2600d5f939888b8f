"""Displaced bodies, axes and mounts in MuJoCo."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from mirror_posture import MirrorPostureError
from mirror_posture.arrays import Floats
from mirror_posture.rotations import pose_of, tilt_directions

from .changed import Changed, Values
from .joint_faults import PART_ARMATURE_KGM2, soften
from .model import element_of
from .mounts import turn_of_mount
from .poses import on_carrier, place, place_alone, place_on_carrier, pose


def axis_sign(changed: Changed, name: str, value: Values) -> tuple[str, str]:
    joint = changed.joint(name)
    joint.axis = -np.asarray(joint.axis, float)
    return name, "axis reversed"


def joints_swapped(changed: Changed, places: str, value: Values) -> tuple[str, str]:
    first, _, second = places.partition("<->joint:")
    for joint in (first, second):
        changed.joint(joint)
    changed.swapped.append((first, second))
    return first, f"the servos of {first} and {second} get each other's commands"


def link_bending(changed: Changed, name: str, value: Values) -> tuple[str, str]:
    body = _body(changed, name)
    tip = _tip(body)
    length = float(np.linalg.norm(tip))
    if length < 1e-6:
        raise MirrorPostureError(f"link_bending at link:{name}: the model's body has no length to bend over")
    first = np.cross(tip / length, np.eye(3)[int(np.argmin(np.abs(tip)))])
    first /= np.linalg.norm(first)
    stiffness = 0.0
    for number, axis in enumerate((first, np.cross(tip / length, first)), start=1):
        bend = changed.simulator.spec.joint(f"{name}_bend_{number}")
        if bend is None:
            bend = body.add_joint(
                name=f"{name}_bend_{number}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis, pos=0.5 * tip
            )
            bend.limited, bend.armature = mujoco.mjtLimited.mjLIMITED_FALSE, PART_ARMATURE_KGM2
        stiffness = soften(bend, value["compliance_rad_per_nm"])
    return f"{name}_bend_1", f"two hinges across the link at its middle, stiffness {stiffness:.5g} N m/rad"


def link_length(changed: Changed, name: str, value: Values) -> tuple[str, str]:
    moved = []
    for body, rotation in _carried(_body(changed, name)):
        body.pos = np.asarray(body.pos, float) + rotation.T @ _shift(value)
        moved.append(body.name)
    if not moved:
        raise MirrorPostureError(f"link_length at link:{name}: this body of the model carries no joint")
    return moved[0], f"moved by ({_millimetres(_shift(value))}) mm in the frame of {name}"


def axis_tilt(changed: Changed, name: str, value: Values) -> tuple[str, str]:
    joint = changed.joint(name)
    axis = np.asarray(joint.axis, float)
    axis = axis / np.linalg.norm(axis)
    u, v = tilt_directions(axis)
    tilted = axis + np.tan(value.get("tilt_1_rad", 0.0)) * u + np.tan(value.get("tilt_2_rad", 0.0)) * v
    joint.axis = tilted / np.linalg.norm(tilted)
    return name, "axis tilted"


def link_twist(changed: Changed, name: str, value: Values) -> tuple[str, str]:
    carried = [body for body, _ in _carried(_body(changed, name))]
    if len(carried) != 1:
        raise MirrorPostureError(
            f"link_twist at link:{name}: needed a body of the model that carries one joint, got one with {len(carried)}"
        )
    (body,) = carried
    joint = body.joints[0]
    axis = np.asarray(joint.axis, float)
    u, v = tilt_directions(axis / np.linalg.norm(axis))
    turn = pose_of(value.get("twist_1_rad", 0.0) * u + value.get("twist_2_rad", 0.0) * v, np.zeros(3))
    there = np.eye(4)
    there[:3, 3] = np.asarray(joint.pos, float)
    place(body, pose(body) @ there @ turn @ np.linalg.inv(there))
    return body.name, f"turned before joint {joint.name}"


def marker_mount(changed: Changed, name: str, value: Values) -> tuple[str, str]:
    marker = next((m for m in changed.session.markers if m.name == name), None)
    if marker is None:
        raise MirrorPostureError(
            f"the session has no marker {name!r}; it has {', '.join(changed.session.marker_names)}"
        )
    element = _what_is_mounted(changed, marker.link)
    moved = pose(element)
    moved[:3, 3] += _turn_of_mount(changed, marker.link, element) @ _shift(value)
    place_alone(element, moved)
    return element.name, f"moved by ({_millimetres(_shift(value))}) mm in the frame of its mount"


def _what_is_mounted(changed: Changed, link: str) -> Any:
    """The body or site of a marker's or camera's link; of a link that is itself moved by a joint a new site, because the limb stays as it is."""
    simulator = changed.simulator
    element = element_of(simulator.spec, simulator.stands_for.get(link, link))
    if not getattr(element, "joints", ()):
        return element
    simulator.stands_for[link] = f"{link}_mounted"
    return element.add_site(name=simulator.stands_for[link])


def _turn_of_mount(changed: Changed, link: str, element: Any) -> Floats:
    """From the frame in which a marker's mount is given to that of the body that carries the marker in the model.

    A mount is given in the frame of the link to which the URDF fixes the marker's link. The model may lack that link.
    """
    robot = changed.session.robot
    own, mount = pose(element)[:3, :3], turn_of_mount(robot, link)
    joint = robot.links[robot.link_index(link)].parent_joint
    if mount is None or joint is None:
        return own
    turn, at = np.eye(3), robot.joints[joint].parent_link
    while True:
        above = robot.links[robot.link_index(at)].parent_joint
        if at == element.parent.name or (above is None and element.parent.name == "world"):
            return turn
        fixed = turn_of_mount(robot, at)
        if fixed is None or above is None:
            # The model names this body otherwise: only the marker's own frame is common to both.
            return np.asarray(own @ mount.T)
        turn = fixed @ turn
        at = robot.joints[above].parent_link


def camera_mount(changed: Changed, name: str, value: Values) -> tuple[str, str]:
    link = _link(changed.session.camera_link, "camera")
    element = _what_is_mounted(changed, link)
    place_alone(element, pose(element) @ _motion(value))
    return element.name, "moved against the board"


def board_mount(changed: Changed, name: str, value: Values) -> tuple[str, str]:
    session, spec = changed.session, changed.simulator.spec
    board, camera = (
        _link(None if session.board is None else session.board.link, "board"),
        _link(session.camera_link, "camera"),
    )
    board_at, camera_at = element_of(spec, board), element_of(spec, camera)
    board_carrier, carrier_from_board = _on_carrier(board_at)
    camera_carrier, carrier_from_camera = _on_carrier(camera_at)
    moved = carrier_from_board @ _motion(value)
    together = board_carrier.id == camera_carrier.id
    place_on_carrier(board_at, moved)
    if together:
        place_on_carrier(camera_at, moved @ np.linalg.inv(carrier_from_board) @ carrier_from_camera)
    return board, "moved on its link" + (", the camera with it" if together else "")


def _on_carrier(element: Any) -> tuple[Any, Floats]:
    if getattr(element, "joints", ()):
        raise MirrorPostureError(
            f"board_mount: {element.name} is itself moved by a joint; give board and camera links of their own, fixed to the body"
        )
    return on_carrier(element)


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
            turn = pose(child)[:3, :3]
            out.extend((below, turn @ rotation) for below, rotation in _carried(child))
    return out


def _tip(body: Any) -> Floats:
    """The end of a link, in its frame: the next joint that it carries, otherwise the farthest part on it."""
    ends: list[Floats] = []

    def visit(child: Any, parent: Floats) -> None:
        here = parent @ pose(child)
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


def _motion(value: Values) -> Floats:
    return pose_of(np.array([value.get(f"r{axis}_rad", 0.0) for axis in "xyz"]), _shift(value))


def _link(link: str | None, what: str) -> str:
    if not link:
        raise MirrorPostureError(f"the session has no {what}; a cause at the {what} is of another session")
    return link


def _shift(value: Values) -> Floats:
    return np.array([value.get(f"d{axis}_m", 0.0) for axis in "xyz"])


def _millimetres(shift_m: Floats) -> str:
    return ", ".join(f"{x * 1e3:.3f}" for x in shift_m)
