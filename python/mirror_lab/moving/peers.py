"""Comparison with other tools: the same session by the diagnosis, by `mujoco.sysid` and as a table of
errors by joint, as SAGE makes it.

`mujoco.sysid` is used as its users do: all drive parameters of all joints at once, within bounds, and
the residuals of the same pictures, mirrors and noise included. The table of errors is the result of
replaying and comparing; it changes nothing in the model, so it predicts another motion as well as the
unchanged model.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirror_posture.session import load_session
from mirror_simulation.motion import diagnose_motion
from mirror_simulation.motion.effects import Causes, Key
from mirror_simulation.motion.problem import Problem

Array = NDArray[np.float64]
sysid: Any = importlib.import_module("mujoco.sysid")

ALL_AT_ONCE = ("servo_gain", "coulomb_friction", "reflected_inertia", "joint_offset")
"""What is fitted at every joint (damping is the gain's second parameter), and the latency."""
ITERATIONS = 12
SAID = 4


@dataclass(frozen=True)
class Told:
    """A tool's result for a session, its CPU time, and how well it predicts another motion."""

    tool: str
    says: str
    cpu_s: float
    unseen_px: float


def compare(folder: Path, unseen: Path, model: Path) -> tuple[list[Told], float, float]:
    """The three of them; then the unseen motion's gap with the model as it is, and its noise floor, px."""
    began = time.process_time()
    done = diagnose_motion(folder, model=model)
    took = time.process_time() - began
    other = Problem(load_session(unseen), model)
    before, floor = other.rms({})[0], other.floor_px(done.found.noise_scale)
    names = (
        "; ".join(f"{c.effect} at {c.at} ({_value(c)})" for c in done.diagnosis.causes) or "nothing is wrong"
    )
    out = [Told("diagnose", names, took, other.rms(done.found.best.causes)[0])]
    began = time.process_time()
    causes, spread = _sysid(Problem(load_session(folder), model))
    took = time.process_time() - began
    out.append(Told("mujoco.sysid", _widest(causes, spread), took, other.rms(causes)[0]))
    began = time.process_time()
    table = joint_table(Problem(load_session(folder), model))
    took = time.process_time() - began
    worst = ", ".join(f"{name} {rmse:.2f}° (lag {lag:.0f} ms)" for name, rmse, _, lag in table[:SAID])
    out.append(Told("errors by joint", worst, took, before))
    return out, before, floor


def _value(cause: Any) -> str:
    return ", ".join(f"{e.value:.4g} ± {e.std:.1g}" for e in cause.parameters.values())


def _sysid(problem: Problem) -> tuple[Causes, dict[tuple[Key, int], float]]:
    """All parameters at once by bounded least squares; causes, and each parameter's change in its standard deviations."""
    keys = [key for key in problem.hypotheses if key[0] in ALL_AT_ONCE or key[0] == "latency"]
    slots = [(key, k) for key in keys for k in range(len(problem.hypotheses[key].step))]
    parameters = sysid.ParameterDict()
    for key, k in slots:
        h = problem.hypotheses[key]
        low, high = max(h.lower[k], -200 * h.step[k]), min(h.upper[k], 200 * h.step[k])
        parameters.add(sysid.Parameter(f"{key[0]}@{key[1]}:{k}", 0.0, low / h.step[k], high / h.step[k]))
    seen = problem.view.seen

    def causes_of(x: Array) -> Causes:
        values = {key: [0.0] * len(problem.hypotheses[key].step) for key in keys}
        for (key, k), share in zip(slots, x, strict=True):
            values[key][k] = float(share) * problem.hypotheses[key].step[k]
        return {key: tuple(v) for key, v in values.items()}

    def residual(x: Array, _: Any = None) -> tuple[list[Array], None, None]:
        columns = np.asarray(x, float).reshape(len(slots), -1)
        found = problem.residuals([causes_of(column) for column in columns.T])
        flat = [np.full(2 * int(seen.sum()), 1e3) if r is None else r[seen].reshape(-1) for r in found]
        told = np.stack(flat, axis=1)
        return [told[:, 0] if np.asarray(x).ndim == 1 else told], None, None

    # It prints each iteration.
    with contextlib.redirect_stdout(io.StringIO()):
        best, result = sysid.optimize(
            parameters, residual, optimizer="mujoco", verbose=False, max_iters=ITERATIONS
        )
    x = best.as_vector()
    jacobian = np.asarray(result.jac, float)
    left = residual(x)[0][0]
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * float((left**2).mean())
    deviations = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    return causes_of(x), {slot: float(abs(v) / s) for slot, v, s in zip(slots, x, deviations, strict=True)}


def _widest(causes: Causes, spread: dict[tuple[Key, int], float]) -> str:
    significant = [slot for slot, z in spread.items() if z > 1.96]
    first = sorted(spread, key=lambda slot: -spread[slot])[:SAID]
    named = ", ".join(f"{key[0]}@{key[1].removeprefix('joint:')} {causes[key][k]:.3g}" for key, k in first)
    return f"{len(significant)} of {len(spread)} parameters differ from the model at 95 %; first {named}"


def joint_table(problem: Problem) -> list[tuple[str, float, float, float]]:
    """By joint, the worst first: RMSE in degrees, correlation of simulated and seen position, lag in ms."""
    nominal = problem.rollouts.nominal()
    times = problem.recording.board_time_s
    out = []
    for name in problem.scales:
        if not any(key[1] == f"joint:{name}" for key in problem.hypotheses):
            continue
        j = problem.joints.index(name)
        error = problem.joint_error({}, j)
        good = np.isfinite(error)
        simulated = nominal.at(times)[good, j]
        seen = simulated + error[good]
        speed = nominal.velocity_at(times)[good, j]
        lag = -1e3 * float((error[good] * speed).sum() / max(float((speed**2).sum()), 1e-12))
        rmse = float(np.degrees(np.sqrt(np.mean(error[good] ** 2))))
        out.append((name, rmse, float(np.corrcoef(simulated, seen)[0, 1]), lag))
    return sorted(out, key=lambda row: -row[1])
