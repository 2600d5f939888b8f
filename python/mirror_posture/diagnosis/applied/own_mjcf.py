"""Writes the causes into the user's own MJCF: meshes, geoms, sites, order and comments stay."""

from __future__ import annotations

import math
import os
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..._core import MirrorPostureError
from ...input_files import reason
from ...output_files import write_file
from ..parts import Cause
from ..vocabulary import BESIDE, joint_terms
from .another_robot import Check
from .apply import NOT_IN_A_MODEL
from .mjcf import (
    HINGE,
    LEAST_STIFFNESS,
    NO_SPRING,
    PLAY_DAMPING,
    SERVO_RATE,
    SLIDE,
    STOP_TIME_S,
    spring_of,
)
from .xml_text import Element, XmlText, read_xml

LEAST_ARMATURE = 1e-4
"""kg m²: of a joint whose file states none."""
WRITTEN = {"offset", "share", "play", "compliance", "dead_band"}
"""The terms of a joint's law that MuJoCo can represent."""
OF_FRAMES = "an MJCF names frames differently from a URDF; take it over from the corrected robot.urdf by hand"
OF_BENDING = "a link bends in robot.mjcf.xml only, beside it"
TOLERANCE = 1e-6
"""rad (m): rounding of what is written and read again; a wrong unit is far more."""
Wanted = dict[tuple[str, str], Sequence[float]]
"""What MuJoCo is to read, rad (m), by joint and by `qpos0`, `range`, `axis` or `pos`."""


@dataclass(frozen=True)
class _Read:
    """A file as MuJoCo reads it: the compiled model, the specification with each joint's own numbers, and whether angles are in degrees:
    the last `compiler` counts, of included files too."""

    model: Any
    spec: Any
    degrees: bool


def patch_own_mjcf(
    own: Path, causes: Sequence[Cause], out: Path, check: Check | None = None
) -> dict[tuple[str, str], str]:
    """Writes a user's MJCF with the causes that it can hold; returns what was written, by effect and place.

    - an offset a: the joint's `ref` becomes ref − a, since MuJoCo turns by qpos − ref.
    - a share e of its own position: the `gear` of the joint's position servo is divided by 1 + e: it then stops at (1 + e) of its command.
    - play, compliance: a further joint behind the joint, limited or sprung.
    - a dead band: `frictionloss` = kp times the dead band, kp of the joint's position servo.

    The written file is loaded by MuJoCo before it is kept, and its joints are compared with what is meant. What of the robot
    cannot be written is told with its reason, which starts with "not written". `check` takes the names of the file's joints, of
    included files too.

    Raises:
        MirrorPostureError: MuJoCo is missing, or one of the files cannot be loaded; a folder that cannot be written; what `check` raises.
    """
    try:
        import mujoco  # type: ignore[import-untyped, unused-ignore]
    except ImportError:
        raise MirrorPostureError("an MJCF needs MuJoCo: pip install 'mirror-posture[mujoco]'") from None
    text = read_xml(own)
    document = XmlText(text, str(own))
    if document.root.tag != "mujoco":
        raise MirrorPostureError(
            f"{own}: got <{document.root.tag}>, needed an MJCF (<mujoco>); a URDF is given as --urdf"
        )
    read = _load(mujoco, own, text)
    model = read.model
    if check is not None:
        names = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, index) for index in range(model.njnt)]
        check([name for name in names if name])
    told: dict[tuple[str, str], str] = {}
    wanted: Wanted = {}
    for cause in causes:
        values = {key: estimate.value for key, estimate in cause.parameters.items()}
        terms = joint_terms(cause.effect, values)
        if terms and terms.keys() <= WRITTEN:
            told[cause.effect, cause.at] = _write(mujoco, read, document, cause.at, terms, wanted)
        elif why := _not_of_an_mjcf(cause):
            told[cause.effect, cause.at] = f"not written: {why}"
    better = document.text()
    _require(own, wanted, _load(mujoco, own, better).model)
    write_file(out, better.encode("utf-8"))
    return told


def _load(mujoco: Any, own: Path, text: str) -> _Read:
    try:
        # Beside the own file: its meshes and includes are found from there.
        handle, name = tempfile.mkstemp(dir=own.parent, prefix=f".{own.stem}-", suffix=".xml")
    except OSError as error:
        raise MirrorPostureError(
            f"{own}: its folder cannot be written ({reason(error)}), and MuJoCo finds meshes and included files only from "
            "there; give a copy of the folder"
        ) from None
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(text.encode("utf-8"))
        spec = mujoco.MjSpec.from_file(name)
        return _Read(spec.compile(), spec, bool(spec.compiler.degree))
    except ValueError as error:
        told = " ".join(str(error).split()).replace(name, str(own))
        raise MirrorPostureError(f"{own}: MuJoCo cannot load it: {told}") from None
    finally:
        os.unlink(name)


def _require(own: Path, wanted: Wanted, model: Any) -> None:
    """MuJoCo reads the joints as they are meant, in their unit."""
    for (name, what), values in wanted.items():
        got = getattr(model.joint(name), what)
        if not np.allclose(got, values, rtol=0.0, atol=TOLERANCE):
            raise MirrorPostureError(
                f"{own}: MuJoCo would read {what} = {np.round(got, 6)} rad (m) of joint {name}, needed {np.round(values, 6)}; "
                "state the unit of the angles in one <compiler>"
            )


def _not_of_an_mjcf(cause: Cause) -> str | None:
    """Why a cause of the robot is not written; None for one of the camera, the setup or the data."""
    if not cause.at.startswith(("joint:", "link:")) or (
        cause.effect in BESIDE and cause.effect != "axis_sign"
    ):
        return None
    if cause.effect == "link_bending":
        return OF_BENDING
    return NOT_IN_A_MODEL.get(cause.effect, OF_FRAMES)


def _write(
    mujoco: Any,
    read: _Read,
    document: XmlText,
    at: str,
    terms: Mapping[str, float],
    wanted: Wanted,
) -> str:
    name, model = at.partition(":")[2], read.model
    joint = next(
        (
            e
            for e in document.elements
            if e.tag == "joint" and e.attributes.get("name") == name and _in_body(e)
        ),
        None,
    )
    identity = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
    if joint is None or identity < 0:
        where = "stands in an included file: give that file" if identity >= 0 else "is not in this file"
        return f"not written: joint {name} {where}"
    hinge = int(model.jnt_type[identity]) == int(mujoco.mjtJoint.mjJNT_HINGE)
    factor = 180.0 / math.pi if read.degrees and hinge else 1.0
    if "offset" in terms:
        ref = float(model.qpos0[model.jnt_qposadr[identity]]) - terms["offset"]
        wanted[name, "qpos0"], wanted[name, "range"] = [ref], model.joint(name).range.tolist()
        document.set(joint, "ref", f"{factor * ref:.12g}")
        return f"ref of joint {name}"
    servos = _position_servos(mujoco, model, identity)
    if "share" in terms:
        return _write_gear(mujoco, model, document, name, servos, terms["share"])
    told = []
    if "dead_band" in terms:
        told.append(_write_friction(model, document, joint, name, servos, terms["dead_band"], hinge))
    spring = spring_of(name, terms)
    if spring is None and "play" not in terms:
        return "; ".join([*told, NO_SPRING] if "compliance" in terms else told)
    stiffness = (
        max((float(model.actuator_gainprm[index, 0]) for index in servos), default=0.0) or LEAST_STIFFNESS
    )
    if model.nkey:
        what = "play" if spring is None else "spring"
        told.append(
            f"not written: a {what}: the keyframes of this file fit its {model.nq} positions; a further joint needs new ones"
        )
    else:
        told.append(
            _write_series(read, document, joint, name, terms, spring, factor, stiffness, hinge, wanted)
        )
    return "; ".join(told)


def _position_servos(mujoco: Any, model: Any, joint: int) -> list[int]:
    """The actuators that pull a joint to a commanded position: with as much force per command as per position. Motors and velocity
    servos do not."""
    return [
        index
        for index in range(model.nu)
        if int(model.actuator_trntype[index]) == int(mujoco.mjtTrn.mjTRN_JOINT)
        and int(model.actuator_trnid[index, 0]) == joint
        and (gain := float(model.actuator_gainprm[index, 0])) > 0.0
        and math.isclose(gain, -float(model.actuator_biasprm[index, 1]))
    ]


def _write_friction(
    model: Any, document: XmlText, joint: Element, name: str, servos: list[int], dead_band: float, hinge: bool
) -> str:
    if not servos:
        return f"not written: joint {name} has no position servo, whose stiffness the dead band needs"
    # A servo pulls with gear · kp · (command - gear · q).
    gain = float(model.actuator_gainprm[servos[0], 0])
    loss = gain * float(model.actuator_gear[servos[0], 0]) ** 2 * dead_band
    document.set(joint, "frictionloss", f"{loss:.9g}")
    return f"frictionloss of joint {name}: {loss:.4g} {(HINGE if hinge else SLIDE)[2]}"


def _write_gear(
    mujoco: Any, model: Any, document: XmlText, name: str, servos: list[int], error: float
) -> str:
    if len(servos) != 1:
        has = f"{len(servos)} position servos, needed one" if servos else "no position servo"
        return f"not written: joint {name} has {has}; the gear of a motor scales its torque, not a position"
    joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
    # In the file's own order, which MuJoCo keeps.
    driving = [
        index
        for index in range(model.nu)
        if int(model.actuator_trntype[index]) == int(mujoco.mjtTrn.mjTRN_JOINT)
        and int(model.actuator_trnid[index, 0]) == joint
    ]
    found = [
        element
        for element in document.elements
        if element.parent is not None
        and element.parent.tag == "actuator"
        and element.attributes.get("joint") == name
    ]
    if len(found) != len(driving):
        return f"not written: joint {name} has {len(found)} of its {len(driving)} actuators in this file, needed all"
    gears = model.actuator_gear[servos[0]].copy()
    gears[0] /= 1.0 + error
    last = max(index for index in range(6) if gears[index] or index == 0)
    servo = found[driving.index(servos[0])]
    document.set(servo, "gear", " ".join(f"{gear:.12g}" for gear in gears[: last + 1]))
    return f"gear of the actuator of joint {name}: {gears[0]:.6f}"


def _write_series(
    read: _Read,
    document: XmlText,
    joint: Element,
    name: str,
    terms: Mapping[str, float],
    spring: str | None,
    factor: float,
    stiffness: float,
    hinge: bool,
    wanted: Wanted,
) -> str:
    """A joint of the same body, behind the joint: MuJoCo puts the joints of a body in series."""
    model, own = read.model, read.spec.joint(name)
    compiled = model.joint(name)
    # As the file tells them, of defaults too: a <frame> around both joints turns both.
    told = {
        "axis": " ".join(f"{v:.12g}" for v in own.axis),
        "pos": " ".join(f"{v:.12g}" for v in own.pos),
    }
    further = f"{name}_play" if spring is None else spring
    wanted[further, "axis"], wanted[further, "pos"] = compiled.axis.tolist(), compiled.pos.tolist()
    # Two joints that turn one and the same inertia are unstable to step: rotors like those of the own servos' part them.
    # The statics do not depend on it.
    rotor = max(float(model.dof_armature[compiled.dofadr[0]]), stiffness / SERVO_RATE**2, LEAST_ARMATURE)
    kind, unit, _, per = HINGE if hinge else SLIDE
    told |= {"armature": f"{rotor:.6g}"}
    if spring is None:
        half = factor * terms["play"] / 2.0
        wanted[further, "range"] = [-terms["play"] / 2.0, terms["play"] / 2.0]
        document.insert_after(
            joint,
            "joint",
            {"name": further, "type": kind, **told, "limited": "true", "range": f"{-half:.9g} {half:.9g}",
             "stiffness": "0", "frictionloss": "0", "damping": f"{PLAY_DAMPING * stiffness:.6g}", "ref": "0",
             "solreflimit": f"{STOP_TIME_S:g} 1", "solimplimit": "0.99 0.999 0.001"},
        )  # fmt: skip
        return f"{kind} {further} behind it, of {terms['play']:.5f} {unit}"
    stiff = 1.0 / terms["compliance"]
    document.insert_after(
        joint,
        "joint",
        {"name": further, "type": kind, **told, "limited": "false", "stiffness": f"{stiff:.9g}",
         "frictionloss": "0", "damping": f"{PLAY_DAMPING * stiff:.6g}", "ref": "0", "springref": "0"},
    )  # fmt: skip
    return f"{kind} {further} behind it, of {stiff:.4g} {per}"


def _in_body(element: Element) -> bool:
    """A joint of the tree, not one of the defaults, of an equality or of a sensor."""
    parent = element.parent
    return parent is not None and parent.tag in ("body", "worldbody", "frame")
