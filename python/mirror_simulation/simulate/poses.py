"""Where bodies and sites of a specification are: in the frame of the body that carries each."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from mirror_posture.arrays import Floats


def flatten(spec: Any, model: mujoco.MjModel) -> None:
    """Gives bodies, sites and joints their places in the frame of the body that carries them, by quaternion.

    An MJCF may give an orientation as angles, and a place in a `<frame>`: then `pos`, `quat` and `axis` of the specification are not
    those of the compiled `model`, and MuJoCo would pass over what is written to `quat`.
    """
    for elements, pos, quat in (
        (spec.bodies[1:], model.body_pos, model.body_quat),
        (spec.sites, model.site_pos, model.site_quat),
    ):
        for element in elements:
            if element.frame is None and element.alt.type == mujoco.mjtOrientation.mjORIENTATION_QUAT:
                continue
            at = element.id
            element.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
            element.pos, element.quat = pos[at].copy(), quat[at].copy()
            _leave_frame(element)
    for joint in spec.joints:
        if joint.frame is not None and joint.type != mujoco.mjtJoint.mjJNT_FREE:
            at = joint.id
            joint.pos, joint.axis = model.jnt_pos[at].copy(), model.jnt_axis[at].copy()
            _leave_frame(joint)


def _leave_frame(element: Any) -> None:
    """Puts an element into a frame that is its body's: MuJoCo knows no way to take it out of one."""
    if element.frame is not None:
        element.set_frame(element.parent.add_frame())


def pose(element: Any) -> Floats:
    """`parent_from_element` (4, 4) of a body or site."""
    out, rotation = np.eye(4), np.zeros(9)
    mujoco.mju_quat2Mat(rotation, np.asarray(element.quat, float) / np.linalg.norm(element.quat))
    out[:3, :3], out[:3, 3] = rotation.reshape(3, 3), np.asarray(element.pos, float)
    return out


def place(element: Any, parent_from_element: Floats) -> None:
    """Puts a body, with all that it carries, or a site elsewhere on its parent."""
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(parent_from_element[:3, :3]).ravel())
    element.pos, element.quat = parent_from_element[:3, 3], quaternion


def place_alone(element: Any, parent_from_element: Floats) -> None:
    """As `place`, but the bodies and sites that a body carries stay where they are."""
    before = pose(element)
    place(element, parent_from_element)
    back = np.linalg.inv(parent_from_element) @ before
    for carried in [*getattr(element, "bodies", ()), *getattr(element, "sites", ())]:
        place(carried, back @ pose(carried))


def on_carrier(element: Any) -> tuple[Any, Floats]:
    """The nearest body with joints that an element is fixed to (the world where there is none), and its pose there."""
    out, body = pose(element), element.parent
    while body.name != "world" and not body.joints:
        out, body = pose(body) @ out, body.parent
    return body, out


def place_on_carrier(element: Any, carrier_from_element: Floats) -> None:
    """As `place_alone`, given the pose on the nearest body with joints."""
    _, here = on_carrier(element)
    carrier_from_parent = here @ np.linalg.inv(pose(element))
    place_alone(element, np.linalg.inv(carrier_from_parent) @ carrier_from_element)
