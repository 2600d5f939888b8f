"""A robot in motion: pinocchio's articulated-body algorithm under servos, stepped every 0.25 ms.

    torque = clip(k (u − q) − d q̇, ± limit) − b q̇,   M(q) q̈ + c(q, q̇) + g(q) = torque

by Adams and Bashforth's two-step rule for the speeds and the trapezoid for the positions, second order; dry friction is an impulse at its
joint, at most h F, that reduces the speed, and holds the joint where it suffices to stop it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

Array = NDArray[np.float64]

STEP_S = 0.00025
KEPT_S = 0.001
INVERSE_EVERY = 20
REST_S = 0.8


@dataclass
class Servos:
    """By joint: stiffness, damping, reflected inertia, dry friction; the changes by a cause, and the errors of the command."""

    stiffness: Array
    damping: Array
    armature: Array
    friction: Array
    viscous: Array
    torque_limit: Array
    velocity_limit: Array
    lag_s: Array

    @classmethod
    def ideal(cls, stiffness: Array, damping: Array, armature: Array) -> Servos:
        """Servos without friction, limits or lag."""
        n = len(stiffness)
        return cls(
            stiffness.copy(), damping.copy(), armature.copy(), np.zeros(n), np.zeros(n), np.full(n, np.inf),
            np.full(n, np.inf), np.zeros(n),
        )  # fmt: skip


@dataclass
class Track:
    """Positions and loads of the joints every `KEPT_S` from time 0."""

    q: Array
    load: Array
    torque: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def at(self, time_s: Array, table: Array | None = None) -> Array:
        """Positions (or another table) at times of any shape: (..., joints)."""
        values = self.q if table is None else table
        place = np.clip(time_s / KEPT_S, 0, len(values) - 1.001)
        i = place.astype(int)
        s = (place - i)[..., None]
        result: Array = (1 - s) * values[i] + s * values[i + 1]
        return result


class Engine:
    """The rigid bodies of a URDF whose joints `joints` move; all others are locked at 0."""

    def __init__(self, urdf: str, joints: list[str], gravity: Array) -> None:
        full = pin.buildModelFromXML(urdf)
        locked = [full.getJointId(n) for n in full.names[1:] if n not in joints]
        self.model = pin.buildReducedModel(full, locked, pin.neutral(full))
        self.model.gravity.linear = np.asarray(gravity, float)
        self.data = self.model.createData()
        self.joints = joints
        self.at = np.array([self.model.joints[self.model.getJointId(j)].idx_v for j in joints])

    def inertia(self, q: Array) -> Array:
        """Diagonal of the mass matrix, in the order of `joints`, without reflected inertias."""
        self.model.armature[:] = 0.0
        full = np.zeros(self.model.nq)
        full[self.at] = q
        result: Array = np.diag(pin.crba(self.model, self.data, full))[self.at].copy()
        return result

    def run(self, time_s: Array, commands: Array, servos: Servos) -> Track:
        """Moves along commands (S, joints) at times (S,), straight between them, from rest at the first."""
        model, data, h = self.model, self.data, STEP_S
        order = self.at
        model.armature[:] = 0.0
        model.armature[order] = servos.armature
        k, d, b = servos.stiffness, servos.damping, servos.viscous
        q, v = np.zeros(model.nq), np.zeros(model.nv)
        q[order] = commands[0]
        rest, moving = int(REST_S / h), int((time_s[-1] - time_s[0]) / h)
        times = time_s[0] + h * np.maximum(np.arange(rest + moving) - rest, 0)
        told = np.stack([np.interp(times, time_s, c) for c in commands.T], axis=1)
        late = servos.lag_s > 0
        lag = np.where(late, 1 - np.exp(-h / np.maximum(servos.lag_s, 1e-9)), 1.0)
        most = servos.velocity_limit * h
        u = told[0].copy()
        keep = round(KEPT_S / h)
        kept_q, kept_load, kept_torque = [], [], []
        inverse = np.eye(len(order))
        before = np.zeros(len(order))
        rubbing = np.flatnonzero(servos.friction)
        for i, target in enumerate(told):
            # A filter's input is the command in the middle of a step: with that at its end the delay would be half a step shorter.
            goal = np.where(late, 0.5 * (target + told[max(i - 1, 0)]), target)
            step = np.clip(goal - u, -most, most) * lag
            u = u + step
            speed = v[order].copy()
            asked = k * (u - q[order]) - d * speed
            torque = np.clip(asked, -servos.torque_limit, servos.torque_limit)
            tau = np.zeros(model.nv)
            tau[order] = torque - b * speed
            if i % INVERSE_EVERY == 0:
                inverse = pin.computeMinverse(model, data, q)
                inverse = np.asarray(inverse)[np.ix_(order, order)].copy()
            smooth = pin.aba(model, data, q, v, tau)[order].copy()
            before = smooth if i == 0 else before
            faster = speed + h * (1.5 * smooth - 0.5 * before)
            before = smooth
            for j in rubbing:
                most_impulse = h * servos.friction[j]
                impulse = np.clip(-faster[j] / inverse[j, j], -most_impulse, most_impulse)
                faster = faster + inverse[:, j] * impulse
            accelerated = (faster - speed) / h
            if i >= rest and (i - rest) % keep == 0:
                full = np.zeros(model.nv)
                full[order] = accelerated
                kept_q.append(q[order].copy())
                kept_torque.append(torque)
                armature = model.armature.copy()
                model.armature[:] = 0.0
                kept_load.append(-pin.rnea(model, data, q, v, full)[order])
                model.armature[:] = armature
            v[order] = faster
            q[order] = q[order] + 0.5 * h * (speed + faster)
        return Track(np.array(kept_q), np.array(kept_load), np.array(kept_torque))

    def frames(self, q: Array, links: list[str]) -> Array:
        """Poses (N, links, 4, 4) of links in the root's frame at positions (N, joints)."""
        ids = [self.model.getFrameId(link) for link in links]
        out = np.empty((len(q), len(links), 4, 4))
        full = np.zeros(self.model.nq)
        for n, row in enumerate(q):
            full[self.at] = row
            pin.forwardKinematics(self.model, self.data, full)
            for i, frame in enumerate(ids):
                out[n, i] = pin.updateFramePlacement(self.model, self.data, frame).homogeneous
        return out
