"""The true machine: its differences from the nominal one, as plain data for body and optics.

An effect becomes a change of geometry or of a servo's command, an elastic or loose part that MuJoCo moves, or a change of camera, board or
mirror. Nothing here predicts pixels.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Commands:
    """The postures in the order of execution: `q_rad` (P, J) over `joints`, and the time at which each is
    held."""

    joints: list[str]
    q_rad: Array
    time_s: Array

    def of(self, joint: str) -> Array:
        """One joint's commands (P,); 0 for one that is not commanded."""
        if joint not in self.joints:
            return np.zeros(len(self.q_rad))
        return self.q_rad[:, self.joints.index(joint)]


ServoError = Callable[[Commands], Array]
"""A joint's position less its command, (P,) rad, without load."""


@dataclass(frozen=True)
class Loose:
    """A joint that MuJoCo moves: within limits around its target (play), by a spring towards it, held by
    friction."""

    joint: str
    play_rad: float = 0.0
    play_load_share: float = 0.0
    """How much wider the play becomes at the largest load, as a share: teeth and bearings give."""
    stiffness: float = 0.0
    """N m / rad; 0 is no spring."""
    stiffening: float = 0.0
    """Share by which the spring's torque is larger than linear at `reference_rad`: a cubic term."""
    reference_rad: float = 0.05
    friction_nm: float = 0.0


@dataclass(frozen=True)
class Bend:
    """An elastic hinge across or along a link: `axis` and `pivot_m` in the link's frame, N m / rad."""

    body: int
    axis: Array
    stiffness: float
    pivot_m: Array


@dataclass(frozen=True)
class MarkerSwing:
    """A loose marker: it is displaced by `reach_m` along gravity, in its link's frame."""

    marker: str
    reach_m: float


@dataclass
class Truth:
    """All that differs from the nominal model."""

    servo: list[tuple[str, ServoError]] = field(default_factory=list)
    loose: list[Loose] = field(default_factory=list)
    bends: list[Bend] = field(default_factory=list)
    origin_shift_m: dict[int, Array] = field(default_factory=dict)
    """By body: how far its joint's origin lies off, in the frame of its parent."""
    axis: dict[int, Array] = field(default_factory=dict)
    swings: list[MarkerSwing] = field(default_factory=list)
    camera_turn_rad: Array = field(default_factory=lambda: np.zeros(3))
    camera_shift_m: Array = field(default_factory=lambda: np.zeros(3))
    camera_sag_rad: Callable[[Commands], Array] | None = None
    """A further rotation of the camera in each posture, (P, 3): a compliant neck."""
    focal_error: Callable[[Array], Array] | None = None
    """By time in s: the factor e of a focal length (1 + e)."""
    focal_scale: float = 0.0
    center_shift_px: Array = field(default_factory=lambda: np.zeros(2))
    distortion: Array = field(default_factory=lambda: np.zeros(5))
    """Added to the file's k1, k2, p1, p2, k3."""
    shear: float = 0.0
    """u grows by this times the row's distance from the centre: a rolling shutter under steady motion."""
    board_scale: float = 0.0
    board_warp_per_m: float = 0.0
    """Curvature of the board about its y axis."""
    glass_m: float = 0.0
    curvature_per_m: Array = field(default_factory=lambda: np.zeros(2))
    """Of the mirror, along its two principal directions: equal ones are a sphere."""
    pairing: tuple[int, int, int] | None = None
    """First frame, last frame, shift: rows whose measurement is another row's."""

    def servo_error(self, joint: str, commands: Commands) -> Array:
        total = np.zeros(len(commands.q_rad))
        for name, law in self.servo:
            if name == joint:
                total = total + law(commands)
        return total
