"""Robots: URDF to a validated tree; forward kinematics, Jacobians and gravity torques of batches of postures.

Postures are arrays `(N, nq)`: one column for each joint that moves by itself (not fixed, not mimic), rad
(m for prismatic joints), in the order of `Robot.position_names`. Frames are the URDF's; `a_from_b` maps
coordinates in frame b to frame a.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from os import PathLike, fspath
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from . import _core
from .arguments import checked_arguments
from .arrays import Floats
from .input_files import LARGEST_MODEL, given_text
from .short_repr import ShortRepr

JointKind = Literal["revolute", "continuous", "prismatic", "fixed"]


@dataclass(frozen=True)
class Link:
    """A rigid body: mass in kg, centre of mass in the link's frame in m, index of the joint that carries it."""

    name: str
    mass_kg: float
    com_in_link_m: tuple[float, float, float]
    parent_joint: int | None


@dataclass(frozen=True, eq=False, repr=False)
class Joint(ShortRepr):
    """A joint between two links: `parent_from_child(θ) = parent_from_joint ∘ motion(θ)` about or along
    `axis`.

    `lower` and `upper` are rad (m for a prismatic joint), infinite where there is no limit. The position of
    a movable joint is `θ = multiplier · q[position] + offset`; a fixed one has no `position`.
    """

    name: str
    kind: JointKind
    parent_link: str
    child_link: str
    parent_from_joint: Floats
    axis: Floats
    lower: float
    upper: float
    position: int | None
    multiplier: float
    offset: float


@dataclass(frozen=True)
class ChainStep:
    """A joint of a chain between two links; sign +1 passed from parent to child, −1 from child to parent."""

    joint: str
    sign: float


class Robot:
    """A robot: an immutable, validated tree of links and joints.

    Links are in depth-first order, the root first; joint j carries link j + 1.
    """

    def __init__(self, core: _core.Robot, urdf: str) -> None:
        """Wraps the compiled robot; use `from_urdf` or `from_urdf_text`."""
        self.core = core
        self.urdf = urdf
        """The text that it was read from."""

    def __reduce__(self) -> tuple[Any, ...]:
        return Robot.from_urdf_text, (self.urdf,)

    def __eq__(self, other: object) -> bool:
        return self.urdf == other.urdf if isinstance(other, Robot) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.urdf)

    @classmethod
    @checked_arguments
    def from_urdf(cls, path: str | PathLike[str]) -> Robot:
        """Reads a URDF file.

        Any tree of revolute, continuous, prismatic, fixed and mimic joints; pictures and simulator tags are ignored.

        Raises `MirrorPostureError`, which names the link or joint, what was got and the fix.
        """
        text = given_text(path, "a URDF in UTF-8", LARGEST_MODEL)
        try:
            return cls.from_urdf_text(text)
        except _core.MirrorPostureError as error:
            raise _core.MirrorPostureError(f"{fspath(path)}: {error}") from None

    @classmethod
    @checked_arguments
    def from_urdf_text(cls, text: str) -> Robot:
        """Reads a robot from URDF text; as `from_urdf`."""
        return cls(_core.Robot.from_urdf_str(text), text)

    def __repr__(self) -> str:
        return repr(self.core)

    @property
    def name(self) -> str:
        """Name of the robot, as in its file."""
        return self.core.name

    @cached_property
    def link_names(self) -> tuple[str, ...]:
        """Names of all links, the root first."""
        return tuple(self.core.link_names)

    @cached_property
    def position_names(self) -> tuple[str, ...]:
        """Names of the joints that the columns of a posture array move."""
        return tuple(self.core.position_names)

    @cached_property
    def links(self) -> tuple[Link, ...]:
        """All links, the root first, parents before children."""
        masses, coms = self.core.masses_kg, self.core.coms_in_link_m
        return tuple(
            Link(
                name, float(mass), (float(com[0]), float(com[1]), float(com[2])), index - 1 if index else None
            )
            for index, (name, mass, com) in enumerate(zip(self.link_names, masses, coms, strict=True))
        )

    @cached_property
    def joints(self) -> tuple[Joint, ...]:
        """All joints, parents before children."""
        core, links = self.core, self.link_names
        limits, poses, axes = core.joint_limits, core.parent_from_joint, core.joint_axes
        multipliers, offsets = core.joint_multipliers, core.joint_offsets
        # Each of these makes a new list of all joints.
        kinds, parents, places = core.joint_kinds, core.joint_parent_links, core.joint_positions
        return tuple(
            Joint(
                name=name,
                kind=kinds[j],
                parent_link=links[parents[j]],
                child_link=links[j + 1],
                parent_from_joint=poses[j],
                axis=axes[j],
                lower=float(limits[j, 0]),
                upper=float(limits[j, 1]),
                position=places[j],
                multiplier=float(multipliers[j]),
                offset=float(offsets[j]),
            )
            for j, name in enumerate(core.joint_names)
        )

    @checked_arguments
    def link_index(self, name: str) -> int:
        """Index of a link; an unknown name is an error that lists the nearest ones."""
        return self.core.link_index(name)

    @checked_arguments
    def position_index(self, name: str) -> int:
        """Column of a joint in posture arrays; fixed and mimic joints have none."""
        return self.core.position_index(name)

    @checked_arguments
    def positions(self, by_joint: Mapping[str, npt.ArrayLike]) -> Floats:
        """Posture array `(N, nq)` from joint names to positions `(N,)` (or one number), rad or m; others stay at 0."""
        columns = {
            self.position_index(name): np.atleast_1d(np.asarray(x, float)) for name, x in by_joint.items()
        }
        count = max((len(column) for column in columns.values()), default=1)
        q = np.zeros((count, len(self.position_names)))
        for index, column in columns.items():
            if len(column) not in (1, count):
                name = self.position_names[index]
                raise _core.MirrorPostureError(
                    f"positions of joint {name!r}: got {len(column)} postures, needed 1 or {count} as other joints have"
                )
            q[:, index] = column
        return q

    @checked_arguments
    def chain(self, link_a: str, link_b: str) -> tuple[ChainStep, ...]:
        """The joints between two links, movable and fixed, in order from link a to link b."""
        names = self.core.joint_names
        joints, signs = self.core.chain_joints(link_a, link_b), self.core.chain_signs(link_a, link_b)
        return tuple(ChainStep(names[j], sign) for j, sign in zip(joints, signs, strict=True))

    @checked_arguments
    def forward_kinematics(self, positions: npt.ArrayLike) -> Floats:
        """Poses `root_from_link` of all links in N postures: `(N, nq)` to `(N, links, 4, 4)`."""
        return self.core.forward_kinematics(positions)

    @checked_arguments
    def link_poses(self, positions: npt.ArrayLike, links: Sequence[str]) -> Floats:
        """Poses `root_from_link` of some links in N postures: `(N, len(links), 4, 4)`, in the order of
        `links`.

        For a large batch of all links most time is spent on writing them to memory; this writes only the
        requested ones.
        """
        return self.core.link_poses(positions, list(links))

    @checked_arguments
    def joint_twists(self, positions: npt.ArrayLike) -> Floats:
        """Twists of what each joint carries, a unit of its own position, in the root's frame: `(N, joints, 6)`.

        Rows (ω, v): a carried point at x moves at `ω × x + v`. Fixed joints have zeros.
        """
        return self.core.joint_twists(positions)

    @checked_arguments
    def points(
        self,
        positions: npt.ArrayLike,
        in_link: str,
        link: str,
        point_in_link_m: npt.ArrayLike = (0.0, 0.0, 0.0),
    ) -> Floats:
        """Where a point that is fixed in `link` is in the frame of `in_link`, m: `(N, 3)`."""
        return self.core.points(positions, in_link, link, point_in_link_m)

    @checked_arguments
    def point_jacobians(
        self,
        positions: npt.ArrayLike,
        in_link: str,
        link: str,
        point_in_link_m: npt.ArrayLike = (0.0, 0.0, 0.0),
    ) -> Floats:
        """Derivatives of `points` by the positions: `(N, 3, nq)`, m/rad (m/m for prismatic joints).

        `in_link` may be any link, for example the camera's. Mimic joints add to the column of the joint
        that drives them.
        """
        return self.core.point_jacobians(positions, in_link, link, point_in_link_m)

    @checked_arguments
    def gravity_torques(
        self,
        positions: npt.ArrayLike,
        gravity_in_held_link: npt.ArrayLike = (0.0, 0.0, -9.81),
        held_link: str | None = None,
    ) -> Floats:
        """Generalised forces of gravity on the positions, `−∂V/∂q`: `(N, nq)`, N m (N for prismatic joints).

        `held_link` (the root by default) stands still; `gravity_in_held_link` is the acceleration of free fall in its frame, m/s².
        Positive pushes the position upward: the opposite sign of pinocchio's `computeGeneralizedGravity`.
        """
        return self.core.gravity_torques(positions, gravity_in_held_link, held_link or self.link_names[0])

    @checked_arguments
    def gravity_moments(
        self,
        positions: npt.ArrayLike,
        gravity_in_held_link: npt.ArrayLike = (0.0, 0.0, -9.81),
        held_link: str | None = None,
    ) -> Floats:
        """Moments of gravity on each joint about its child link's origin, in that link's frame: `(N, joints, 3)`, N m.

        The part along a turning joint's axis is the torque on that joint's own coordinate.
        """
        return self.core.gravity_moments(positions, gravity_in_held_link, held_link or self.link_names[0])
