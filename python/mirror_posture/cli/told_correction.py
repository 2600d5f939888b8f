"""A correction in the terminal: one row for each look while it runs, and the result."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..counted import counted
from .output import Output, made_table

if TYPE_CHECKING:
    from rich.table import Table

    from ..correct import LookReport, Outcome

MILLIMETRES = 1000.0


@contextmanager
def progress_of_looks(
    output: Output,
) -> Iterator[tuple[Callable[[str], object], Callable[[LookReport], None], Callable[[object, int], None]]]:
    """A table that grows by a row a look on a terminal, else a line a look."""
    from rich.live import Live

    reports: list[LookReport] = []
    if output.messages.is_terminal and not output.as_json:
        with Live(console=output.messages, auto_refresh=False) as live:

            def on_look(report: LookReport) -> None:
                reports.append(report)
                live.update(_table(reports), refresh=True)

            def on_picture(look: object, number: int) -> None:
                live.update(_table(reports, counted(number, "picture")), refresh=True)

            yield live.console.print, on_look, on_picture
            if reports:
                live.update(_table(reports), refresh=True)
        return

    def line(report: LookReport) -> None:
        markers = "  ".join(f"{m.marker} {_cell(m)}" for m in report.markers)
        output.errors.print(f"look {report.look}: {markers}: {_next(report)}", markup=False)

    yield output.errors.print, line, lambda look, number: None


def _table(reports: list[LookReport], caption: str = "") -> Table:
    markers = reports[-1].markers if reports else ()
    return made_table(
        "Distance from the target, mm (± one standard deviation of its length)",
        ("look", "steps", "pictures", *(marker.marker for marker in markers), "~then"),
        [
            (str(one.look), str(one.steps), str(one.views), *map(_cell, one.markers), _next(one))
            for one in reports
        ],
        caption,
    )


def _cell(marker: Any) -> str:
    if marker.distance_m is None:
        return "not seen"
    spread = math.sqrt(sum(x * x for x in marker.std_m))
    text = f"{MILLIMETRES * marker.distance_m:.2f} ± {MILLIMETRES * spread:.2f}"
    return f"{text} (not believed)" if marker.doubt else text


def _next(report: LookReport) -> str:
    if report.decision == "step":
        return "step" + (f", {', '.join(report.at_limit)} at its limit" if report.at_limit else "")
    if report.decision == "look_again":
        return f"look again ({report.why.replace('_', ' ')})"
    return report.why.replace("_", " ")


def tell_outcome(output: Output, outcome: Outcome, sliding: set[str], written: list[Path]) -> None:
    """What came of a correction; `sliding` are the prismatic joints."""
    output.say(outcome.stop.sentence, style="green" if outcome.converged else "yellow")
    for look in outcome.looks:
        for marker in look.markers:
            if marker.doubt is not None:
                output.warn(f"look {look.look}, {marker.marker}: {marker.doubt}")
            elif marker.error_m is None and marker.reason is not None:
                output.warn(f"look {look.look}, {marker.marker}: {marker.reason}")
    data = outcome.data
    output.say(
        f"used: {data['looks_used']} of {data['looks_given']} looks, {data['pictures_used']} of {data['pictures_given']} pictures, "
        f"{data['points_used']} of {data['points_given']} readings of markers"
    )
    rows = []
    for name, value in outcome.best_command.items():
        was = outcome.target_posture.get(name, 0.0)
        if name in outcome.target_posture or value != was:
            unit, factor = ("mm", MILLIMETRES) if name in sliding else ("°", math.degrees(1.0))
            response = next((r for r in outcome.responses if r["joint"] == name), None)
            shown = "" if response is None else f"{response['response']:.2f} ± {response['std']:.2f}"
            numbers = (
                f"{x * factor:{sign}.3f} {unit}" for x, sign in ((was, ""), (value, ""), (value - was, "+"))
            )
            rows.append((name, *numbers, shown))
    output.table(
        "Commands",
        ("*joint", "target", "commanded", "correction", "did of what it was told"),
        rows,
    )
    for file in written:
        output.say(f"written: {file}")


def sliding_joints(out: Path) -> set[str]:
    """The prismatic joints of the recorded robot: theirs are metres."""
    from ..robots import Nominal

    return {joint.name for joint in Nominal.load(out).robot.joints if joint.kind == "prismatic"}
