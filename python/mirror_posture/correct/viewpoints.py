"""Changes the viewpoint: the mirror or the stand is turned, by hand or by a motor, or the robot turns with
its own joints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from .._core import MirrorPostureError
from ..robots.protocol import CommandedRobot, TurnsView
from ..viewpoint import View
from .options import CorrectOptions
from .planner import propose_views, why_not_seen
from .recorded import Proposed
from .recorder import Recorder
from .target import Target
from .turned import check_turning


@dataclass(frozen=True)
class Viewpoint:
    """One viewpoint of a look: the mirror's pose, or the positions of the robot's turning joints (rad)."""

    view: View | None = None
    joints: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Viewpoints:
    """The viewpoints of every look, and further ones for a look that is too uncertain."""

    usual: tuple[Viewpoint, ...]
    further: tuple[Viewpoint, ...]

    def of_look(self, number: int) -> tuple[Viewpoint, ...]:
        """Forward and backward in turn, so that the stand is not turned between two looks."""
        return self.usual if number % 2 == 0 else self.usual[::-1]


def choose_viewpoints(
    robot: CommandedRobot, target: Target, options: CorrectOptions, recorder: Recorder | None = None
) -> Viewpoints:
    """The viewpoints of a correction: given ones, those of joints, or proposed ones, which the recorder keeps.

    A robot that cannot turn has one: sufficient only if its looks contain marker positions.

    Raises `MirrorPostureError` for a turning joint between camera, board and a marker: it would move what
    is measured.
    """
    if options.view_joints:
        stations = tuple(Viewpoint(joints=dict(one)) for one in options.view_joints)
        check_turning(target, [station.joints for station in stations])
        return Viewpoints(stations, stations[::-1])
    if not isinstance(robot, TurnsView):
        return Viewpoints((Viewpoint(),), ())
    views, further = options.views, options.further_views
    if views is None or (further is None and options.extra_views):
        kept = () if views is None else views
        count = max(options.views_a_look, len(kept)) if views is None else len(views)
        wanted = count + options.extra_views
        before = None if recorder is None else recorder.proposed
        if before is not None and before.answers(wanted, kept):
            proposed = before.views
        else:
            proposed = tuple(propose_views(target, wanted, kept, start=robot.view))
        views = proposed[:count]
        further = proposed[count:] if further is None else further
        if len(views) < 2:
            raise MirrorPostureError(
                f"views: the model finds no two in which board and markers are seen and nothing touches the mirror: "
                f"{why_not_seen(target, robot.view)}; or give the views (--view)"
            )
        if recorder is not None:
            recorder.keep_proposed(Proposed(wanted, proposed))
    return Viewpoints(
        tuple(Viewpoint(view) for view in views), tuple(Viewpoint(view) for view in further or ())
    )


def go(robot: CommandedRobot, viewpoint: Viewpoint, command: Mapping[str, float]) -> None:
    """Brings the robot to a viewpoint with its body at this command; moves nothing that is there already.

    Raises `RobotError`s of the robot.
    """
    wanted = {**command, **viewpoint.joints}
    now = robot.commanded
    if any(now.get(joint) != value for joint, value in wanted.items()):
        robot.command(wanted)
    if viewpoint.view is not None and isinstance(robot, TurnsView) and robot.view != viewpoint.view:
        robot.turn(viewpoint.view)
