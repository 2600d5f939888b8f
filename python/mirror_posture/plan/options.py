"""Options of a plan: the mirror, the room, the number of pictures."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from .._core import MirrorPostureError
from ..arrays import Floats
from ..formats.plan_keys import MOST_POSTURES, MOST_VIEWS
from ..mirror import Mirror

YAWS_DEG = (0.0, 12.0, -12.0, 24.0, -24.0)
PITCHES_DEG = (0.0, 8.0, -8.0)
USUAL_SIZE_M = (0.4, 0.6)
"""Default width and height of a mirror."""


@dataclass(frozen=True, eq=False)
class MirrorPlace:
    """A flat mirror of finite size, in the root's frame: its centre, its unit normal away from the robot, its edges' directions."""

    center_in_root_m: Floats
    normal_in_root: Floats
    up_in_root: Floats
    """Along its height, square to the normal."""
    width_m: float
    height_m: float
    yaw_rad: float = 0.0
    pitch_rad: float = 0.0

    def moved(self, turn: Floats, shift_m: Floats) -> MirrorPlace:
        """The same mirror in another frame: turned (3, 3), then shifted."""
        return replace(
            self,
            center_in_root_m=turn @ self.center_in_root_m + shift_m,
            normal_in_root=turn @ self.normal_in_root,
            up_in_root=turn @ self.up_in_root,
        )

    @property
    def right_in_root(self) -> Floats:
        """Along its width."""
        return np.cross(self.up_in_root, self.normal_in_root)


@dataclass(frozen=True)
class PlanOptions:
    """What the plan is made for. Lengths are in m, places in the root's frame."""

    mirror_width_m: float | None = None
    mirror_height_m: float | None = None
    """None: as in session.toml, otherwise 40 cm wide and 60 cm high."""
    mirror_at_m: tuple[float, float, float] | None = None
    """Its centre; None: as in session.toml, otherwise the plan chooses, in front of the board and the
    markers."""
    mirror_fixed: bool = False
    """True: it hangs on a wall and is not turned: one view."""
    views: int = 3
    """How many ways the mirror is turned, one after the other."""
    postures: int = 36
    same_postures: bool = False
    """True: each posture in every view, so that `measure` can triangulate it. False: new postures in each view."""
    table_m: float | None = None
    """Height of the table or floor; None: the lowest point of the robot at home."""
    clearance_m: float | None = None
    """Clearance of the body from itself and the table; from the glass three times as much. None: 1 cm, less
    for a robot below 60 cm."""
    home: Mapping[str, float] = field(default_factory=dict)
    """Home positions of joints other than 0, rad (m). Joints on which no marker depends stay there."""
    held: tuple[str, ...] = ()
    """Joints that stay at home though markers depend on them."""
    real_balls_allowed: bool = False
    """True: a ball may be seen directly, beside the mirror."""
    packages: Mapping[str, Path] = field(default_factory=dict)
    """Folders of the ROS packages whose meshes the URDF names."""
    noise_px: float | None = None
    """Noise of a corner or a ball's centre, one axis; None: as in session.toml, otherwise 0.15 px."""
    seed: int = 0

    @property
    def mirror_size_m(self) -> tuple[float, float]:
        """Width and height."""
        width, height = USUAL_SIZE_M
        return self.mirror_width_m or width, self.mirror_height_m or height

    def before(self, mirror: Mirror | None) -> PlanOptions:
        """With the mirror of session.toml where these options do not set it."""
        if mirror is None:
            return self
        return replace(
            self,
            mirror_width_m=self.mirror_width_m or mirror.width_m,
            mirror_height_m=self.mirror_height_m or mirror.height_m,
            mirror_at_m=self.mirror_at_m or mirror.center_in_root_m,
        )

    def __post_init__(self) -> None:
        for name in ("mirror_width_m", "mirror_height_m", "clearance_m"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0.0):
                raise MirrorPostureError(f"plan, {name}: got {value!r}, needed a number above 0")
        if self.table_m is not None and not math.isfinite(self.table_m):
            raise MirrorPostureError(
                f"plan, table_m: got {self.table_m!r}, needed a finite height in the root's frame, m"
            )
        if not 1 <= self.views <= MOST_VIEWS:
            raise MirrorPostureError(f"plan, views: got {self.views}, needed 1 to {MOST_VIEWS}")
        if not 2 <= self.postures <= MOST_POSTURES:
            raise MirrorPostureError(f"plan, postures: got {self.postures}, needed 2 to {MOST_POSTURES}")
        if self.noise_px is not None and not (math.isfinite(self.noise_px) and self.noise_px > 0.0):
            raise MirrorPostureError(f"plan, noise_px: got {self.noise_px!r}, needed a number above 0")


def turned_mirrors(
    options: PlanOptions,
    center_m: Floats,
    forward: Floats,
    up: Floats,
    yaws_deg: Sequence[float] = YAWS_DEG,
    pitches_deg: Sequence[float] = PITCHES_DEG,
) -> list[MirrorPlace]:
    """The mirror turned about its centre, the unturned one first; `forward` is where it is seen from the robot."""
    turns = [(0.0, 0.0)]
    if not options.mirror_fixed:
        # Far apart in yaw first; every other one leans, since yaw alone leaves one direction of the camera unseen.
        turns = [(yaw, pitch) for pitch in pitches_deg for yaw in yaws_deg]
        turns = sorted(turns, key=lambda turn: (abs(turn[0]) + abs(turn[1]), turn))
    return [
        turned_mirror(options, center_m, forward, up, math.radians(yaw), math.radians(pitch))
        for yaw, pitch in turns
    ]


def turned_mirror(
    options: PlanOptions,
    center_m: Floats,
    forward: Floats,
    up: Floats,
    yaw_rad: float,
    pitch_rad: float = 0.0,
) -> MirrorPlace:
    """The mirror turned about its centre; `forward` and `up` are unit vectors."""
    across, lean = square_to(forward, up)
    level = math.cos(yaw_rad) * forward + math.sin(yaw_rad) * across
    normal = math.cos(pitch_rad) * level + math.sin(pitch_rad) * lean
    top = up - (up @ normal) * normal
    return MirrorPlace(
        center_m, normal, top / np.linalg.norm(top), *options.mirror_size_m, yaw_rad, pitch_rad
    )  # fmt: skip


def square_to(forward: Floats, up: Floats) -> tuple[Floats, Floats]:
    """The unit vectors to the left of `forward` and upward, square to it: `forward` need not be level."""
    across = np.cross(up, forward)
    across /= np.linalg.norm(across)
    return across, np.cross(forward, across)
