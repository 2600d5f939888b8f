"""The correction loop: look, measure, decide, command, until there is a stop reason. Algorithm 1 of the
paper, on any robot."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from .._core import MirrorPostureError
from ..arguments import checked_arguments
from ..robots.errors import NoLookError, RobotError
from ..robots.interruption import Interrupted, ending_signals
from ..robots.nominal import detect_look
from ..robots.protocol import CommandedRobot, Look
from .first_commands import CommandForPosture, first_commands
from .observation import Readings, read
from .options import CorrectOptions
from .outcome import LookReport, MarkerError, Outcome, Stop, doubt_in_words
from .recorder import Recorder
from .target import Target, make_target
from .turned import without_turned
from .viewpoints import Viewpoint, choose_viewpoints, go

RETURN_TO_BEST = ("stalled", "diverging", "budget_spent", "limit_reached")
"""After these the best posture that was seen is commanded; after lost or contradicting readings nothing is moved."""


@checked_arguments
def correct(
    robot: CommandedRobot,
    posture: Mapping[str, float],
    options: CorrectOptions | None = None,
    *,
    recorder: Recorder | None = None,
    command_for_posture: CommandForPosture | None = None,
    on_look: Callable[[LookReport], None] | None = None,
    on_picture: Callable[[Look, int], None] | None = None,
) -> Outcome:
    """Brings the robot's markers where the model has them at `posture` (rad by joint name; other joints at 0).

    `θ ← θ + λ J⁺ (p_ref − p_now)`: each look takes pictures from several viewpoints and measures the markers; the core
    decides. `recorder` writes everything while it runs, and hands back what an earlier run has written already.
    `command_for_posture` gives the first command (by default the posture itself), or way-points to it. `on_look(report)` is called after each
    look, `on_picture(look, number)` after each picture.

    Whatever ends it, the robot is not left in motion: Ctrl-C, `SIGTERM`, `SIGHUP` and errors of the robot bring it to rest and
    are stops with their evidence, not exceptions. Using the robot as a context, to rest and close it, is the caller's.

    Raises `MirrorPostureError` for invalid input: an unknown joint or marker, a target outside limits.
    """
    options = options or CorrectOptions()
    options.check()
    target = make_target(robot.nominal, posture, options)
    start, way = None, []
    if command_for_posture is not None:
        commands = first_commands(command_for_posture(target.posture), robot)
        way = [{**target.by_name(target.positions), **command} for command in commands]
        start = way.pop()
    run = _Run(robot, target, options, start, recorder, on_look, on_picture)
    run.way = way
    with ending_signals():
        try:
            return run.go()
        finally:
            if recorder is not None:
                recorder.close()


class _Run:
    """One correction under way."""

    def __init__(
        self,
        robot: CommandedRobot,
        target: Target,
        options: CorrectOptions,
        start: Mapping[str, float] | None,
        recorder: Recorder | None,
        on_look: Callable[[LookReport], None] | None,
        on_picture: Callable[[Look, int], None] | None,
    ) -> None:
        self.robot, self.target, self.options = robot, target, options
        self.corrector = target.corrector(options, start)
        self.recorder, self.on_look, self.on_picture = recorder, on_look, on_picture
        self.looks: list[Look] = []
        self.postures: list[int] = []
        self.posture = 0
        self.reports: list[LookReport] = []
        self.way: list[dict[str, float]] = []
        """Commands before the first look: a play is approached from the right side."""
        self._stop = Stop("interrupted", {"message": "before the first look"})
        movable = [
            n
            for n, free in zip(target.nominal.robot.position_names, self.corrector.free, strict=True)
            if free
        ]
        missing = [name for name in (*target.posture, *movable) if name not in robot.joint_names]
        if missing:
            raise MirrorPostureError(
                f"{robot.name}: cannot command {', '.join(sorted(set(missing)))}; hold them, or choose other markers; "
                f"it commands {', '.join(robot.joint_names)}"
            )
        self._check_limits(movable)
        self.viewpoints = choose_viewpoints(robot, target, options, recorder)
        self.turning = tuple(dict(pair for station in options.view_joints for pair in station))
        if recorder is not None and self.turning:
            recorder.keep_turning(self.turning)

    def _check_limits(self, movable: list[str]) -> None:
        """A robot may have narrower limits than its URDF: the core must know the same."""
        of_model = self.target.nominal.joint_limits
        for name in movable:
            own, model = self.robot.limits[name], of_model[name]
            if own.lower > model.lower or own.upper < model.upper:
                self.corrector.narrow(name, own.lower, own.upper)

    def go(self) -> Outcome:
        """Until a stop."""
        try:
            pending: tuple[Viewpoint, ...] | None = self._recorded()
            if not self.looks:
                for point in self.way:
                    self._command(point)
            while pending is not None:
                readings = self._look(pending)
                pending = self._decide(readings)
            stop = self._stop
            if stop.kind in RETURN_TO_BEST and self.corrector.best_command is not None:
                self._command(self.target.by_name(self.corrector.best_command))
        except (KeyboardInterrupt, Interrupted) as signal:
            stop = Stop("interrupted", self._at_rest({"message": str(signal) or "Ctrl-C"}))
        except RobotError as error:
            evidence = {"message": str(error), "error": type(error).__name__}
            stop = Stop("robot_failed", self._at_rest(evidence))
        except BaseException:
            # Unexpected exceptions propagate after the robot is stopped.
            self._at_rest({})
            raise
        outcome = self._outcome(stop)
        if self.recorder is not None:
            self.recorder.end(outcome)
        return outcome

    def _at_rest(self, evidence: dict[str, Any]) -> dict[str, Any]:
        """Brings the robot to rest; if that fails too, the evidence says so."""
        try:
            self.robot.rest()
            evidence["at_rest"] = True
        except RobotError as error:
            evidence |= {"at_rest": False, "rest_failed": str(error)}
        if (standing := getattr(self.robot, "standing", None)) is not None:
            # Robots of servos: what became of the torque, and why.
            evidence["standing"] = standing.sentence
        return evidence

    # What an earlier run has recorded.

    def _recorded(self) -> tuple[Viewpoint, ...] | None:
        """Replays what was recorded already; returns the viewpoints that are to be taken next."""
        pending: tuple[Viewpoint, ...] | None = self.viewpoints.of_look(0)
        if self.recorder is None:
            return pending
        past = self.recorder.past()
        self.looks, self.postures = list(past.looks), list(past.postures)
        for one in past.readings:
            self.posture = one.posture
            pending = self._decide(one.readings, recorded=True)
            if pending is None:
                return None
        # Pictures of an unfinished look stay recorded, under a separate posture, because the body may have
        # moved since.
        if past.postures:
            self.posture = max(self.posture, max(past.postures) + 1)
            pending = self.viewpoints.of_look(len(self.reports))
        return pending

    # One look.

    def _command(self, positions: Mapping[str, float]) -> None:
        wanted = {name: positions[name] for name in self.robot.joint_names if name in positions}
        self.robot.command(wanted)

    def _look(self, viewpoints: tuple[Viewpoint, ...]) -> Readings:
        """Takes the pictures of one look and measures; what could not be had is nothing measured, with its reason."""
        command = self.target.by_name(self.corrector.command)
        names = self.robot.joint_names
        body = {name: command[name] for name in names if name in command}
        for viewpoint in viewpoints:
            go(self.robot, viewpoint, body)
            try:
                look = self.robot.look()
            except NoLookError as error:
                return Readings.nothing(len(self.target.markers), str(error))
            self._keep(look)
            if look.marker_points is not None:
                break
        mine = [
            look for look, number in zip(self.looks, self.postures, strict=True) if number == self.posture
        ]
        if len(mine) < 2 and mine[-1].marker_points is None:
            raise MirrorPostureError(
                f"{self.robot.name}: cannot turn before its mirror, and one view gives no positions; give view_joints that turn "
                "the robot, or a robot that turns its view"
            )
        return read(self.target, self.looks, self.postures, self.options.measure)

    def _keep(self, look: Look) -> None:
        """Records a look before it is used, then its detections."""
        frame, nominal = None, self.target.nominal
        look = without_turned(nominal, self.turning, look)
        if self.recorder is not None:
            frame = self.recorder.capture(look, self.posture)
        seen = without_turned(nominal, self.turning, detect_look(nominal, look))
        if self.recorder is not None and frame is not None:
            self.recorder.detected(frame, seen)
        # Pictures are on disk; a long correction does not keep them in memory.
        self.looks.append(replace(seen, picture_bgr=None))
        self.postures.append(self.posture)
        if self.on_picture is not None:
            self.on_picture(seen, len(self.looks))

    # What follows.

    def _decide(self, readings: Readings, recorded: bool = False) -> tuple[Viewpoint, ...] | None:
        """Hands the readings to the core; the viewpoints of the next look, or None at the end."""
        command, posture = self.target.by_name(self.corrector.command), self.posture
        if self.recorder is not None and not recorded:
            self.recorder.measured(posture, readings)
        self.corrector.observe(
            readings.measured.tolist(),
            readings.point_in_board_m,
            readings.covariance_m2,
            readings.chi_squared,
            readings.degrees_of_freedom.tolist(),
        )
        record = json.loads(self.corrector.records())[-1]
        decision = record["decision"]
        kind = decision["do"]
        self.reports.append(self._report(record, readings, command, posture))
        if self.on_look is not None:
            self.on_look(self.reports[-1])
        if kind == "stop":
            evidence = decision["stop"]
            self._stop = Stop(evidence["kind"], {k: v for k, v in evidence.items() if k != "kind"})
            return None
        if kind == "look_again" and not decision["fresh"]:
            # The same posture from other viewpoints; if no others are proposed, the same views once more.
            return self.viewpoints.further or self.viewpoints.of_look(len(self.reports))
        self.posture += 1
        return self.viewpoints.of_look(len(self.reports))

    def _report(
        self, record: dict[str, Any], readings: Readings, command: Mapping[str, float], posture: int
    ) -> LookReport:
        decision = record["decision"]
        markers = tuple(
            MarkerError(
                marker=m["marker"],
                error_m=None if m["error_m"] is None else tuple(m["error_m"]),
                std_m=None if m["std_m"] is None else tuple(m["std_m"]),
                below_m=m["below_m"],
                doubt=doubt_in_words(m["implausible"]),
                reason=reason,
            )
            for m, reason in zip(record["markers"], readings.reasons, strict=True)
        )
        kind = decision["do"]
        why = decision["stop"]["kind"] if kind == "stop" else decision.get("why", "")
        return LookReport(
            look=record["look"],
            steps=record["steps"],
            posture=posture,
            views=self.postures.count(posture),
            command=command,
            markers=markers,
            rms_m=record["rms_m"],
            decision=kind,
            why=why,
            at_limit=tuple(decision.get("at_limit", ())),
        )

    def _outcome(self, stop: Stop) -> Outcome:
        points = self.corrector.target_in_board_m.tolist()
        last = self.target.by_name(self.corrector.command)
        best = self.corrector.best_command
        return Outcome(
            stop=stop,
            looks=tuple(self.reports),
            markers=self.target.markers,
            target_in_board_m={n: tuple(p) for n, p in zip(self.target.markers, points, strict=True)},
            target_posture=self.target.posture,
            command=last,
            best_command=last if stop.converged or best is None else self.target.by_name(best),
            responses=tuple(json.loads(self.corrector.responses())),
            views=len(self.looks),
        )
