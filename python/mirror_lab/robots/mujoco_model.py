"""MuJoCo's model of a true body: any URDF or MJCF, with servos on its joints and hidden effects built in.

Errors of a servo's command (offset, gear, eccentricity, coupling, drift) are `ServoError`s; elastic parts
(play, springs, friction, bending) become joints that the dynamics moves; displaced parts move a frame.
Names and parameters are those of docs/effects.md.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np
import numpy.typing as npt

from mirror_posture._core import MirrorPostureError

from .hidden import DEFAULT_FRICTION_NM, HiddenEffect, tilted_axis

Floats = npt.NDArray[np.float64]
ServoError = Callable[[Mapping[str, float], float], float]
"""Error of a joint's command as a function of all commands (rad, m) and the time (s)."""

TIMESTEP_S = 0.001
SERVO_RATE_PER_S = 100.0
"""Natural frequency of a servo against its own reflected inertia: 16 Hz, as small servos have."""
LEAST_STIFFNESS_NM_PER_RAD = 0.5
# MuJoCo's soft limits and friction, made stiff: the defaults let a play overshoot and friction creep.
STIFF_LIMIT = ([0.002, 1.0], [0.999, 0.9999, 0.0001, 0.5, 2.0])
STIFF_FRICTION = ([0.002, 1.0], [0.9999, 0.9999, 0.001, 0.5, 2.0])
PART_ARMATURE_KGM2 = 1e-4
"""Reflected inertia between a motor and an elastic part: with less, a play beside a spring never settles."""
PLAY_DAMPING_PER_S = 30.0
STICTION_DROOP_SHARE = 0.15
"""Droop of a sticking servo at its largest load, over its dead band."""


@dataclass(frozen=True)
class ServoOptions:
    """How strong the servos are. A model's own position servos are kept as they are, but for those that are to stick (`stiction`)."""

    droop_rad: float = 0.0005
    """The servo's error at the largest load of gravity: proportional gain, no integral."""
    friction_nm: float = 0.0
    """Dry friction in each joint."""


@dataclass
class TrueModel:
    """A compiled model with the indices of its joints and links."""

    model: mujoco.MjModel
    actuator: dict[str, int]
    """By joint: the index of its servo."""
    qpos: dict[str, int]
    """By joint: where its own coordinate is."""
    servo_errors: dict[str, list[ServoError]] = field(default_factory=dict)


def read_spec(file: Path) -> mujoco.MjSpec:
    """A URDF (its primitive shapes; meshes and collisions are left out) or an MJCF. Raises `MirrorPostureError`."""
    try:
        text = file.read_text(encoding="utf-8-sig")
        root = ET.fromstring(text)
        if root.tag != "robot":
            return mujoco.MjSpec.from_file(str(file))
        for tag in ("mujoco", "transmission", "gazebo"):
            for element in root.findall(tag):
                root.remove(element)
        for link in root.findall("link"):
            meshes = [v for v in link.findall("visual") if v.find("geometry/mesh") is not None]
            for element in link.findall("collision") + meshes:
                link.remove(element)
        settings = ET.SubElement(root, "mujoco")
        ET.SubElement(settings, "compiler", discardvisual="false", fusestatic="false", balanceinertia="true")
        return mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"))
    except (OSError, UnicodeDecodeError, ET.ParseError, ValueError) as error:
        raise MirrorPostureError(f"{file}: MuJoCo cannot read it: {' '.join(str(error).split())}") from None


def build(
    spec: mujoco.MjSpec,
    joints: Sequence[str],
    root: str,
    gravity_in_root: Floats,
    hidden: Sequence[HiddenEffect],
    servo: ServoOptions,
) -> TrueModel:
    """The true body of a spec, which is changed.

    Raises `MirrorPostureError` for a joint or link that the model does not have and for an effect that no body can hide.
    """
    for free in [j for j in spec.joints if j.type == mujoco.mjtJoint.mjJNT_FREE]:
        spec.delete(free)  # the session's root stands still
    missing = [joint for joint in joints if spec.joint(joint) is None]
    if missing:
        raise MirrorPostureError(
            f"the MuJoCo model has no joint {missing[0]!r} of the nominal URDF; its joints: {', '.join(j.name for j in spec.joints)}"
        )
    _settings(spec)
    loads = _largest_loads(spec, joints, float(np.linalg.norm(gravity_in_root)))
    stiffness = {joint: max(LEAST_STIFFNESS_NM_PER_RAD, loads[joint] / servo.droop_rad) for joint in joints}
    hiding = _Hiding(spec, loads, stiffness, dict.fromkeys(joints, servo.friction_nm))
    for number, one in enumerate(hidden):
        try:
            hiding.hide(number, one)
        except KeyError as parameter:
            raise MirrorPostureError(
                f"{one.effect} at {one.at}: the parameter {parameter} is missing"
            ) from None
    _add_servos(spec, joints, stiffness, hiding.friction, hiding.sticking)
    model = _compiled(spec)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    _, rotation = frame_of(model, data, root)
    model.opt.gravity = rotation @ gravity_in_root
    _damp(model, data)
    of_joint = {int(model.actuator_trnid[a, 0]): a for a in range(model.nu)}
    return TrueModel(
        model,
        {joint: of_joint[model.joint(joint).id] for joint in joints},
        {joint: int(model.joint(joint).qposadr[0]) for joint in joints},
        hiding.errors,
    )


def frame_of(model: mujoco.MjModel, data: mujoco.MjData, link: str) -> tuple[Floats, Floats]:
    """Origin (3,) and rotation (3, 3) of a link in the world: of the body, else of the site of that name.

    Raises `MirrorPostureError` that lists the names.
    """
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, link)
    if body >= 0:
        return data.xpos[body].copy(), data.xmat[body].reshape(3, 3).copy()
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, link)
    if site >= 0:
        return data.site_xpos[site].copy(), data.site_xmat[site].reshape(3, 3).copy()
    names = ", ".join(model.body(i).name for i in range(1, model.nbody))
    raise MirrorPostureError(f"the MuJoCo model has no body or site {link!r}; its bodies: {names}")


def _compiled(spec: mujoco.MjSpec) -> mujoco.MjModel:
    try:
        return spec.compile()
    except ValueError as error:
        raise MirrorPostureError(f"MuJoCo refuses the model: {' '.join(str(error).split())}") from None


def _settings(spec: mujoco.MjSpec) -> None:
    spec.option.timestep = TIMESTEP_S
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.noslip_iterations = 8
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    spec.compiler.boundmass, spec.compiler.boundinertia = 1e-7, 1e-10


def _holds_positions(actuator: mujoco.MjsActuator) -> bool:
    """Whether an actuator of the model is a position servo: force = k (ctrl − q) and no more than damping."""
    gain, bias = float(actuator.gainprm[0]), float(actuator.biasprm[1])
    return actuator.biastype == mujoco.mjtBias.mjBIAS_AFFINE and gain > 0.0 and abs(gain + bias) < 1e-9 * gain


def _add_servos(
    spec: mujoco.MjSpec,
    joints: Sequence[str],
    stiffness: Mapping[str, float],
    friction: Mapping[str, float],
    sticking: Collection[str],
) -> None:
    own = {a.target for a in spec.actuators if _holds_positions(a)}.difference(sticking)
    for actuator in [a for a in spec.actuators if a.target in joints and a.target not in own]:
        spec.delete(actuator)
    for joint in joints:
        if joint in own:
            continue
        element = spec.joint(joint)
        inertia = stiffness[joint] / SERVO_RATE_PER_S**2
        element.armature = max(float(element.armature), inertia)
        element.frictionloss = max(float(element.frictionloss), friction[joint])
        element.solref_friction, element.solimp_friction = STIFF_FRICTION
        # Commands are checked before; a joint with an offset must not run into its stop.
        element.limited = mujoco.mjtLimited.mjLIMITED_FALSE
        # A servo that holds a load to a thousandth of a radian needs more effort than the file states.
        element.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
        added = spec.add_actuator(name=f"servo:{joint}", target=joint)
        added.trntype = mujoco.mjtTrn.mjTRN_JOINT
        added.set_to_position(kp=stiffness[joint], kv=2.0 * stiffness[joint] / SERVO_RATE_PER_S)


def _largest_loads(spec: mujoco.MjSpec, joints: Sequence[str], gravity: float) -> dict[str, float]:
    """By joint, N m (N): the torque of gravity with all that it carries held out level."""
    model = _compiled(spec)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    loads = {}
    for joint in joints:
        j = model.joint(joint).id
        carried = [b for b in range(model.nbody) if _hangs_on(model, b, int(model.jnt_bodyid[j]))]
        if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE:
            loads[joint] = gravity * float(model.body_mass[carried].sum())
        else:
            arms = np.linalg.norm(data.xipos[carried] - data.xanchor[j], axis=1)
            loads[joint] = gravity * float(model.body_mass[carried] @ arms)
    return loads


def _hangs_on(model: mujoco.MjModel, body: int, above: int) -> bool:
    while body > 0:
        if body == above:
            return True
        body = int(model.body_parentid[body])
    return False


@dataclass
class _Hiding:
    """Builds effects into a spec; `stiffness` and `friction` of the servos are changed where an effect is one of theirs."""

    spec: mujoco.MjSpec
    loads: Mapping[str, float]
    stiffness: dict[str, float]
    friction: dict[str, float]
    errors: dict[str, list[ServoError]] = field(default_factory=dict)
    sticking: set[str] = field(default_factory=set)
    """Joints whose servo is another one than the model's own."""

    def hide(self, number: int, one: HiddenEffect) -> None:
        kind, _, place = one.at.partition(":")
        done = False
        if kind == "joint":
            done = self._at_joint(number, one, *place.partition("<-joint:")[::2])
        elif kind in ("link", "marker", "camera"):
            link = {"link": place, "marker": f"{place}_marker", "camera": place or "camera_optical"}[kind]
            body = self.spec.body(link)
            if body is None:
                names = ", ".join(b.name for b in self.spec.bodies[1:])
                raise MirrorPostureError(
                    f"{one.effect} at {one.at}: the MuJoCo model has no body {link!r}; it has {names}"
                )
            done = _at_body(body, number, one)
        if not done:
            raise MirrorPostureError(
                f"a MuJoCo body cannot hide {one.effect!r} at {one.at!r}; see mirror_lab.robots.hidden.EFFECTS"
            )

    def _at_joint(self, number: int, one: HiddenEffect, joint: str, other: str) -> bool:
        p = one.parameters
        for name in (joint, other) if other else (joint,):
            if name not in self.stiffness:
                raise MirrorPostureError(
                    f"{one.effect} at {one.at}: there is no joint {name!r} to command; there are {', '.join(self.stiffness)}"
                )
        error = _servo_error(one.effect, joint, other, p)
        element = self.spec.joint(joint)
        if error is not None:
            self.errors.setdefault(joint, []).append(error)
        elif one.effect == "axis_tilt":
            axis = np.asarray(element.axis, dtype=float)
            element.axis = tilted_axis(axis / np.linalg.norm(axis), p["tilt_1_rad"], p["tilt_2_rad"])
            for part in element.parent.joints:
                if part.name.startswith(f"{joint}:"):
                    part.axis = element.axis
        elif one.effect == "backlash":
            half = 0.5 * p["width_rad"]
            part = _part(element, f"{joint}:play{number}")
            part.limited, part.range = mujoco.mjtLimited.mjLIMITED_TRUE, [-half, half]
            part.solref_limit, part.solimp_limit = STIFF_LIMIT
            # Friction acts between the output and the frame, not between the output and the motor.
            bearing = self.spec.add_tendon(name=part.name)
            bearing.wrap_joint(joint, 1.0)
            bearing.wrap_joint(part.name, 1.0)
            bearing.frictionloss = p.get("friction_nm", DEFAULT_FRICTION_NM)
            bearing.solref_friction, bearing.solimp_friction = STIFF_FRICTION
        elif one.effect == "joint_compliance":
            part = _part(element, f"{joint}:spring{number}")
            _set_stiffness(part, 1.0 / p["compliance_rad_per_nm"])
        elif one.effect == "stiction":
            soft = max(self.loads[joint], 1e-3) / (STICTION_DROOP_SHARE * p["deadband_rad"])
            self.stiffness[joint], self.friction[joint] = soft, soft * p["deadband_rad"]
            self.sticking.add(joint)
        else:
            return False
        return True


def _at_body(body: mujoco.MjsBody, number: int, one: HiddenEffect) -> bool:
    p, kind = one.parameters, one.at.partition(":")[0]
    if one.effect == "link_bending" and kind == "link":
        _bend(body, number, 1.0 / p["compliance_rad_per_nm"])
    elif one.effect == "link_length" and kind == "link":
        # Beyond a fixed child, that child leads to the joint.
        leading = [child for child in body.bodies if any(True for _ in _next_joints(child))]
        if not leading:
            raise MirrorPostureError(f"link_length at {one.at}: this link carries no joint")
        for child in leading:
            child.pos = np.asarray(child.pos) + _shift(p)
    elif one.effect == "marker_mount" and kind == "marker":
        body.pos = np.asarray(body.pos) + _shift(p)
    elif one.effect == "camera_mount":
        vector = np.array([p["rx_rad"], p["ry_rad"], p["rz_rad"]])
        angle = float(np.linalg.norm(vector))
        turn, own, shift, both = np.zeros(4), np.asarray(body.quat, dtype=float), np.zeros(3), np.zeros(4)
        mujoco.mju_axisAngle2Quat(turn, vector / angle if angle > 0.0 else np.array([1.0, 0.0, 0.0]), angle)
        mujoco.mju_rotVecQuat(shift, _shift(p), own)
        mujoco.mju_mulQuat(both, own, turn)
        body.pos, body.quat = np.asarray(body.pos) + shift, both
    else:
        return False
    return True


def _servo_error(effect: str, joint: str, other: str, p: Mapping[str, float]) -> ServoError | None:
    if effect == "joint_offset":
        offset = p["offset_rad"]
        return lambda q, t: offset
    if effect == "gear_ratio":
        scale = p["scale_error"]
        return lambda q, t: scale * q[joint]
    if effect == "gear_eccentricity":
        s, c = p["sin_rad"], p["cos_rad"]
        return lambda q, t: float(s * np.sin(q[joint]) + c * np.cos(q[joint]) - c)
    if effect == "joint_coupling":
        coupling = p["coupling"]
        return lambda q, t: coupling * q[other]
    if effect == "drift":
        rate = p["rate_rad_per_s"]
        return lambda q, t: rate * t
    return None


def _part(element: mujoco.MjsJoint, name: str) -> mujoco.MjsJoint:
    """A second joint in series with a joint, about the same axis."""
    part = element.parent.add_joint(name=name, type=element.type, axis=element.axis, pos=element.pos)
    part.armature = PART_ARMATURE_KGM2
    part.limited = mujoco.mjtLimited.mjLIMITED_FALSE
    return part


def _set_stiffness(part: mujoco.MjsJoint, stiffness: float) -> None:
    # A polynomial of the deflection in newer releases, a number in older ones.
    try:
        part.stiffness = [stiffness, 0.0, 0.0]
    except (TypeError, ValueError):
        part.stiffness = stiffness


def _bend(body: mujoco.MjsBody, number: int, stiffness: float) -> None:
    """Two elastic hinges across a link at its middle, equivalent to a uniform beam's bending."""
    ends = [at for child in body.bodies for at in _next_joints(child)]
    ends = ends or [np.asarray(child.pos) for child in body.bodies]
    tip = np.mean(ends, axis=0) if ends else 2.0 * np.asarray(body.ipos)
    length = float(np.linalg.norm(tip))
    if length < 1e-6:
        raise MirrorPostureError(f"link_bending at link:{body.name}: this link has no length")
    along = tip / length
    first = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
    first /= np.linalg.norm(first)
    for k, axis in enumerate((first, np.cross(along, first))):
        name = f"{body.name}:bend{number}{'ab'[k]}"
        part = body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis, pos=0.5 * tip)
        part.limited = mujoco.mjtLimited.mjLIMITED_FALSE
        part.armature = PART_ARMATURE_KGM2
        _set_stiffness(part, stiffness)


def _next_joints(body: mujoco.MjsBody) -> Iterator[Floats]:
    """The origins of the next bodies with a joint in a branch that begins with a body, in the frame of its parent."""
    at = np.asarray(body.pos, dtype=float)
    if body.joints:
        yield at
        return
    for child in body.bodies:
        for beyond in _next_joints(child):
            turned = np.zeros(3)
            mujoco.mju_rotVecQuat(turned, beyond, np.asarray(body.quat, dtype=float))
            yield at + turned


def _damp(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Critical damping of each added part, from its inertia at rest: motions die out, the resting place is the same."""
    mujoco.mj_forward(model, data)
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    for j in range(model.njnt):
        name = model.joint(j).name
        kind = name.rpartition(":")[2] if ":" in name else ""
        k = int(model.jnt_dofadr[j])
        if kind.startswith("play"):
            model.tendon_damping[model.tendon(name).id] = PLAY_DAMPING_PER_S * inertia[k, k]
        elif kind.startswith(("spring", "bend")):
            spring = float(np.ravel(model.jnt_stiffness[j])[0])
            model.dof_damping[k] = 2.0 * np.sqrt(spring * inertia[k, k])


def _shift(p: Mapping[str, float]) -> Floats:
    return np.array([p["dx_m"], p["dy_m"], p["dz_m"]])
