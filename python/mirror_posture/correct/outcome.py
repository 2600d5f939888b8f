"""The outcome of a correction: the stop reason with its evidence, each look, the commands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from ..counted import counted

StopKind = Literal[
    "converged",
    "stalled",
    "diverging",
    "marker_lost",
    "inconsistent",
    "limit_reached",
    "budget_spent",
    "interrupted",
    "robot_failed",
]
DecisionKind = Literal["step", "look_again", "stop"]
MILLIMETRES = 1000.0


@dataclass(frozen=True)
class Stop:
    """Why a correction ended."""

    kind: StopKind
    evidence: Mapping[str, Any]
    """The numbers behind it, as the core's struct of that name holds them (m, rad)."""

    @property
    def converged(self) -> bool:
        """Whether every marker is within the tolerance of its target, the measurement's uncertainty counted."""
        return self.kind == "converged"

    @property
    def sentence(self) -> str:
        """The reason in words, with its numbers."""
        return _SENTENCES[self.kind](self.evidence)


@dataclass(frozen=True)
class MarkerError:
    """A marker at one look; errors are target minus measured in the board's frame."""

    marker: str
    error_m: tuple[float, float, float] | None
    """None where it was not measured."""
    std_m: tuple[float, float, float] | None
    below_m: float | None
    """Upper bound of the true distance, at the stated probability."""
    doubt: str | None
    """Why the reading was rejected; None where it was accepted."""
    reason: str | None = None
    """Why it was not measured."""

    @property
    def distance_m(self) -> float | None:
        """Distance from the target; None where it was not measured."""
        return None if self.error_m is None else sum(x * x for x in self.error_m) ** 0.5


@dataclass(frozen=True)
class LookReport:
    """One look and the decision."""

    look: int
    """From 1."""
    steps: int
    """Steps commanded before it."""
    posture: int
    """Its number in the recorded session."""
    views: int
    """How many pictures it rests on."""
    command: Mapping[str, float]
    """Joint positions at which it was taken, rad (m)."""
    markers: tuple[MarkerError, ...]
    rms_m: float | None
    """Root mean square distance of all markers; None where the look was rejected."""
    decision: DecisionKind
    why: str
    """For a further look: why; for a stop: its kind."""
    at_limit: tuple[str, ...] = ()
    """Joints that a limit stopped in the step that follows."""


@dataclass(frozen=True)
class Outcome:
    """A correction that has ended."""

    stop: Stop
    looks: tuple[LookReport, ...]
    markers: tuple[str, ...]
    target_in_board_m: Mapping[str, tuple[float, float, float]]
    target_posture: Mapping[str, float]
    """What was to be reached, joint positions, rad (m)."""
    command: Mapping[str, float]
    """The last command, rad (m)."""
    best_command: Mapping[str, float]
    """The command with the smallest measured error; the last one where it converged."""
    responses: tuple[Mapping[str, Any], ...] = field(default=())
    """How far each joint followed its commands: `joint`, `response`, `std`, `commanded_rad`, `stuck`."""
    views: int = 0
    """How many pictures or measurements were taken in all."""

    @property
    def converged(self) -> bool:
        """Whether every marker is within the tolerance of its target."""
        return self.stop.converged

    @property
    def data(self) -> dict[str, Any]:
        """Counts of looks, pictures (or measurements of a tracker) and readings of markers, given and used;
        what was left out, and why.

        Pictures of a look that ended before it was measured (Ctrl-C, a robot that failed) are given and not
        used.
        """
        left_out = [
            {
                "look": look.look,
                "target": marker.marker,
                "why": marker.doubt or marker.reason or "not measured",
            }
            for look in self.looks
            for marker in look.markers
            if marker.doubt is not None or marker.error_m is None
        ]
        readings = sum(len(look.markers) for look in self.looks)
        believed = [look for look in self.looks if look.rms_m is not None]
        # A further look at a posture rests on the pictures of the looks before it too.
        used = {look.posture: look.views for look in believed}
        return {
            "looks_given": len(self.looks),
            "looks_used": len(believed),
            "pictures_given": self.views,
            "pictures_used": sum(used.values()),
            "points_given": readings,
            "points_used": readings - len(left_out),
            "left_out": left_out,
        }


def doubt_in_words(implausible: Mapping[str, Any] | None) -> str | None:
    """Why a reading was rejected, with its numbers."""
    if implausible is None:
        return None
    surprise = implausible["surprise"]
    if surprise["kind"] == "rays_do_not_meet":
        return (
            f"the rays of its views do not meet (chi-squared {surprise['chi_squared']:.0f} for {surprise['degrees_of_freedom']}): "
            "something moved between the views, or one shows another thing"
        )
    distance, allowed = _mm(surprise["distance_m"]), _mm(surprise["allowed_m"])
    if surprise["kind"] == "far_from_model":
        return f"{distance} from where the model has it, more than the {allowed} that are believed"
    return (
        f"{distance} from where the step of {_mm(surprise['commanded_m'])} should have put it, more than the {allowed} "
        "that step, noise and play explain"
    )


def _mm(value_m: float) -> str:
    return f"{value_m * MILLIMETRES:.2f} mm"


def _list_mm(values_m: list[float]) -> str:
    *others, last = (f"{value * MILLIMETRES:.2f}" for value in values_m)
    return (f"{', '.join(others)} and " if others else "") + f"{last} mm"


def _converged(e: Mapping[str, Any]) -> str:
    return (
        f"converged: every marker is within {_mm(e['tolerance_m'])} of its target (measured {_list_mm(e['distance_m'])} away, at most "
        f"{_list_mm(e['below_m'])} with the measurement's uncertainty); wrong in at most {100 * e['wrong_converged']:g} % of corrections"
    )


def _stalled(e: Mapping[str, Any]) -> str:
    stuck = [r["joint"] for r in e["responses"] if r["stuck"]]
    causes = {
        "no_progress": "the error no longer falls, though the model says that it should",
        "not_following": f"{', '.join(stuck)} does not follow its commands",
        "out_of_reach": f"no posture of the free joints puts all markers on their targets; {_list_mm(e['left_m'])} are left at best",
        "too_uncertain": f"the error is within the measurement's noise, which reaches to {_list_mm(e['below_m'])}; take more or wider views",
    }
    return f"stalled at {_list_mm(e['distance_m'])} from the target{'s' if len(e['distance_m']) > 1 else ''}: {causes[e['cause']]}"


def _diverging(e: Mapping[str, Any]) -> str:
    return f"diverging: {_mm(e['error_m'])} now, {_mm(e['best_error_m'])} at look {e['best_look']}; use a smaller gain"


def _lost(e: Mapping[str, Any]) -> str:
    return f"marker lost: {', '.join(e['markers'])} not measured in {counted(e['looks'], 'look')} in a row"


def _inconsistent(e: Mapping[str, Any]) -> str:
    readings = "; ".join(f"{r['marker']}: {doubt_in_words(r)}" for r in e["readings"])
    return f"inconsistent readings in {counted(e['looks'], 'look')} in a row, not acted upon: {readings}"


def _limit(e: Mapping[str, Any]) -> str:
    joints = ", ".join(
        f"{hit['joint']} at {hit['limit_rad']:.4f} rad (needed {hit['wanted_rad']:.4f}"
        f"{'' if hit['of_model'] else '; the largest correction, not the joint'})"
        for hit in e["joints"]
    )
    return f"limit reached: {joints}; {_list_mm(e['left_m'])} are left within the limits"


def _budget(e: Mapping[str, Any]) -> str:
    left = f"{_list_mm(e['distance_m'])} are left" if e["distance_m"] else "none was accepted"
    return f"budget spent: {counted(e['looks'], 'look')}; {left}"


def _interrupted(e: Mapping[str, Any]) -> str:
    rest = (
        "the robot was brought to rest"
        if e.get("at_rest", True)
        else f"at rest it is not: {e['rest_failed']}"
    )
    return f"interrupted: {e.get('message') or 'Ctrl-C'}; everything captured is written, {rest}"


def _failed(e: Mapping[str, Any]) -> str:
    return f"the robot failed: {e['message']}"


_SENTENCES = {
    "converged": _converged,
    "stalled": _stalled,
    "diverging": _diverging,
    "marker_lost": _lost,
    "inconsistent": _inconsistent,
    "limit_reached": _limit,
    "budget_spent": _budget,
    "interrupted": _interrupted,
    "robot_failed": _failed,
}
