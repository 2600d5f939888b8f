"""Motions of the simulated robot: the log's commands through the servos, many models at once
(`mujoco.rollout`, all cores).

A joint with a position servo in the model keeps it. To any other joint an ideal servo is added, fast and
with feed-forward of the speed: it follows its command, and its gains cannot be estimated.
"""

from __future__ import annotations

import copy
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from mirror_posture import MirrorPostureError
from mirror_posture.arrays import Floats

from ..simulate.model import STIFF_FRICTION, Simulator, build
from .drives import lagged, slewed
from .effects import EFFECTS, Causes, gains
from .motions import Branch, Motion, between, independent
from .pool import Pool
from .recording import Recording
from .standing import WILD_RAD, Began, began, where_logs_begin

STEP_S = 0.002
SETTLE_S, LONGER_S = 0.6, 0.35
"""Of standing at the first command before the log begins; and so much longer, to see what depends on it."""
AFTER_S = 0.1
IDEAL_RATE_PER_S = 400.0
"""Natural frequency of an added servo: a hundred times that of a limb's motion."""
SUBSTEPS = 8
KEPT_IN_MEMORY = 48
AT_ONCE = 12


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
                servo = self.simulator.servo(name)
                servo.set_to_position(kp=stiffness, kv=2.0 * stiffness / IDEAL_RATE_PER_S)
        spec.option.timestep = STEP_S
        spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        self.model = self.simulator.compiled()
        self.model.dof_solref[:], self.model.dof_solimp[:] = STIFF_FRICTION
        self.joint_id = np.array([self.model.joint(name).id for name in self.joints])
        self.dof = self.model.jnt_dofadr[self.joint_id]
        self.qpos = self.model.jnt_qposadr[self.joint_id]
        names = [self.simulator.servos[name] for name in self.joints]
        self.actuator = np.array([self.model.actuator(name).id for name in names])
        self.gear: Floats = self.model.actuator_gear[self.actuator, 0].copy()
        """Of each servo: it measures its joint's position times this, and gives its joint its force times this."""
        log = recording.states.time_s
        end = max(float(log[-1]), float(recording.marker_time_s.max())) + AFTER_S
        self.start_s = float(log[0])
        self.time_s: Floats = self.start_s + STEP_S * np.arange(
            int((end - self.start_s) / STEP_S) + 2, dtype=np.float64
        )
        self.commands = recording.commands(self.joints, self.time_s)
        self._told = np.zeros((int(SETTLE_S / STEP_S) + len(self.time_s), self.model.nu))
        for column in range(len(self.joints)):
            self._tell(self._told, column, self.commands[:, column])
        self.branches = independent(self.model, self.dof)
        self._branch_of = {self.joints[j]: b for b, columns in enumerate(self.branches) for j in columns}
        self._known: OrderedDict[tuple[int, Any], Branch | None] = OrderedDict()
        self._whole: OrderedDict[tuple[int, ...], Motion] = OrderedDict()
        self._pool = Pool(self.model, self.qpos, self.dof)
        self.count = 0
        """Motions simulated so far."""
        self._correction: list[tuple[Floats, Floats] | None] = []
        self._began: Began | None = began(recording, self.joints)
        self._falling: dict[int, float] | None = None
        if exact:
            self.refine({})

    def servo_torque(self, motion: Motion) -> Floats:
        """What the model's servos give their joints in a motion without causes (T, joints), N m."""
        a, gear = self.actuator, self.gear
        gain, bias = self.model.actuator_gainprm[a], self.model.actuator_biasprm[a]
        told = self._told[-len(self.time_s) :, a]
        by_state = bias[:, 1] * gear * motion.position + bias[:, 2] * gear * motion.velocity
        return np.asarray(gear * (gain[:, 0] * told + by_state))

    def refine(self, causes: Causes) -> None:
        """Makes these causes the ones near which motions are exact.

        A step of 2 ms is a fifth of a millirad off. By how much is found once, with steps eight times shorter, and added to all
        motions from then on: nearby models have nearly the same error, and differences between them none of it. The integrator is of
        first order, so the short steps are off by an eighth still: Richardson's extrapolation takes that too.
        """
        self._known.clear()
        self._whole.clear()
        self._correction = []
        (coarse,), (fine,) = self._run([causes]), self._run([causes], SUBSTEPS)
        whole = SUBSTEPS / (SUBSTEPS - 1.0)
        self._correction = [
            None
            if rough is None or exact is None
            else (
                whole * (exact.position - rough.position),
                whole * (exact.velocity - rough.velocity),
            )
            for rough, exact in zip(coarse, fine, strict=True)
        ]

    @contextmanager
    def near(self, causes: Causes) -> Iterator[None]:
        """While it lasts these causes are the ones near which motions are exact; then those before are again."""
        before = self._known, self._whole, self._correction
        self._known, self._whole = OrderedDict(), OrderedDict()
        try:
            self.refine(causes)
            yield
        finally:
            self._known, self._whole, self._correction = before

    def motions(self, several: Sequence[Causes]) -> list[Motion | None]:
        """The motion with each set of causes; None where the simulation diverges."""
        wanted = [self._by_branch(causes) for causes in several]
        # Limbs without influence on each other are simulated in one motion, each with its own requests.
        missing: list[list[Causes]] = [[] for _ in self.branches]
        seen: set[tuple[int, Any]] = set()
        for parts in wanted:
            for b, part in enumerate(parts):
                key = (b, _key(part))
                if key not in self._known and key not in seen:
                    seen.add(key)
                    missing[b].append(part)
        fresh: dict[tuple[int, Any], Branch | None] = {}
        rounds = max((len(parts) for parts in missing), default=0)
        for first in range(0, rounds, AT_ONCE):
            packed = [
                [parts[i] for parts in missing if i < len(parts)]
                for i in range(first, min(rounds, first + AT_ONCE))
            ]
            runs = self._run([{key: v for part in parts for key, v in part.items()} for parts in packed])
            for i, run in enumerate(runs, start=first):
                asked = [(b, parts[i]) for b, parts in enumerate(missing) if i < len(parts)]
                # Where one limb flies off nothing of the others is sure: each by itself.
                alone = None in run and len(asked) > 1
                own = self._run([part for _, part in asked]) if alone else [run] * len(asked)
                for (b, part), told in zip(asked, own, strict=True):
                    fresh[b, _key(part)] = told[b]
        self._known.update(fresh)
        out: list[Motion | None] = []
        for parts in wanted:
            keys = [(b, _key(part)) for b, part in enumerate(parts)]
            found = [self._known[key] for key in keys]
            for key in keys:
                self._known.move_to_end(key)
            whole = [branch for branch in found if branch is not None]
            same = tuple(id(branch) for branch in whole)
            if len(whole) < len(found):
                out.append(None)
                continue
            if same not in self._whole:
                self._whole[same] = Motion(self.start_s, STEP_S, whole)
            out.append(self._whole[same])
        while len(self._known) > KEPT_IN_MEMORY * len(self.branches):
            self._known.popitem(last=False)
        while len(self._whole) > KEPT_IN_MEMORY:
            self._whole.popitem(last=False)
        return out

    def _by_branch(self, causes: Causes) -> list[Causes]:
        """What of the causes a motion must be simulated for, limb by limb."""
        out: list[Causes] = [{} for _ in self.branches]
        for key, values in causes.items():
            if EFFECTS[key[0]].in_rollout:
                out[self._branch_of[key[1].partition(":")[2]]][key] = values
        return out

    def stood_longer(self, causes: Causes) -> Motion | None:
        """The motion of a robot that has stood at the first command for longer before the log begins.

        None where it diverges, or where encoders determine how long it stood.
        """
        if self._falls(causes):
            return None
        (run,) = self._run([causes], longer=int(LONGER_S / STEP_S))
        whole = [branch for branch in run if branch is not None]
        return Motion(self.start_s, STEP_S, whole) if len(whole) == len(run) else None

    def _run(
        self, several: Sequence[Causes], substeps: int = 1, longer: int = 0
    ) -> list[list[Branch | None]]:
        """The branches of each motion; None for one that diverges."""
        self.count += len(several)
        falls = [self._falls(causes) for causes in several]
        models = [self._changed(causes) for causes in several]
        controls = [self._controls(causes) for causes in several]
        for model in models:
            model.opt.timestep = STEP_S / substeps
        out: list[list[Branch | None]] = [[] for _ in several]
        settle, stands = int(SETTLE_S / STEP_S), self._pool.at_rest(self.commands[0])
        if rest := [i for i, fall in enumerate(falls) if not fall]:
            told = [controls[i] for i in rest]
            if longer:
                told = [np.concatenate([np.repeat(c[:1], longer, axis=0), c]) for c in told]
            begin = np.repeat(stands[None], len(rest), axis=0)
            states = self._pool.run([models[i] for i in rest], begin, [_finer(c, substeps) for c in told])
            kept = states[:, (settle + longer) * substeps - 1 : -1 : substeps]
            for i, run in zip(rest, kept, strict=True):
                out[i] = self._branches_of(run)
        if fallen := [i for i, fall in enumerate(falls) if fall]:
            assert self._began is not None
            mine = [models[i] for i in fallen]
            falling = [[self.branches[b] for b in falls[i]] for i in fallen]
            told = [_finer(controls[i][settle:], substeps) for i in fallen]
            begin = where_logs_begin(
                self._pool, self._began, mine, stands, told, falling, STEP_S / substeps, SETTLE_S
            )
            states = self._pool.run(mine, begin, told)
            kept = np.concatenate([begin[:, None], states[:, substeps - 1 :: substeps]], axis=1)
            for i, run in zip(fallen, kept[:, : len(self.time_s)], strict=True):
                out[i] = self._branches_of(run)
        return out

    def _falls(self, causes: Causes) -> tuple[int, ...]:
        """The branches that fall before the log begins, where a limit of torque may be why."""
        if not any(effect == "torque_limit" for effect, _ in causes):
            return ()
        falling = {self._branch_of[self.joints[j]] for j in self._falling_joints()}
        limited = {self._branch_of[at.partition(":")[2]] for effect, at in causes if effect == "torque_limit"}
        return tuple(sorted(limited & falling))

    def _falling_joints(self) -> dict[int, float]:
        if self._falling is None:
            self._falling = {} if self._began is None else self._began.falling(self.nominal())
        return self._falling

    def falling_joint(self) -> str | None:
        """The joint that its encoder shows to fall when the log begins, the fastest of them."""
        falling = self._falling_joints()
        return self.joints[max(falling, key=lambda column: falling[column])] if falling else None

    def _branches_of(self, kept: Floats) -> list[Branch | None]:
        out: list[Branch | None] = []
        for b, columns in enumerate(self.branches):
            position = kept[:, self._pool.positions_at(columns)]
            velocity = kept[:, self._pool.velocities_at(columns)]
            if not (np.abs(position) <= WILD_RAD).all():
                out.append(None)
                continue
            correction = self._correction[b] if self._correction else None
            if correction is not None:
                position = position + correction[0]
                velocity = velocity + correction[1]
            out.append(Branch(columns, position, velocity))
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
                most = values[0] / abs(float(self.gear[column]))
                model.actuator_forcerange[a] = -most, most
        return model

    def _controls(self, causes: Causes) -> Floats:
        """(settling and T, actuators): the servos' commands."""
        out: Floats = self._told.copy()
        for (effect, at), values in causes.items():
            if effect in ("servo_lag", "velocity_limit"):
                column = self.joints.index(at.partition(":")[2])
                law = lagged if effect == "servo_lag" else slewed
                self._tell(out, column, law(self.commands[:, column], values[0], STEP_S))
        return out

    def _tell(self, out: Floats, column: int, told: Floats) -> None:
        if self.joints[column] not in self.simulator.kept:
            told = told + 2.0 / IDEAL_RATE_PER_S * np.gradient(told, STEP_S)
        told = self.gear[column] * told
        out[:, self.actuator[column]] = np.concatenate([np.full(int(SETTLE_S / STEP_S), told[0]), told])

    def load(self, motion: Motion, time_s: Floats) -> Floats:
        """Torque that gravity and the motion put on each joint at times (F,): (F, joints), N m; a load pushes with its sign."""
        asked = (float(time_s[0]), len(time_s))
        if asked in motion.loads:
            return motion.loads[asked]
        data, out = self._pool.data[0], np.zeros((len(time_s), len(self.joints)))
        force = np.zeros(self.model.nv)
        q, v, a = motion.at(time_s), motion.velocity_at(time_s), motion.acceleration_at(time_s)
        mujoco.mj_resetData(self.model, data)
        for row in range(len(time_s)):
            data.qpos[self.qpos], data.qvel[self.dof], data.qacc[self.dof] = q[row], v[row], a[row]
            mujoco.mj_kinematics(self.model, data)
            mujoco.mj_comPos(self.model, data)
            mujoco.mj_comVel(self.model, data)
            mujoco.mj_rne(self.model, data, 1, force)
            out[row] = -force[self.dof]
        motion.loads[asked] = out
        return out

    def nominal(self) -> Motion:
        """The motion of the model as it is. Raises `MirrorPostureError` where it diverges."""
        (motion,) = self.motions([{}])
        if motion is None:
            raise MirrorPostureError(
                "the simulation of the model as it is diverges; check its masses and its servos' gains"
            )
        return motion


def _finer(controls: Floats, substeps: int) -> Floats:
    """Controls (T, actuators) for steps that are shorter by this factor, linear in between."""
    if substeps == 1:
        return controls
    return between(controls, np.arange((len(controls) - 1) * substeps + 1) / substeps)


def _key(causes: Causes) -> tuple[Any, ...]:
    return tuple(sorted((key, values) for key, values in causes.items() if EFFECTS[key[0]].in_rollout))
