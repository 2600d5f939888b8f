"""The target of a correction: the markers, the joints, and the markers' positions by the model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .. import _core
from .._core import MirrorPostureError
from ..arguments import checked_arguments
from ..arrays import Floats
from ..robots.nominal import Nominal
from ..short_repr import ShortRepr
from .options import CorrectOptions


@dataclass(frozen=True, eq=False, repr=False)
class Target(ShortRepr):
    """A posture to be reached, the markers that are measured and the joints that are moved for it."""

    nominal: Nominal
    posture: dict[str, float]
    """Joint positions of the target, rad (m), those that were named; all others are at 0."""
    positions: Floats
    """(nq,): the same as the robot model takes it."""
    markers: tuple[str, ...]
    held: tuple[str, ...]
    board_link: str
    camera_link: str

    @property
    def marker_indices(self) -> list[int]:
        """Of the chosen markers, into the nominal session's."""
        names = self.nominal.marker_names
        return [names.index(name) for name in self.markers]

    @property
    def marker_links(self) -> list[str]:
        """The links that carry the chosen markers."""
        return [self.nominal.metadata.markers[index].link for index in self.marker_indices]

    def corrector(self, options: CorrectOptions, start: Mapping[str, float] | None = None) -> _core.Corrector:
        """The core's corrector for this target; `start` is the first command (rad), the posture itself by default."""
        names = self.nominal.robot.position_names
        first = None if start is None else [float(start.get(name, 0.0)) for name in names]
        return _core.Corrector(
            self.nominal.robot.core,
            camera_link=self.camera_link,
            board_link=self.board_link,
            markers=list(zip(self.markers, self.marker_links, strict=True)),
            posture=self.positions,
            held=list(self.held),
            start=first,
            **options.core_arguments(),
        )

    def by_name(self, positions: npt.ArrayLike) -> dict[str, float]:
        """Positions `(nq,)` by joint name."""
        values = np.asarray(positions, dtype=float)
        return dict(zip(self.nominal.robot.position_names, values.tolist(), strict=True))


@checked_arguments
def make_target(nominal: Nominal, posture: Mapping[str, float], options: CorrectOptions) -> Target:
    """The target of a posture (rad by joint name; other joints at 0).

    Markers are those of `options.markers`, or of each limb that a named joint moves the one with the longest lever.

    Raises `MirrorPostureError` for an unknown joint or marker (with the valid names), a session without camera or board,
    a marker that no joint between it and the board can move.
    """
    metadata, robot = nominal.metadata, nominal.robot
    if metadata.board is None or metadata.camera_link is None:
        raise MirrorPostureError(
            f"{nominal.folder}: needs [board] and [camera_mount]; the correction is measured in a mirror"
        )
    board = metadata.board.link
    for joint in (*posture, *options.held):
        robot.position_index(joint)  # names the nearest valid ones
    for name in options.markers:
        if name not in nominal.marker_names:
            raise MirrorPostureError(
                f"marker {name!r}: {nominal.folder} has none of that name; its markers: {', '.join(nominal.marker_names)}"
            )
    positions = robot.positions({name: [value] for name, value in posture.items()})[0]
    markers = options.markers or _longest_levers(nominal, posture, positions, board)
    if not markers:
        raise MirrorPostureError(
            f"target: no marker is moved by {', '.join(posture) or 'no joint'}; name joints between the board and a marker"
        )
    return Target(
        nominal,
        {name: float(value) for name, value in posture.items()},
        positions,
        tuple(markers),
        options.held,
        board,
        metadata.camera_link,
    )


def _longest_levers(
    nominal: Nominal, posture: Mapping[str, float], positions: Floats, board: str
) -> Sequence[str]:
    """Of the markers that the same joints move, the one that they move most; in the session's order."""
    robot = nominal.robot
    best: dict[tuple[str, ...], tuple[float, str]] = {}
    for marker in nominal.metadata.markers:
        joints = tuple(
            sorted(
                step.joint for step in robot.chain(board, marker.link) if step.joint in robot.position_names
            )
        )
        if not set(joints) & set(posture):
            continue
        jacobian = robot.point_jacobians(positions[None], board, marker.link)[0]
        lever = float(np.linalg.norm(jacobian))
        if lever > best.get(joints, (-1.0, ""))[0]:
            best[joints] = (lever, marker.name)
    chosen = {name for _, name in best.values()}
    return [name for name in nominal.marker_names if name in chosen]
