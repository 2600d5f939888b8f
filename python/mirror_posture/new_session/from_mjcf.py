"""An MJCF's bodies, joints and shapes as URDF: the same kinematics and masses."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from .._core import MirrorPostureError
from ..arrays import Floats
from ..rotations import rotation_of_vector, rpy_of_rotation
from ..shapes.triangles import Triangles
from .mjcf_shapes import MjcfShapes, origin_text, rotation_of_quaternion

MASSLESS = "_before_"


def urdf_from_mjcf(file: Path) -> tuple[str, dict[str, Triangles], list[str]]:
    """The URDF of a robot that an MJCF describes, its meshes by file name, and warnings of what was left out.

    Joint values mean the same in both. Bodies become links of their names. Of several joints of a body, and of a joint that
    is off its body's origin, links without mass come in between. A free joint at the root fixes the root where the file puts
    it. A linear coupling of two joints becomes `<mimic>`; other equalities are told in the warnings.

    Raises:
        MirrorPostureError: MuJoCo is missing or cannot load the file; a ball joint, a nameless joint, two roots.
    """
    try:
        import mujoco
    except ImportError:
        raise MirrorPostureError(
            f"{file}: an MJCF needs MuJoCo: pip install 'mirror-posture[mujoco]'"
        ) from None
    try:
        model = mujoco.MjModel.from_xml_path(str(file))
    except ValueError as error:
        raise MirrorPostureError(f"{file}: MuJoCo cannot load it: {' '.join(str(error).split())}") from None
    shapes = MjcfShapes(model)
    mimics, warnings = _couplings(model)
    lines = [
        '<?xml version="1.0"?>',
        f"<robot name={quoteattr(file.stem)}>",
        _link("world", model, 0, shapes),
    ]
    names = ["world", *(_name(model.body(index).name, f"body_{index}") for index in range(1, model.nbody))]
    for index in range(1, model.nbody):
        body = model.body(index)
        lines.append(_link(names[index], model, index, shapes))
        carried: Floats = np.eye(4)
        carried[:3, :3] = rotation_of_quaternion(body.quat)
        carried[:3, 3] = body.pos
        parent = names[int(model.body_parentid[index])]
        for number in range(int(body.jntnum[0])):
            identity = int(body.jntadr[0]) + number
            kind = mujoco.mjtJoint(int(model.jnt_type[identity]))
            if kind == mujoco.mjtJoint.mjJNT_FREE:
                continue
            joint = model.joint(identity)
            if kind == mujoco.mjtJoint.mjJNT_BALL or not joint.name:
                what = "is a ball joint" if joint.name else "has no name"
                raise MirrorPostureError(
                    f"{file}: joint {joint.name or identity} of body {names[index]} {what}; needed named hinges and slides"
                )
            hinge = kind == mujoco.mjtJoint.mjJNT_HINGE
            ref = float(model.qpos0[model.jnt_qposadr[identity]])
            # MuJoCo moves by q - ref about a point of the body.
            before = np.eye(4)
            before[:3, 3] = joint.pos
            back: Floats = np.linalg.inv(before).astype(np.float64, copy=False)
            if hinge:
                before[:3, :3] = rotation_of_vector(-ref * np.asarray(joint.axis))
            else:
                before[:3, 3] -= ref * np.asarray(joint.axis)
            child = f"{names[index]}{MASSLESS}{number}"
            lines.append(f"  <link name={quoteattr(child)}/>")
            limits = (
                tuple(float(v) for v in joint.range)
                if bool(model.jnt_limited[identity])
                else (-math.inf, math.inf)
            )
            lines.append(
                _moving(
                    joint.name,
                    hinge,
                    parent,
                    child,
                    carried @ before,
                    joint.axis,
                    limits,
                    mimics.get(joint.name, ""),
                )
            )
            parent, carried = child, back
        lines.append(_fixed(f"{names[index]}_fixed", parent, names[index], carried))
    return "\n".join([*lines, "</robot>", ""]), shapes.meshes, warnings


def _couplings(model: Any) -> tuple[dict[str, str], list[str]]:
    """`<mimic>` by joint, and a warning for each active equality that a URDF cannot hold."""
    import mujoco

    mimics: dict[str, str] = {}
    leaders: dict[str, str] = {}
    warnings = []
    for index in range(model.neq):
        if not model.eq_active0[index]:
            continue
        kind = mujoco.mjtEq(int(model.eq_type[index]))
        leader_id = int(model.eq_obj2id[index])
        if kind == mujoco.mjtEq.mjEQ_JOINT and leader_id >= 0:
            leader, follower = model.joint(leader_id), model.joint(int(model.eq_obj1id[index]))
            offset, factor, *higher = (float(value) for value in model.eq_data[index][:5])
            # No joint has two leaders, and none follows itself by others.
            end = leader.name
            while end in leaders:
                end = leaders[end]
            if factor and not any(higher) and follower.name not in (end, *leaders):
                # MuJoCo couples the distances from qpos0, a URDF the positions.
                offset += float(follower.qpos0[0]) - factor * float(leader.qpos0[0])
                leaders[follower.name] = leader.name
                mimics[follower.name] = (
                    f'<mimic joint={quoteattr(leader.name)} multiplier="{factor:.12g}" offset="{offset:.12g}"/>'
                )
                continue
        name = model.equality(index).name or str(index)
        warnings.append(
            f"equality {name} ({kind.name.removeprefix('mjEQ_').lower()}) is left out: a URDF holds linear couplings of two joints only; "
            "the joints that it holds together move freely in the session's robot"
        )
    return mimics, warnings


def _name(given: str, default: str) -> str:
    return given or default


def _link(name: str, model: Any, index: int, shapes: MjcfShapes) -> str:
    inside = _inertial(model, index) + shapes.of_body(index)
    return (
        f"  <link name={quoteattr(name)}>\n{inside}  </link>"
        if inside
        else f"  <link name={quoteattr(name)}/>"
    )


def _inertial(model: Any, index: int) -> str:
    mass = float(model.body_mass[index])
    if mass <= 0.0:
        return ""
    com = " ".join(f"{v:.12g}" for v in model.body_ipos[index])
    quat = model.body_iquat[index]

    rpy = " ".join(f"{v:.12g}" for v in rpy_of_rotation(rotation_of_quaternion(quat)))
    xx, yy, zz = (f"{v:.12g}" for v in model.body_inertia[index])
    return (
        f'    <inertial><origin xyz="{com}" rpy="{rpy}"/><mass value="{mass:.12g}"/>'
        f'<inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/></inertial>\n'
    )


def _fixed(name: str, parent: str, child: str, pose: Any) -> str:
    return (
        f'  <joint name={quoteattr(name)} type="fixed"><parent link={quoteattr(parent)}/>'
        f"<child link={quoteattr(child)}/>{origin_text(pose)}</joint>"
    )


def _moving(
    name: str,
    hinge: bool,
    parent: str,
    child: str,
    pose: Any,
    axis: Any,
    limits: tuple[float, ...],
    mimic: str,
) -> str:
    bounded = math.isfinite(limits[0])
    kind = ("revolute" if bounded else "continuous") if hinge else "prismatic"
    lower, upper = limits if bounded else (-10.0, 10.0)
    limit = f'<limit lower="{lower:.12g}" upper="{upper:.12g}" effort="1000" velocity="100"/>'
    told = "" if kind == "continuous" else limit
    return (
        f'  <joint name={quoteattr(name)} type="{kind}"><parent link={quoteattr(parent)}/>'
        f"<child link={quoteattr(child)}/>{origin_text(pose)}"
        f'<axis xyz="{" ".join(f"{v:.12g}" for v in axis)}"/>{told}{mimic}</joint>'
    )
