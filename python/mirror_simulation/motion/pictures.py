"""Plots of a diagnosed motion: the staircase, and for each joint that a cause names its path, its lag, its
loop, its friction."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mirror_posture.arrays import Floats
from mirror_posture.pages.drawing import AFTER, BEFORE, INK, Drawing, figure, finished, styled

from .diagnose import MotionDiagnosis

WINDOW_S = 8.0
BINS = 15


def joint_pictures(done: MotionDiagnosis) -> Mapping[str, Drawing]:
    """The drawings of the joints that causes name, by joint."""
    out = {}
    joints = [cause.at.partition(":")[2] for cause in done.diagnosis.causes if cause.at.startswith("joint:")]
    for joint in dict.fromkeys(joints):
        out[joint] = _joint(done, joint)
    if not joints and done.problem.scales:
        # A latency shows at every joint: the one that moves most.
        widest = max(done.problem.scales, key=lambda name: done.problem.scales[name].speed)
        out[widest] = _joint(done, widest)
    return out


@styled
def staircase(done: MotionDiagnosis) -> Drawing:
    """The gap step by step."""
    steps = done.diagnosis.document["gap"]["steps"]
    drawn, axes = figure(8.0, 1.2 + 0.6 * len(steps), 1, 1)
    axis = axes[0, 0]
    values = [step["rms_px"] for step in steps]
    names = [(step["added"] or "the model as it is").replace("@", "\n") for step in steps]
    axis.barh(range(len(values)), values, color=[BEFORE] + [AFTER] * (len(values) - 1), height=0.6)
    for place, value in enumerate(values):
        axis.annotate(f"{value:.3g}", (value, place), xytext=(4, 0), textcoords="offset points", va="center")
    floor = done.diagnosis.gap.noise_floor_px
    if floor is not None:
        axis.axvline(floor, color=INK, ls="--", lw=1.2, label="noise")
        axis.legend(loc="lower right", frameon=False)
    axis.set_yticks(range(len(values)), names)
    axis.invert_yaxis()
    axis.margins(x=0.15)
    axis.set_xlabel("gap of simulator against motion, RMS px")
    return finished(drawn, "motion")


@styled
def _joint(done: MotionDiagnosis, joint: str) -> Drawing:
    problem, causes = done.problem, done.found.best.causes
    j = problem.joints.index(joint)
    time = problem.recording.board_time_s
    before, after = problem.joint_error({}, j), problem.joint_error(causes, j)
    nominal, fitted = problem.rollouts.motions([{}, causes])
    assert nominal is not None and fitted is not None
    told = problem.recording.commands((joint,), time)[:, 0]
    position, speed = nominal.at(time)[:, j], nominal.velocity_at(time)[:, j]
    drawn, axes = figure(10.0, 6.4, 2, 2)
    degrees = np.degrees
    window = (time >= time[0]) & (time < time[0] + WINDOW_S)
    path, errors, loop, friction = axes.ravel()
    path.plot(time[window], degrees(told[window]), color="black", lw=1.0, label="commanded")
    path.plot(time[window], degrees(position[window]), color=BEFORE, lw=1.3, label="simulated before")
    column = problem.columns_of[j]
    there = problem.places(causes, fitted).board[:, column]
    path.plot(time[window], degrees(there[window]), color=AFTER, lw=1.3, label="simulated after")
    path.set(xlabel="time, s", ylabel="position, °", title=f"{joint}: {WINDOW_S:.0f} s of its path")
    path.legend(frameon=False, fontsize=8)
    for values, colour, label in ((before, BEFORE, "before"), (after, AFTER, "after")):
        errors.plot(time[window], degrees(values[window]), ".", ms=3, color=colour, label=label)
        loop.plot(degrees(position), degrees(values), ".", ms=2, color=colour)
        friction.plot(*_binned(degrees(speed), degrees(values)), "o-", ms=4, color=colour)
    errors.set(xlabel="time, s", ylabel="error that pictures show, °", title="Error before and after")
    errors.legend(frameon=False, fontsize=8)
    rising = speed > 0
    loop.plot(
        *_binned(degrees(position[rising]), degrees(before[rising])),
        "-",
        color="black",
        lw=1.2,
        label="before, rising",
    )
    loop.plot(
        *_binned(degrees(position[~rising]), degrees(before[~rising])),
        "--",
        color="black",
        lw=1.2,
        label="before, falling",
    )
    loop.legend(frameon=False, fontsize=8)
    loop.set(xlabel="position, °", ylabel="error, °", title="Hysteresis")
    friction.axhline(0.0, color="black", lw=0.6)
    friction.set(
        xlabel="speed, °/s",
        ylabel="error, °",
        title="Error against speed: a slope is a lag, a step is friction",
    )
    return finished(drawn, "motion")


def _binned(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Medians of y in bins of x with as many values each."""
    good = np.isfinite(x) & np.isfinite(y)
    order = np.argsort(x[good])
    parts = [part for part in np.array_split(order, BINS) if len(part)]
    return (
        np.array([np.median(x[good][part]) for part in parts]),
        np.array([np.median(y[good][part]) for part in parts]),
    )
