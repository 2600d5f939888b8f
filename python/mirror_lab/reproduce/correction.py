"""Corrections of Table I's body by the product's loop: the methods, gains and runs of Fig. 13."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from mirror_posture._core import MirrorPostureError
from mirror_posture.correct import (
    PAPER_VIEWS,
    CorrectOptions,
    LookReport,
    MeasureChoice,
    Outcome,
    StepOptions,
    StopOptions,
    correct,
)
from mirror_posture.measurement import Estimator
from mirror_posture.render import View

from ..robots import HiddenEffect, TwinOptions, TwinRobot
from .body import MARKER, TARGET_RAD, Body, error_mm
from .observation import Told
from .spread import deviation

Floats = npt.NDArray[np.float64]

GAINS = (0.2, 0.4, 0.6, 0.8, 1.0)
CORRECTIONS = 4
PAPER_RUNS = 5
"""The paper's: five gains, four corrections, five runs."""
LONG_CORRECTIONS = 20
"""Corrections at λ = 0.2 beyond the paper's four, to show whether it converges."""
BEST_GAIN = 0.8
"""The loop's own default."""

MOUNT_OFF_RAD, MOUNT_OFF_M = math.radians(0.3), 0.0005
"""How far the camera–board transform is off in each axis where it is taken as calibrated by hand, standard deviation."""
TURNED_AND_TILTED = (
    *PAPER_VIEWS,
    View(yaw_rad=math.radians(8.0), pitch_rad=math.radians(10.0)),
    View(yaw_rad=math.radians(8.0), pitch_rad=math.radians(-8.0)),
)
"""The paper's two views and two tilted ones: with rotations about one axis alone the camera–board transform is not determined."""

ON_AND_ON = StopOptions(tolerance_m=1e-6, patience=1000, divergence=1e6, retries=1000)
"""The paper makes a fixed number of corrections: the loop neither stops at a tolerance nor gives up."""
RUNS_A_SEED = 1000
"""Spacing of the runs' seeds, so that those of different seeds differ."""
SPARE_LOOKS = 4
"""Looks beyond one a correction: the loop looks again where noise alone would move it."""


@dataclass(frozen=True)
class Way:
    """One way to correct."""

    name: str
    title: str
    estimator: Estimator = "point-pair"
    views: tuple[View, ...] = PAPER_VIEWS
    step: StepOptions = field(default_factory=StepOptions)
    stop: StopOptions = ON_AND_ON
    mount_off: bool = False
    """Whether the camera–board transform is off, and said to be so well known."""

    def options(self, gain: float, corrections: int) -> CorrectOptions:
        """For the loop."""
        measure = MeasureChoice(self.estimator)
        if self.mount_off:
            measure = replace(measure, mount_std_rad=MOUNT_OFF_RAD, mount_std_m=MOUNT_OFF_M)
        return CorrectOptions(
            step=replace(self.step, gain=gain),
            stop=replace(self.stop, looks=corrections + 1 + SPARE_LOOKS),
            measure=measure,
            markers=(MARKER,),
            views=self.views,
            extra_views=0,
        )

    def hidden(self, seed: int) -> tuple[HiddenEffect, ...]:
        """The hidden effects of the body in a run."""
        if not self.mount_off:
            return Body().hidden
        turn, shift = np.random.default_rng([seed, 13]).normal(size=(2, 3))
        names = ("rx_rad", "ry_rad", "rz_rad", "dx_m", "dy_m", "dz_m")
        values = (*MOUNT_OFF_RAD * turn, *MOUNT_OFF_M * shift)
        return (
            *Body().hidden,
            HiddenEffect("camera_mount", "camera", dict(zip(names, map(float, values), strict=True))),
        )


PAPER = Way("paper", "Eq. 2, constant J, damped J⁺ (the loop's default)")
PLAIN = Way(
    "plain",
    "Eq. 2, constant J, plain J⁺ (as the paper writes it)",
    step=StepOptions(mu_m_per_rad=0.0, largest_step_rad=math.pi),
    # Large motions of the hand are accepted: the undamped step is to show its effect.
    stop=replace(ON_AND_ON, play_m=1.0, largest_gap_m=1.0, largest_correction_rad=math.pi),
)
EQ2_OFF = Way("eq2_mount_off", "Eq. 2, mount off", views=TURNED_AND_TILTED, mount_off=True)
JOINT_OFF = Way("joint_mount_off", "joint, mount off", "joint", TURNED_AND_TILTED, mount_off=True)


@dataclass(frozen=True)
class Runs:
    """Runs of one way at one gain: true errors in the paper's axes, (runs, corrections + 1, 3), mm."""

    error_mm: Floats
    measured_mm: Floats
    """(runs, corrections + 1): the distance as the loop measured it; NaN where it took no look."""

    @property
    def distance_mm(self) -> Floats:
        """(runs, corrections + 1): the paper's d."""
        return np.asarray(np.linalg.norm(self.error_mm, axis=2))

    @property
    def mean(self) -> Floats:
        """(corrections + 1,)."""
        return np.asarray(self.distance_mm.mean(axis=0))

    @property
    def std(self) -> Floats:
        """(corrections + 1,), between runs; NaN of one run."""
        return deviation(self.distance_mm, axis=0)

    @property
    def along(self) -> Floats:
        """(runs, corrections + 1): the error along its first direction; negative after an overshoot."""
        first = self.error_mm[:, 0] / np.linalg.norm(self.error_mm[:, 0], axis=1)[:, None]
        result: Floats = np.einsum("rki,ri->rk", self.error_mm, first)
        return result


def run_once(way: Way, gain: float, corrections: int, options: TwinOptions) -> tuple[Floats, Floats]:
    """One correction from the target posture on: true errors (corrections + 1, 3) and measured distances, mm."""
    robot = TwinRobot(way.hidden(options.seed), options)
    true: dict[int, Floats] = {}
    measured: dict[int, float] = {}

    def on_look(report: LookReport) -> None:
        # After the look and before the next command: the body stands as it was measured.
        true.setdefault(report.steps, error_mm(robot))
        distance = report.markers[0].distance_m
        measured.setdefault(report.steps, math.nan if distance is None else distance * 1e3)
        if report.steps >= corrections:
            raise EnoughCorrectionsError

    with robot, suppress(EnoughCorrectionsError):
        not_stopped(correct(robot, TARGET_RAD, way.options(gain, corrections), on_look=on_look))
    errors, distances = [true[0]], [measured[0]]
    for step in range(1, corrections + 1):
        # Without a further command the hand stays where it is.
        errors.append(true.get(step, errors[-1]))
        distances.append(measured.get(step, math.nan))
    return np.array(errors), np.array(distances)


class EnoughCorrectionsError(Exception):
    """Ends the loop after as many corrections as the paper made."""


def not_stopped(outcome: Outcome) -> None:
    """The loop ends on Ctrl-C as on any stop; here the whole run shall end. Raises `KeyboardInterrupt`, `MirrorPostureError`."""
    if outcome.stop.kind == "interrupted":
        raise KeyboardInterrupt
    if outcome.stop.kind == "robot_failed":
        raise MirrorPostureError(outcome.stop.sentence)


def runs_of(
    way: Way,
    gain: float,
    runs: int,
    options: TwinOptions,
    told: Told | None = None,
    corrections: int = CORRECTIONS,
) -> Runs:
    """Several runs, each with noise of its own."""
    found = []
    for run in range(runs):
        found.append(
            run_once(way, gain, corrections, replace(options, seed=RUNS_A_SEED * options.seed + run))
        )
        if told is not None:
            told()
    return Runs(np.array([f[0] for f in found]), np.array([f[1] for f in found]))


def planned(pictures: bool) -> list[tuple[Way, float, int]]:
    """Method, gain and corrections of each run; with pictures, which take long, only those that the statements need."""
    all_gains = [(PAPER, gain, CORRECTIONS) for gain in GAINS]
    if pictures:
        return [*all_gains, (JOINT_OFF, BEST_GAIN, CORRECTIONS)]
    return [
        *all_gains,
        (PAPER, GAINS[0], LONG_CORRECTIONS),
        *((PLAIN, gain, CORRECTIONS) for gain in GAINS),
        (EQ2_OFF, BEST_GAIN, CORRECTIONS),
        *((JOINT_OFF, gain, CORRECTIONS) for gain in GAINS),
    ]
