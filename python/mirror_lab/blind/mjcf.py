"""An MJCF as URDF: the tree, masses, hinges and mounts that a session needs; MuJoCo itself reads the file."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from .errors import BlindError

Array = NDArray[np.float64]

FLIP = np.diag([1.0, -1.0, -1.0])
"""An MJCF camera looks along −z with y up; an optical frame along z with y down."""


def urdf_of_mjcf(path: Path) -> str:
    """The robot of an MJCF file as URDF text.

    Bodies become links, hinges and slides joints (a further one in the same body goes on a link without mass), sites
    and a `<camera name="camera_optical">` mounts. A free joint of the root is left out. Frames of links lie at their
    joints' anchors, as URDF has it.

    Raises BlindError for a file that MuJoCo refuses and for ball joints.
    """
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as e:
        raise BlindError(f"{path}: MuJoCo refuses it: {e}") from e
    tree, free = _rigged_tree(model, path)
    anchor = {0: np.zeros(3)}
    """By body: where its link's frame lies in the body's frame."""
    last_link = {0: "world"}
    parts: list[str] = [] if free else [_link("world")]
    for b in range(1, model.nbody):
        if int(model.body_rootid[b]) != tree:
            continue
        name, parent = model.body(b).name or f"body_{b}", int(model.body_parentid[b])
        joints = [
            j
            for j in range(model.body_jntadr[b], model.body_jntadr[b] + model.body_jntnum[b])
            if model.jnt_type[j] != mujoco.mjtJoint.mjJNT_FREE
        ]
        turn = _matrix(model.body_quat[b])
        anchor[b] = model.jnt_pos[joints[-1]].copy() if joints else np.zeros(3)
        carrier, at = last_link[parent], anchor[parent]
        if not joints and not (free and b == tree):
            parts.append(_joint(f"{name}_fixed", "fixed", carrier, name, model.body_pos[b] - at, turn))
        for k, j in enumerate(joints):
            child = name if k == len(joints) - 1 else f"{name}_{k}"
            here = model.body_pos[b] + turn @ model.jnt_pos[j] - at if k == 0 else model.jnt_pos[j] - at
            parts.append(_moving(model, j, carrier, child, here, turn if k == 0 else np.eye(3), path))
            if child != name:
                parts.append(_link(child))
            carrier, at = child, model.jnt_pos[j]
        parts.append(_link(name, model, b, anchor[b]))
        last_link[b] = name
    for s in range(model.nsite):
        body = int(model.site_bodyid[s])
        if body not in last_link or (free and body == 0):
            continue
        where = model.site_pos[s] - anchor[body]
        parts.append(_mount(model.site(s).name, last_link[body], where, _matrix(model.site_quat[s])))
    for c in range(model.ncam):
        body = int(model.cam_bodyid[c])
        if model.cam(c).name == "camera_optical" and body in last_link:
            where = model.cam_pos[c] - anchor[body]
            parts.append(_mount("camera_optical", last_link[body], where, _matrix(model.cam_quat[c]) @ FLIP))
    return f'<robot name="{path.stem}">\n' + "".join(parts) + "</robot>\n"


def _rigged_tree(model: mujoco.MjModel, path: Path) -> tuple[int, bool]:
    """The outermost body that carries the camera, and whether it floats: other trees of the file are scenery."""
    bodies = [int(model.site_bodyid[s]) for s in range(model.nsite) if model.site(s).name == "camera_optical"]
    bodies += [int(model.cam_bodyid[c]) for c in range(model.ncam) if model.cam(c).name == "camera_optical"]
    if not bodies:
        raise BlindError(
            f"{path}: needed a <camera> or a <site> `camera_optical`, a site `…_board` and sites `…_marker`; "
            f"its sites are {', '.join(model.site(s).name for s in range(model.nsite)) or 'none'}"
        )
    tree = int(model.body_rootid[bodies[0]])
    first = int(model.body_jntadr[tree])
    free = first >= 0 and model.jnt_type[first] == mujoco.mjtJoint.mjJNT_FREE
    return tree, bool(free)


def _moving(
    model: mujoco.MjModel, j: int, parent: str, child: str, at: Array, turn: Array, path: Path
) -> str:
    name = model.jnt(j).name or f"joint_{j}"
    kind = {mujoco.mjtJoint.mjJNT_HINGE: "revolute", mujoco.mjtJoint.mjJNT_SLIDE: "prismatic"}.get(
        mujoco.mjtJoint(int(model.jnt_type[j]))
    )
    if kind is None:
        raise BlindError(f"{path}: joint {name!r} is a ball joint; needed hinges and slides")
    low, high = model.jnt_range[j] if model.jnt_limited[j] else (-3.1, 3.1)
    more = (
        f'    <axis xyz="{_numbers(model.jnt_axis[j])}"/>\n'
        f'    <limit lower="{low:.9g}" upper="{high:.9g}" effort="1" velocity="1"/>\n'
    )
    return _joint(name, kind, parent, child, at, turn, more)


def _joint(name: str, kind: str, parent: str, child: str, at: Array, turn: Array, more: str = "") -> str:
    return (
        f'  <joint name="{name}" type="{kind}">\n'
        f'    <origin xyz="{_numbers(at)}" rpy="{_numbers(_rpy(turn))}"/>\n'
        f'    <parent link="{parent}"/>\n    <child link="{child}"/>\n{more}  </joint>\n'
    )


def _mount(name: str, parent: str, at: Array, turn: Array) -> str:
    return _link(name) + _joint(f"{name}_mount", "fixed", parent, name, at, turn)


def _link(name: str, model: mujoco.MjModel | None = None, body: int = 0, anchor: Array | None = None) -> str:
    if model is None or anchor is None or model.body_mass[body] <= 0:
        return f'  <link name="{name}"/>\n'
    x, y, z = model.body_inertia[body]
    turn = _matrix(model.body_iquat[body])
    return (
        f'  <link name="{name}">\n    <inertial>\n'
        f'      <origin xyz="{_numbers(model.body_ipos[body] - anchor)}" rpy="{_numbers(_rpy(turn))}"/>\n'
        f'      <mass value="{model.body_mass[body]:.9g}"/>\n'
        f'      <inertia ixx="{x:.9g}" iyy="{y:.9g}" izz="{z:.9g}" ixy="0" ixz="0" iyz="0"/>\n'
        f"    </inertial>\n  </link>\n"
    )


def _matrix(quaternion: Array) -> Array:
    out = np.zeros(9)
    mujoco.mju_quat2Mat(out, quaternion)
    return out.reshape(3, 3)


def _rpy(turn: Array) -> Array:
    """Roll, pitch, yaw of Rz(yaw) Ry(pitch) Rx(roll); at pitch ±90° the yaw is taken as 0."""
    flat = float(np.hypot(turn[0, 0], turn[1, 0]))
    pitch = float(np.arctan2(-turn[2, 0], flat))
    if flat < 1e-9:
        return np.array([np.arctan2(-turn[1, 2], turn[1, 1]), pitch, 0.0])
    return np.array([np.arctan2(turn[2, 1], turn[2, 2]), pitch, np.arctan2(turn[1, 0], turn[0, 0])])


def _numbers(v: Array) -> str:
    return " ".join(f"{x:.12g}" for x in v)
