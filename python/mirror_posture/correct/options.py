"""Options of a correction; frozen dataclasses with units in their names."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Literal

from .._core import MirrorPostureError
from ..measurement import ESTIMATORS, Estimator, Mount
from ..viewpoint import View

JacobianSource = Literal["reference", "current", "broyden"]

PAPER_VIEWS = (View(), View(yaw_rad=math.radians(15.0)))
"""The paper's two viewpoints: 0° and 15° between chessboard and mirror."""


@dataclass(frozen=True)
class StepOptions:
    """How a step is taken: `Δθ = gain · Jᵀ (J Jᵀ + μ² I)⁻¹ (p_ref − p_now)`, whitened by the markers' covariances."""

    gain: float = 0.8
    """λ, above 0 and at most 1. The paper's smooth one is 0.2."""
    mu_m_per_rad: float | None = None
    """μ, m/rad; 0 is the paper's plain pseudo-inverse. None: the smallest that keeps noise below `step_std_rad`."""
    step_std_rad: float = math.radians(0.5)
    """What the measurement's noise may turn the joints by in one step, standard deviation."""
    largest_step_rad: float = 0.15
    """The most that a joint may turn in one step (m for a prismatic joint)."""
    jacobian: JacobianSource = "reference"
    """J at the target posture (the paper's), at the current command, or updated from the steps' effect
    (Broyden)."""


@dataclass(frozen=True)
class StopOptions:
    """When a correction stops, and which readings it accepts; see `mirror_core::correct::JudgeOptions`."""

    tolerance_m: float = 0.001
    """ε: every marker's true distance from its target must be below."""
    wrong_converged: float = 0.01
    """The probability that a whole correction calls itself converged wrongly, all its looks and markers together."""
    looks: int = 20
    """The most looks (measurements of the posture; each takes several pictures)."""
    patience: int = 5
    """Looks that must bring the best error down by `least_progress`, else the correction has stalled."""
    least_progress: float = 0.1
    divergence: float = 1.5
    """How many times the best error counts as diverging, if it is significant and happens twice in a row."""
    retries: int = 2
    """Looks in a row that may fail, or be too uncertain, before the correction stops for it."""
    largest_gap_m: float = 0.05
    """A marker whose first reading is farther from its model is rejected."""
    play_m: float = 0.004
    """How far a marker may be from where the last step should have put it, beyond noise and that whole step."""
    largest_correction_rad: float = 0.35
    """The farthest that a joint may be commanded from the target posture (m for a prismatic joint)."""


@dataclass(frozen=True)
class MeasureChoice:
    """How each posture is measured."""

    estimator: Estimator = "maximum-likelihood"
    """As in `measure`: `point-pair` is the paper's Eq. 2; `joint` takes all views so far together and frees the mount."""
    mount: Mount | None = None
    """A calibrated camera–board transform."""
    mount_std_rad: float | None = None
    mount_std_m: float | None = None
    """How well the model's camera–board transform is known, one axis; None: exactly (`joint`: 1°, 2 mm)."""
    unmodelled_std_m: float = 0.0001
    """What no covariance holds (the balls' mounts, a bent board), one axis: added to every marker's covariance."""


@dataclass(frozen=True)
class CorrectOptions:
    """All choices of a correction."""

    step: StepOptions = field(default_factory=StepOptions)
    stop: StopOptions = field(default_factory=StopOptions)
    measure: MeasureChoice = field(default_factory=MeasureChoice)
    markers: tuple[str, ...] = ()
    """The markers to be brought to their targets. None named: of each limb that the target moves, the one with the longest lever."""
    held: tuple[str, ...] = ()
    """Joints that are not moved. Those between camera and board are held anyway."""
    views: tuple[View, ...] | None = None
    """The mirror's pose in each look's pictures. None: proposed for the target (`propose_views`)."""
    further_views: tuple[View, ...] | None = None
    """The mirror's pose for a look that is too uncertain for a decision. None: `extra_views` are proposed."""
    views_a_look: int = 3
    """How many viewpoints are proposed for a look."""
    view_joints: tuple[tuple[tuple[str, float], ...], ...] = ()
    """Instead of turning mirror or stand: for each view, joints of the robot (waist, legs) and their
    positions, rad."""
    extra_views: int = 2
    """How many more viewpoints are proposed for a look that is too uncertain for a decision."""

    def check(self) -> None:
        """Refuses what makes no sense; the numbers of steps and stops are checked by the core."""
        if self.measure.estimator not in ESTIMATORS:
            raise MirrorPostureError(
                f"estimator: got {self.measure.estimator!r}, needed one of {', '.join(ESTIMATORS)}"
            )
        if self.views is not None and len(self.views) < 2 and not self.view_joints:
            raise MirrorPostureError(
                f"views: got {len(self.views)}, needed at least 2: a marker is where the rays of two views meet"
            )
        if self.view_joints and len(self.view_joints) < 2:
            raise MirrorPostureError("view_joints: got 1, needed at least 2: a marker is where two rays meet")
        if self.views_a_look < 2:
            raise MirrorPostureError(f"views_a_look: got {self.views_a_look}, needed at least 2")

    def core_arguments(self) -> dict[str, Any]:
        """As the core's `Corrector` takes them."""
        return {**vars(self.step), **vars(self.stop)}
