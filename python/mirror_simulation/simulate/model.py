"""The session's robot as a MuJoCo model: a URDF, or the user's own MJCF with everything in it, on position
servos.

Frames that the session needs and the model lacks (camera, board, markers) are added as sites, placed by the
session's URDF. The nominal model is an ideal positioner: its servos are so stiff that gravity deflects them
by `DROOP_RAD` at most. Position servos of the user's MJCF are kept: they are part of that simulator.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from mirror_posture import MirrorPostureError
from mirror_posture.arrays import Floats
from mirror_posture.input_files import LARGEST_MODEL, read_text
from mirror_posture.session import Session
from mirror_posture.short_repr import ShortRepr

from .poses import flatten

TIMESTEP_S = 0.001
DROOP_RAD = 2e-5
"""Droop of a servo under the largest torque that gravity puts on it: a hundredth of a small cause."""
LEAST_STIFFNESS_NM_PER_RAD = 1.0
SERVO_RATE_PER_S = 80.0
"""Natural frequency that the armature gives a servo; the statics do not depend on it."""
LEAST_MASS_KG, LEAST_INERTIA_KGM2 = 1e-6, 1e-9
STIFF_FRICTION = ([0.002, 1.0], [0.9999, 0.9999, 0.001, 0.5, 2.0])
"""MuJoCo's soft friction (and the equality of joints that follow another one) made hard: its defaults creep, and lose all hysteresis."""
FRAMES_DIFFER_M = 1e-3
"""A model whose frames lie farther from the URDF's than this is not the robot that the session describes."""


@dataclass(eq=False, repr=False)
class Simulator(ShortRepr):
    """A MuJoCo specification with what tells its parts apart. `stiffness` is by joint, N m/rad (N/m)."""

    spec: Any
    joints: tuple[str, ...]
    stiffness: dict[str, float]
    gravity_in_root_m_per_s2: Floats
    root_link: str
    notes: list[str] = field(default_factory=list)
    kept: frozenset[str] = frozenset()
    """The joints whose position servos are the model's own."""
    servos: dict[str, str] = field(default_factory=dict)
    """By joint the name of the one actuator that gets its command."""
    stands_for: dict[str, str] = field(default_factory=dict)
    """By link the site that is in its place, if there is one."""

    def unit_of(self, joint: Any) -> float:
        """What a joint's position in rad (m) must be multiplied by to be written into the specification: MuJoCo converts angles only."""
        turns = joint.type != mujoco.mjtJoint.mjJNT_SLIDE
        return float(np.degrees(1.0)) if turns and self.spec.compiler.degree else 1.0

    def servo(self, joint: str) -> Any:
        """The actuator of the specification that gets a joint's command. Raises `MirrorPostureError` where there is none."""
        if joint not in self.servos:
            raise MirrorPostureError(
                f"the model's joint {joint!r} has no servo: no command of the session moves it"
            )
        return self.spec.actuator(self.servos[joint])

    def compiled(self) -> mujoco.MjModel:
        """The compiled model, gravity turned into the world's frame. Raises `MirrorPostureError` where MuJoCo refuses it."""
        model = _compiled(self.spec)
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        model.opt.gravity[:] = frame_of(model, data, self.root_link)[:3, :3] @ self.gravity_in_root_m_per_s2
        return model


def build(session: Session, model_file: Path | None = None) -> Simulator:
    """The nominal simulator of a session: from its URDF, or from the user's own model.

    Raises:
        MirrorPostureError: a file that MuJoCo cannot load; a joint of the session that the model does not have; a link
            that neither the model nor the session's URDF can place.
    """
    spec = _read(model_file or session.robot_file)
    notes: list[str] = []
    # A keyframe has the sizes of the model as it was, and would be of no use.
    for key in list(spec.keys):
        spec.delete(key)
    for free in [joint for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_FREE]:
        spec.delete(free)
        notes.append("the free joint of the root is removed: the session's root stands still")
    joints = tuple(session.robot.position_names)
    missing = [name for name in session.frames.joint_names if name in joints and spec.joint(name) is None]
    if missing:
        names = ", ".join(joint.name for joint in spec.joints)
        raise MirrorPostureError(
            f"{model_file}: has no joint {missing[0]!r} of the session; its joints: {names}"
        )
    joints = tuple(name for name in joints if spec.joint(name) is not None)
    spec.compiler.boundmass, spec.compiler.boundinertia = LEAST_MASS_KG, LEAST_INERTIA_KGM2
    spec.option.timestep = TIMESTEP_S
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.noslip_iterations = 8
    # Limbs that touch would push each other: the session's postures were taken free in the air.
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    flatten(spec, _compiled(spec))
    for link in needed_links(session):
        _ensure_frame(spec, session, link)
    stiffness = _servo_stiffness(spec, joints, float(np.linalg.norm(session.gravity_m_per_s2)))
    servos, kept, removed = _add_servos(spec, joints, stiffness)
    if kept:
        notes.append(f"position servos of the model are kept: {', '.join(sorted(kept))}")
    if removed:
        notes.append(f"joints with several position servos keep the first: {', '.join(removed)}")
    simulator = Simulator(
        spec,
        joints,
        stiffness,
        np.asarray(session.gravity_m_per_s2, float),
        session.root_link,
        notes,
        frozenset(kept),
        servos,
    )
    if model_file is not None:
        _check_frames(simulator, session, model_file)
    return simulator


def needed_links(session: Session) -> tuple[str, ...]:
    """The links whose frames the session needs: root, camera, board, markers."""
    links = [session.root_link]
    if session.camera_link:
        links.append(session.camera_link)
    if session.board is not None:
        links.append(session.board.link)
    return tuple(dict.fromkeys([*links, *(marker.link for marker in session.markers)]))


def frame_of(model: mujoco.MjModel, data: mujoco.MjData, link: str) -> Floats:
    """Pose (4, 4) `world_from_link` of a body, else of the site of that name."""
    pose = np.eye(4)
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, link)
    if body >= 0:
        pose[:3, :3], pose[:3, 3] = data.xmat[body].reshape(3, 3), data.xpos[body]
        return pose
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, link)
    pose[:3, :3], pose[:3, 3] = data.site_xmat[site].reshape(3, 3), data.site_xpos[site]
    return pose


def element_of(spec: Any, link: str) -> Any:
    """The body of a link, else the site of that name; None where there is neither."""
    return spec.body(link) or spec.site(link)


def _read(file: Path) -> Any:
    """The specification of a model file, MJCF or URDF."""
    if not file.is_file():
        raise MirrorPostureError(f"{file}: there is no such file; needed an MJCF or a URDF")
    try:
        text = read_text(file, LARGEST_MODEL)
        root = ET.fromstring(text)
        if root.tag != "robot":
            spec = mujoco.MjSpec.from_file(str(file))
            # The patched model is written into another folder, and its meshes and textures stay here.
            folder = file.resolve().parent
            spec.meshdir, spec.texturedir = str(folder / spec.meshdir), str(folder / spec.texturedir)
            # Links that no joint moves are needed by name.
            spec.compiler.fusestatic = False
            return spec
        for tag in ("mujoco", "transmission", "gazebo"):
            for element in root.findall(tag):
                root.remove(element)
        for link in root.findall("link"):
            # Mesh files may be elsewhere, and shapes do not matter for statics.
            for tag in ("visual", "collision"):
                for element in link.findall(tag):
                    link.remove(element)
        settings = ET.SubElement(root, "mujoco")
        ET.SubElement(settings, "compiler", fusestatic="false", balanceinertia="true")
        spec = mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"))
        for equality in spec.equalities:
            # Joints that follow another one (`<mimic>`).
            equality.solref, equality.solimp = STIFF_FRICTION
        return spec
    except (OSError, UnicodeDecodeError, ET.ParseError, ValueError) as error:
        raise MirrorPostureError(f"{file}: MuJoCo cannot load it: {' '.join(str(error).split())}") from None


def _compiled(spec: Any) -> mujoco.MjModel:
    try:
        return spec.compile()
    except ValueError as error:
        raise MirrorPostureError(f"MuJoCo refuses the model: {' '.join(str(error).split())}") from None


def _ensure_frame(spec: Any, session: Session, link: str) -> None:
    """Adds a site for a link that the model lacks, where the URDF has it on the nearest body that the model has."""
    if element_of(spec, link) is not None:
        return
    robot = session.robot
    body_from_link = np.eye(4)
    index = robot.link_index(link)
    while True:
        joint = robot.links[index].parent_joint
        if joint is None:
            # The URDF's root is the world of an MJCF whose first body is not named after it.
            spec.worldbody.add_site(name=link, pos=body_from_link[:3, 3], quat=_quaternion(body_from_link))
            return
        joint_of = robot.joints[joint]
        if joint_of.kind != "fixed":
            break
        body_from_link = joint_of.parent_from_joint @ body_from_link
        index = robot.link_index(joint_of.parent_link)
        body = spec.body(joint_of.parent_link)
        if body is not None:
            body.add_site(name=link, pos=body_from_link[:3, 3], quat=_quaternion(body_from_link))
            return
    names = ", ".join(body.name for body in spec.bodies[1:])
    raise MirrorPostureError(
        f"the model has neither {link!r} nor a body that the session's URDF fixes it to; its bodies: {names}; "
        f"add a site {link!r} to the model"
    )


def _quaternion(pose: Floats) -> Floats:
    out = np.zeros(4)
    mujoco.mju_mat2Quat(out, np.ascontiguousarray(pose[:3, :3]).ravel())
    return out


def _servo_stiffness(spec: Any, joints: tuple[str, ...], gravity_m_per_s2: float) -> dict[str, float]:
    """From the torque (force) on each joint with all that it carries held out level."""
    model = _compiled(spec)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    out = {}
    for name in joints:
        joint = model.joint(name).id
        body = model.jnt_bodyid[joint]
        weight = gravity_m_per_s2 * float(model.body_subtreemass[body])
        is_slide = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE
        arm = 1.0 if is_slide else float(np.linalg.norm(data.subtree_com[body] - data.xanchor[joint]))
        out[name] = max(LEAST_STIFFNESS_NM_PER_RAD, weight * arm / DROOP_RAD)
    return out


def _holds_positions(actuator: Any) -> bool:
    """Whether an actuator is a position servo: force = k (command − position), damping besides."""
    gain, bias = float(actuator.gainprm[0]), float(actuator.biasprm[1])
    affine = actuator.biastype == mujoco.mjtBias.mjBIAS_AFFINE
    # An integrated velocity has the same parameters, and its command is a speed.
    told_positions = actuator.dyntype != mujoco.mjtDyn.mjDYN_INTEGRATOR
    return bool(affine and told_positions and gain > 0.0 and abs(gain + bias) < 1e-9 * gain)


def _add_servos(
    spec: Any, joints: tuple[str, ...], stiffness: dict[str, float]
) -> tuple[dict[str, str], set[str], list[str]]:
    """One servo a joint, by name; the joints whose own servo is kept; those of which further ones are removed.

    Other actuators of a joint with a servo stay, and are told nothing.
    """
    servos: dict[str, str] = {}
    kept: set[str] = set()
    removed: list[str] = []
    # A tendon or site may have a joint's name.
    turning = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
    for name in joints:
        there = [a for a in spec.actuators if a.trntype in turning and a.target == name]
        own = [actuator for actuator in there if _holds_positions(actuator)]
        for actuator in own[1:] if own else there:
            spec.delete(actuator)
        if len(own) > 1:
            removed.append(name)
        taken = {actuator.name for actuator in spec.actuators}
        servos[name] = f"servo_{name}"
        while servos[name] in taken:
            servos[name] += "_"
        if own:
            kept.add(name)
            servos[name] = own[0].name = own[0].name or servos[name]
            continue
        joint = spec.joint(name)
        joint.armature = max(float(joint.armature), stiffness[name] / SERVO_RATE_PER_S**2)
        joint.frictionloss = 0.0
        # A zero that is off by a little must not run into the file's stop, nor its effort limit let the load win.
        joint.limited = joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
        servo = spec.add_actuator(name=servos[name], target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        servo.set_to_position(kp=stiffness[name], kv=2.0 * stiffness[name] / SERVO_RATE_PER_S)
    return servos, kept, removed


def _place_followers(model: mujoco.MjModel, data: mujoco.MjData, placed: set[int]) -> None:
    """Puts joints that an equality makes follow another one where they then are; `placed` are the joints that are already."""
    pairs = np.flatnonzero((model.eq_type == mujoco.mjtEq.mjEQ_JOINT) & (model.eq_active0 != 0))
    for _ in pairs:
        for pair in pairs:
            follower, leader = int(model.eq_obj1id[pair]), int(model.eq_obj2id[pair])
            if follower in placed or (leader >= 0 and leader not in placed):
                continue
            at = model.jnt_qposadr[follower]
            ahead = 0.0
            if leader >= 0:
                ahead = data.qpos[model.jnt_qposadr[leader]] - model.qpos0[model.jnt_qposadr[leader]]
            data.qpos[at] = model.qpos0[at] + np.polyval(model.eq_data[pair, 4::-1], ahead)
            placed.add(follower)


def _check_frames(simulator: Simulator, session: Session, file: Path | None) -> None:
    """Compares where the user's model and the session's URDF have camera, board and markers at the first posture."""
    model = simulator.compiled()
    data = mujoco.MjData(model)
    row = dict(zip(session.robot.position_names, session.positions[0], strict=True))
    for name in simulator.joints:
        data.qpos[model.joint(name).qposadr[0]] = row[name]
    _place_followers(model, data, {model.joint(name).id for name in simulator.joints})
    mujoco.mj_kinematics(model, data)
    links = needed_links(session)
    root = np.linalg.inv(frame_of(model, data, session.root_link))
    here = np.array([(root @ frame_of(model, data, link))[:3, 3] for link in links])
    there = session.robot.link_poses(session.positions[:1], links)[0]
    there = np.linalg.solve(there[0], there)[:, :3, 3]
    far = np.linalg.norm(here - there, axis=1)
    worst = int(far.argmax())
    if far[worst] > FRAMES_DIFFER_M:
        simulator.notes.append(
            f"{file}: at the first posture {links[worst]} lies {far[worst] * 1e3:.1f} mm from where the session's URDF has it: "
            "the two files describe different robots"
        )
