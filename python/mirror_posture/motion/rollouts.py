"""Motions of the simulated robot: the log's commands through the servos, many models at once (`mujoco.rollout`, all cores).

A joint with a position servo of the model's own keeps it. To any other an ideal servo is added, fast and with the speed fed
forward: it follows its command, and nothing can be told of its gains.
"""

from __future__ import annotations

import copy
import os
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt
from mujoco import rollout

from .._core import MirrorPostureError
from ..short_repr import ShortRepr
from ..simulate.model import STIFF_FRICTION, Simulator, build
from .effects import EFFECTS, LEVELS, Causes, JointScale, gains
from .recording import Recording

Floats = npt.NDArray[np.float64]

STEP_S = 0.002
SETTLE_S = 0.6
"""Of standing at the first command before the log begins."""
AFTER_S = 0.1
IDEAL_RATE_PER_S = 400.0
"""Natural frequency of an added servo: a hundred times that of a limb's motion."""
SUBSTEPS = 8
KEPT_IN_MEMORY = 48
AT_ONCE = 12
WILD_RAD = 1e3


@dataclass(eq=False, repr=False)
class Motion(ShortRepr):
    """Joint positions (T, joints) every `STEP_S` from the log's first row on."""

    start_s: float
    position: Floats
    velocity: Floats
    _load: dict[str, Floats] = field(default_factory=dict)

    def at(self, time_s: Floats) -> Floats:
        """Positions at times of any shape: (..., joints), straight between two steps."""
        return _between(self.position, (time_s - self.start_s) / STEP_S)

    def velocity_at(self, time_s: Floats) -> Floats:
        """Velocities at times of any shape: (..., joints)."""
        return _between(self.velocity, (time_s - self.start_s) / STEP_S)


def _between(table: Floats, place: Floats) -> Floats:
    place = np.clip(place, 0.0, len(table) - 1.000001)
    below = place.astype(np.int64)
    share = (place - below)[..., None]
    return np.asarray((1.0 - share) * table[below] + share * table[below + 1])


class Rollouts:
    """The simulator of a moving session: causes to motions, the last ones remembered."""

    def __init__(self, recording: Recording, model_file: Path | None, *, exact: bool = True) -> None:
        self.recording = recording
        self.simulator: Simulator = build(recording.session, model_file)
        self.joints = self.simulator.joints
        spec = self.simulator.spec
        for name in self.joints:
            if name not in self.simulator.kept:
                stiffness = self.simulator.stiffness[name]
                spec.joint(name).armature = stiffness / IDEAL_RATE_PER_S**2
                servo = next(a for a in spec.actuators if a.target == name)
                servo.set_to_position(kp=stiffness, kv=2.0 * stiffness / IDEAL_RATE_PER_S)
        spec.option.timestep = STEP_S
        spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        self.model = self.simulator.compiled()
        self.model.dof_solref[:], self.model.dof_solimp[:] = STIFF_FRICTION
        self.joint_id = np.array([self.model.joint(name).id for name in self.joints])
        self.dof = self.model.jnt_dofadr[self.joint_id]
        self.qpos = self.model.jnt_qposadr[self.joint_id]
        by_joint = {int(self.model.actuator_trnid[a, 0]): a for a in range(self.model.nu)}
        self.actuator = np.array([by_joint[int(j)] for j in self.joint_id])
        log = recording.states.time_s
        end = max(float(log[-1]), float(recording.marker_time_s.max())) + AFTER_S
        self.start_s = float(log[0])
        self.time_s: Floats = self.start_s + STEP_S * np.arange(
            int((end - self.start_s) / STEP_S) + 2, dtype=np.float64
        )
        self.commands = recording.commands(self.joints, self.time_s)
        self._known: OrderedDict[tuple[Any, ...], Motion] = OrderedDict()
        self._pool = rollout.Rollout(nthread=os.cpu_count() or 1)
        self._data = [mujoco.MjData(self.model) for _ in range(os.cpu_count() or 1)]
        self.count = 0
        """Motions simulated so far."""
        self._correction = (np.zeros(0), np.zeros(0))
        if exact:
            self.refine({})

    def scales(self, nominal: Motion) -> dict[str, JointScale]:
        """What is usual of each joint that the log moves."""
        out = {}
        for column, name in enumerate(self.joints):
            speed = float(np.abs(np.gradient(self.commands[:, column], STEP_S)).max())
            if speed < 1e-3:
                continue
            a = self.actuator[column]
            force = self._servo_torque(nominal, column)
            out[name] = JointScale(
                float(self.model.actuator_gainprm[a, 0]),
                float(-self.model.actuator_biasprm[a, 2] + self.model.dof_damping[self.dof[column]]),
                float(self.model.dof_armature[self.dof[column]]),
                float(self.model.dof_frictionloss[self.dof[column]]),
                float(np.quantile(np.abs(force), 0.999)),
                tuple(float(level) for level in np.quantile(np.abs(force), LEVELS)),
                float(np.quantile(np.abs(np.gradient(self.commands[:, column], STEP_S)), 0.999)),
                name in self.simulator.kept,
            )
        return out

    def _servo_torque(self, motion: Motion, column: int) -> Floats:
        a = self.actuator[column]
        gain, bias = self.model.actuator_gainprm[a], self.model.actuator_biasprm[a]
        told = self._controls({})[:, a][: len(motion.position)]
        return np.asarray(
            gain[0] * told + bias[1] * motion.position[:, column] + bias[2] * motion.velocity[:, column]
        )

    def refine(self, causes: Causes) -> None:
        """Makes these causes the ones near which motions are exact.

        A step of 2 ms is a fifth of a millirad off. By how much is found once, with steps eight times shorter, and added to all
        motions from then on: nearby models have nearly the same error, and differences between them none of it. The integrator is of
        first order, so the short steps are off by an eighth still: Richardson's extrapolation takes that too.
        """
        self._known.clear()
        self._correction = (np.zeros(0), np.zeros(0))
        (coarse,), (fine,) = self._run([causes]), self._run([causes], SUBSTEPS)
        if coarse is not None and fine is not None:
            whole = SUBSTEPS / (SUBSTEPS - 1.0)
            self._correction = (
                whole * (fine.position - coarse.position),
                whole * (fine.velocity - coarse.velocity),
            )

    def motions(self, several: Sequence[Causes]) -> list[Motion | None]:
        """The motion with each set of causes; None where the simulation diverges."""
        keys = [_key(causes) for causes in several]
        new = [i for i, key in enumerate(keys) if key not in self._known and keys.index(key) == i]
        fresh: dict[tuple[Any, ...], Motion | None] = {}
        for first in range(0, len(new), AT_ONCE):
            part = new[first : first + AT_ONCE]
            for i, motion in zip(part, self._run([several[i] for i in part]), strict=True):
                fresh[keys[i]] = motion
                if motion is not None:
                    self._known[keys[i]] = motion
        out = [fresh[key] if key in fresh else self._known[key] for key in keys]
        while len(self._known) > KEPT_IN_MEMORY:
            self._known.popitem(last=False)
        return out

    def _run(self, several: Sequence[Causes], substeps: int = 1) -> list[Motion | None]:
        models = [self._changed(causes) for causes in several]
        settle = int(SETTLE_S / STEP_S)
        controls = [self._controls(causes) for causes in several]
        controls = [np.concatenate([np.repeat(c[:1], settle, axis=0), c]) for c in controls]
        if substeps > 1:
            controls = [_between(c, np.arange((len(c) - 1) * substeps + 1) / substeps) for c in controls]
            for model in models:
                model.opt.timestep = STEP_S / substeps
        state = np.zeros(mujoco.mj_stateSize(self.model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
        begin = self._data[0]
        mujoco.mj_resetData(self.model, begin)
        begin.qpos[self.qpos] = self.commands[0]
        mujoco.mj_getState(self.model, begin, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        states, _ = self._pool.rollout(
            models, self._data, np.repeat(state[None], len(models), axis=0), np.stack(controls)
        )
        self.count += len(models)
        out: list[Motion | None] = []
        for run in states:
            # A state is the time, then positions, then velocities; row i is after step i.
            kept = run[settle * substeps - 1 : -1 : substeps]
            position = kept[:, 1 + self.qpos]
            velocity = kept[:, 1 + self.model.nq + self.dof]
            wild = not np.isfinite(position).all() or bool((np.abs(position) > WILD_RAD).any())
            if not wild and len(self._correction[0]):
                count = min(len(position), len(self._correction[0]))
                position = position[:count] + self._correction[0][:count]
                velocity = velocity[:count] + self._correction[1][:count]
            out.append(None if wild else Motion(self.start_s, position, velocity))
        return out

    def _changed(self, causes: Causes) -> Any:
        """The model with the causes that a rollout holds."""
        model = copy.copy(self.model)
        for (effect, at), values in causes.items():
            if not EFFECTS[effect].in_rollout:
                continue
            column = self.joints.index(at.partition(":")[2])
            a, dof = self.actuator[column], self.dof[column]
            if effect == "servo_gain":
                stiffness, damping = gains(values)
                model.actuator_gainprm[a, 0] *= stiffness
                model.actuator_biasprm[a, 1] *= stiffness
                model.actuator_biasprm[a, 2] *= damping
                model.dof_damping[dof] *= damping
            elif effect == "viscous_friction":
                model.dof_damping[dof] += values[0]
            elif effect == "coulomb_friction":
                model.dof_frictionloss[dof] += values[0]
            elif effect == "reflected_inertia":
                model.dof_armature[dof] += values[0]
            elif effect == "torque_limit":
                model.actuator_forcelimited[a] = 1
                model.actuator_forcerange[a] = -values[0], values[0]
        return model

    def _controls(self, causes: Causes) -> Floats:
        """(T, actuators): what the servos are told."""
        told = self.commands.copy()
        for (effect, at), values in causes.items():
            if effect not in ("servo_lag", "velocity_limit"):
                continue
            column = self.joints.index(at.partition(":")[2])
            law = _lagged if effect == "servo_lag" else _slewed
            told[:, column] = law(told[:, column], values[0])
        out = np.zeros((len(told), self.model.nu))
        for column, name in enumerate(self.joints):
            values = told[:, column]
            if name not in self.simulator.kept:
                values = values + 2.0 / IDEAL_RATE_PER_S * np.gradient(values, STEP_S)
            out[:, self.actuator[column]] = values
        return out

    def load(self, motion: Motion, time_s: Floats) -> Floats:
        """Torque that gravity and the motion put on each joint at times (F,): (F, joints), N m; a load pushes with its sign."""
        if "load" in motion._load:
            return motion._load["load"]
        data, out = self._data[0], np.zeros((len(time_s), len(self.joints)))
        force = np.zeros(self.model.nv)
        acceleration = np.gradient(motion.velocity, STEP_S, axis=0)
        place = (time_s - self.start_s) / STEP_S
        q, v, a = (_between(x, place) for x in (motion.position, motion.velocity, acceleration))
        mujoco.mj_resetData(self.model, data)
        for row in range(len(time_s)):
            data.qpos[self.qpos], data.qvel[self.dof], data.qacc[self.dof] = q[row], v[row], a[row]
            mujoco.mj_kinematics(self.model, data)
            mujoco.mj_comPos(self.model, data)
            mujoco.mj_comVel(self.model, data)
            mujoco.mj_rne(self.model, data, 1, force)
            out[row] = -force[self.dof]
        motion._load["load"] = out
        return out

    def nominal(self) -> Motion:
        """The motion of the model as it is. Raises `MirrorPostureError` where it diverges."""
        (motion,) = self.motions([{}])
        if motion is None:
            raise MirrorPostureError(
                "the simulation of the model as it is diverges; check its masses and its servos' gains"
            )
        return motion


def _key(causes: Causes) -> tuple[Any, ...]:
    return tuple(sorted((key, values) for key, values in causes.items() if EFFECTS[key[0]].in_rollout))


def _lagged(told: Floats, time_constant_s: float) -> Floats:
    """First order, exact for a command that is straight within a step."""
    if time_constant_s <= 1e-6:
        return told
    decay = float(np.exp(-STEP_S / time_constant_s))
    out: Floats = told.copy()
    slope = time_constant_s / STEP_S
    now = float(told[0])
    for i in range(1, len(told)):
        rise = told[i] - told[i - 1]
        now = decay * (now - told[i - 1] + slope * rise) + told[i] - slope * rise
        out[i] = now
    return out


def _slewed(told: Floats, limit_per_s: float) -> Floats:
    most = limit_per_s * STEP_S
    out: Floats = told.copy()
    now = float(told[0])
    for i, value in enumerate(told.tolist()):
        now += min(most, max(-most, value - now))
        out[i] = now
    return out
