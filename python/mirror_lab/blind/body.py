"""The true body: MuJoCo moves the robot from posture to posture and lets it settle.

Joints without a fault are driven: their armature is so large that no load moves them. A faulty one is free:
play is a pair of
stiff limits that travel with the servo, friction acts between the joint's two sides, springs pull towards
the servo.
Elastic links are further hinges with springs. The root link stands still; gravity is the session's, in its
frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from .errors import BlindError, UnstableError
from .robots import Robot
from .truth import Commands, Truth

Array = NDArray[np.float64]

TIMESTEP_S = 0.001
MOVE_STEPS = 500
"""Half a second from posture to posture: slow compared with every spring here."""
SETTLE_CHUNK_STEPS = 100
SETTLE_MOST_CHUNKS = 60
SETTLED_RAD_PER_S = 2e-5
"""Below this speed a free joint counts as at rest: in 1 s it moves 0.02 mrad."""
DRIVEN_ARMATURE = 1e6
"""kg m²: 10 N m move such a joint by 1e-5 rad/s²."""
PLAY_DAMPING_PER_S = 30.0


@dataclass
class BodyPoses:
    """Where things are, in the root's frame, for each posture; and the resting joint positions."""

    marker_m: Array
    """(P, M, 3)."""
    camera_m: Array
    camera_rotation: Array
    board_m: Array
    board_rotation: Array
    theta_rad: Array
    """(P, J) over the commanded joints."""
    unsettled: int
    """Postures that still moved when the longest wait was over."""


def _vector(v: Array) -> str:
    return " ".join(f"{x:.12g}" for x in v)


def _quaternion(rotation: Array) -> str:
    q = np.zeros(4)
    mujoco.mju_mat2Quat(q, np.ascontiguousarray(rotation).reshape(9))
    return _vector(q)


def build_xml(robot: Robot, truth: Truth, gravity: Array) -> str:
    """The robot with the truth's changes as MJCF; each link is a body `L:name`, each hinge has its joint's
    name."""
    loose = {item.joint: item for item in truth.loose}
    children: dict[int, list[int]] = {}
    for i, b in enumerate(robot.bodies):
        children.setdefault(b.parent, []).append(i)

    def body(i: int) -> str:
        b = robot.bodies[i]
        at = b.xyz_m + truth.origin_shift_m.get(i, np.zeros(3))
        out = f'<body name="L:{b.name}" pos="{_vector(at)}" quat="{_quaternion(b.rotation)}">'
        if b.parent >= 0 and b.joint in robot.commanded:
            axis = truth.axis.get(i, b.axis)
            item = loose.get(b.joint)
            if item is None:
                out += (
                    f'<joint name="{b.joint}" type="{b.joint_type}" axis="{_vector(axis)}" '
                    f'armature="{DRIVEN_ARMATURE:g}"/>'
                )
            else:
                limits = 'limited="true" range="-0.01 0.01"' if item.play_rad > 0 else 'limited="false"'
                out += (
                    f'<joint name="{b.joint}" type="{b.joint_type}" axis="{_vector(axis)}" {limits} '
                    f'stiffness="{item.stiffness:.12g}" frictionloss="{item.friction_nm:.12g}"/>'
                )
        for k, bend in enumerate(truth.bends):
            if bend.body == i:
                out += (
                    f'<joint name="bend{k}" type="hinge" axis="{_vector(bend.axis)}" '
                    f'pos="{_vector(bend.pivot_m)}" stiffness="{bend.stiffness:.12g}"/>'
                )
        mass = max(b.mass_kg, 1e-6)
        inertia = b.inertia if b.mass_kg > 0 else np.eye(3) * 1e-10
        inertia = inertia + np.eye(3) * 1e-9
        full = (inertia[0, 0], inertia[1, 1], inertia[2, 2], inertia[0, 1], inertia[0, 2], inertia[1, 2])
        out += (
            f'<inertial pos="{_vector(b.com_m)}" mass="{mass:.9g}" fullinertia="{_vector(np.array(full))}"/>'
        )
        return out + "".join(body(c) for c in children.get(i, [])) + "</body>"

    return (
        '<mujoco><compiler angle="radian" balanceinertia="true" boundmass="1e-7" '
        'boundinertia="1e-10" autolimits="false"/>'
        f'<option timestep="{TIMESTEP_S}" gravity="{_vector(gravity)}" integrator="implicitfast" '
        'noslip_iterations="8" '
        'iterations="50"><flag contact="disable"/></option>'
        '<default><joint solreflimit="0.002 1" solimplimit="0.999 0.9999 0.0001" solreffriction="0.002 1" '
        'solimpfriction="0.9999 0.9999 0.001"/></default>'
        f"<worldbody>{body(0)}</worldbody></mujoco>"
    )


class Body:
    """A MuJoCo model of the true robot that is moved through postures."""

    def __init__(self, robot: Robot, truth: Truth, gravity: Array) -> None:
        self.robot, self.truth = robot, truth
        try:
            self.model = mujoco.MjModel.from_xml_string(build_xml(robot, truth, gravity))
        except ValueError as e:
            raise BlindError(f"MuJoCo refuses the robot {robot.kind!r}: {e}") from e
        self.data = mujoco.MjData(self.model)
        self.address = {j: int(self.model.joint(j).qposadr[0]) for j in robot.commanded}
        self._set_damping()

    def _set_damping(self) -> None:
        """Critical damping of each free joint, from its inertia at rest: motions die out, the resting place
        is the same."""
        m, d = self.model, self.data
        mujoco.mj_forward(m, d)
        inertia = np.zeros((m.nv, m.nv))
        mujoco.mj_fullM(m, d, inertia)
        for k in range(m.nv):
            if m.dof_armature[k] > 0:
                continue
            own = inertia[k, k]
            m.dof_damping[k] = max(2.0 * np.sqrt(m.jnt_stiffness[k] * own), PLAY_DAMPING_PER_S * own)

    def gravity_torque(self, q: Array, joints: list[str]) -> Array:
        """Gravity's load on the joints, (P, J) N m, at the driven positions `q` (P, all commanded)."""
        m, d = self.model, self.data
        out = np.zeros((len(q), len(joints)))
        at = [self.address[j] for j in self.robot.commanded]
        dofs = [int(m.joint(j).dofadr[0]) for j in joints]
        d.qvel[:] = 0
        for p, row in enumerate(q):
            d.qpos[:] = 0
            d.qpos[at] = row
            mujoco.mj_forward(m, d)
            out[p] = -d.qfrc_bias[dofs]
        return out

    def run(self, commands: Commands) -> BodyPoses:
        """Moves the robot through the postures in order, from rest at 0; returns the poses after each has settled."""
        robot, truth, m, d = self.robot, self.truth, self.model, self.data
        target = np.stack(
            [commands.of(j) + truth.servo_error(j, commands) for j in robot.commanded], axis=1
        )  # fmt: skip
        loose = {item.joint: item for item in truth.loose}
        driven = [j for j in robot.commanded if j not in loose]
        column = {j: k for k, j in enumerate(robot.commanded)}
        driven_qpos = np.array([self.address[j] for j in driven], dtype=int)
        driven_columns = np.array([column[j] for j in driven], dtype=int)
        free = [(int(m.joint(j).id), column[j], loose[j], 0.0) for j in loose]
        dynamic = bool(free) or bool(truth.bends)
        poses = _empty(len(target), robot)
        mujoco.mj_resetData(m, d)
        start = np.zeros(len(robot.commanded))
        if dynamic:
            m.opt.timestep = TIMESTEP_S
        blend = np.linspace(0, 1, MOVE_STEPS + 1)[1:]
        blend = blend**3 * (10 - 15 * blend + 6 * blend**2)
        widest = {item.joint: 1e-9 for item in truth.loose}
        for p, goal in enumerate(target):
            if dynamic:
                for share in blend:
                    self._step(start + share * (goal - start), driven_qpos, driven_columns, free, widest)
                poses.unsettled += not self._settle(goal, driven_qpos, driven_columns, free, widest)
            else:
                d.qpos[driven_qpos] = goal[driven_columns]
                mujoco.mj_kinematics(m, d)
            start = goal
            self._read(poses, p)
        return poses

    def _step(
        self,
        at: Array,
        qpos: NDArray[np.int_],
        columns: NDArray[np.int_],
        free: list[Any],
        widest: dict[Any, Any],
    ) -> None:
        m, d = self.model, self.data
        d.qpos[qpos] = at[columns]
        d.qvel[qpos] = 0.0
        for joint, column, item, _ in free:
            angle = at[column]
            m.qpos_spring[joint] = angle
            if item.play_rad > 0:
                load = abs(d.qfrc_bias[joint])
                widest[item.joint] = max(widest[item.joint], load)
                half = 0.5 * item.play_rad * (1 + item.play_load_share * load / widest[item.joint])
                m.jnt_range[joint] = (angle - half, angle + half)
            if item.stiffening:
                away = d.qpos[joint] - angle
                d.qfrc_applied[joint] = -item.stiffness * item.stiffening * away**3 / item.reference_rad**2
        mujoco.mj_step(m, d)

    def _settle(
        self,
        at: Array,
        qpos: NDArray[np.int_],
        columns: NDArray[np.int_],
        free: list[Any],
        widest: dict[Any, Any],
    ) -> bool:
        moving = np.setdiff1d(np.arange(self.model.nv), qpos)
        for _ in range(SETTLE_MOST_CHUNKS):
            before = self.data.qpos[moving].copy()
            for _ in range(SETTLE_CHUNK_STEPS):
                self._step(at, qpos, columns, free, widest)
            rate = np.abs(self.data.qpos[moving] - before).max() / (SETTLE_CHUNK_STEPS * TIMESTEP_S)
            if not np.isfinite(rate):
                raise UnstableError("the simulated body became unstable")
            if rate < SETTLED_RAD_PER_S:
                return True
        return False

    def _read(self, poses: BodyPoses, p: int) -> None:
        robot, m, d = self.robot, self.model, self.data
        mujoco.mj_kinematics(m, d)
        swing = {s.marker: s.reach_m for s in self.truth.swings}
        down = m.opt.gravity / np.linalg.norm(m.opt.gravity)
        for k, name in enumerate(robot.markers):
            poses.marker_m[p, k] = d.body(f"L:{name}_marker").xpos + swing.get(name, 0.0) * down
        camera, board = d.body(f"L:{robot.camera_link}"), d.body(f"L:{robot.board_link}")
        poses.camera_m[p], poses.camera_rotation[p] = camera.xpos, camera.xmat.reshape(3, 3)
        poses.board_m[p], poses.board_rotation[p] = board.xpos, board.xmat.reshape(3, 3)
        poses.theta_rad[p] = [d.qpos[self.address[j]] for j in robot.commanded]


def _empty(postures: int, robot: Robot) -> BodyPoses:
    n = postures
    return BodyPoses(
        np.zeros((n, len(robot.markers), 3)),
        np.zeros((n, 3)),
        np.zeros((n, 3, 3)),
        np.zeros((n, 3)),
        np.zeros((n, 3, 3)),
        np.zeros((n, len(robot.commanded))),
        0,
    )
