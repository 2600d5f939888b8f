"""The report as one HTML file that needs no network."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from .._core import __version__
from ..counted import counted
from ..pages import Drawing, inline, render
from ..session import Session
from . import actions, formatting, limits
from .limits import draw_limits
from .next_step import frames_left_out, next_step, shows_in_picture_only
from .panel_plots import draw_field, draw_track
from .parts import Gap
from .plots import draw_gap, draw_signature, draw_steps, gap_told
from .result import Diagnosis
from .skeleton import draw_robot

TEMPLATE = "report.html.j2"
HEADLINES = {
    "insufficient": "Too little evidence",
    "none": "No gap",
    "explained": "Explained",
    "partial": "Partly explained",
    "unknown": "Not explained",
}
LARGEST_PICTURES = 2_200_000
"""Largest number of characters of SVG on the page; what does not fit (a large session's last signatures) is
in pictures/ only."""
RANKED = 40
"""Single causes that the page lists at most."""


def write_report(session: Session, found: Diagnosis, folder: Path) -> Path:
    """Writes `report.html` and `pictures/*.png` into a folder that is there; returns the page."""
    drawings: dict[str, Drawing] = {"gap": draw_gap(found.gap), "robot": draw_robot(session, found)}
    if len(found.gap.steps) > 2:
        drawings["steps"] = draw_steps(found.gap)
    if found.limits:
        drawings["limits"] = draw_limits(session, found)
    panels = signature_panels(found, session.frames.time_s is not None)
    pictures = folder / "pictures"
    pictures.mkdir(exist_ok=True)
    for name, drawing in (drawings | {panel.name: panel.drawing for panel in panels}).items():
        (pictures / f"{name}.png").write_bytes(drawing.png)
    shown = _that_fit(panels)
    svg = {
        "gap": inline(drawings["gap"], _gap_in_words(found.gap)),
        "robot": inline(drawings["robot"], _robot_in_words(session, found)),
        **{panel.name: inline(panel.drawing, panel.says) for panel in shown},
    }
    if "steps" in drawings:
        svg["steps"] = inline(drawings["steps"], f"Bars: the gap step by step: {formatting.steps(found)}.")
    if "limits" in drawings:
        svg["limits"] = inline(
            drawings["limits"], f"The robot, its places coloured by what is hidden: {limits.line(found)}"
        )
    # The model is right, and much of some frames was left out.
    incomplete = found.verdict == "none" and bool(frames_left_out(found))
    unsure = shows_in_picture_only(found)
    headline = HEADLINES[found.verdict]
    if incomplete:
        headline = "No gap where it could be compared"
    elif unsure:
        headline = "No cause is named"
    values = {
        "limits": limits.table(found),
        "version": __version__,
        "found": found,
        "session": session.folder.resolve().name,
        "robot": session.robot.name,
        "postures": len(set(session.frames.posture.tolist())),
        "frames": len(session.frames),
        "headline": headline,
        "colour": "partial" if incomplete or unsure else found.verdict,
        "incomplete": incomplete,
        "unsure": unsure,
        "svg": svg,
        "told": formatting,
        "counted": counted,
        "next_step": next_step,
        "acts": actions,
        "concerned": actions.concerned(found),
        "panels": shown,
        "panels_left": len(panels) - len(shown),
        # Rows that would show 0 % are left out.
        "where": [p for p in found.where if p.share >= actions.SHOWN or p.depends_on],
        "unexplained": any(place.depends_on for place in found.where),
        "slipped": any(cause.effect == "pairing" for cause in found.causes),
        "rivals": [(c, a) for c in found.causes for a in c.alternatives if a.probability >= actions.SHOWN],
        "joints": sorted({j for p in found.next_postures for j, q in p.items() if abs(q) >= 5e-4}),
        "ranking": [r for r in found.ranking if r.log_bayes > 0.0][:RANKED],
    }
    file = folder / "report.html"
    file.write_text(render(__package__, TEMPLATE, values), encoding="utf-8")
    return file


def _gap_in_words(gap: Gap) -> str:
    sizes, unit, label = gap_told(gap)
    if not sizes:
        return "No gap can be computed: there is nothing to compare."
    before, after, floor = sizes
    return f"Bars: {label}: {before:.2f} before, {after:.2f} after, {floor:.2f} of noise ({unit})."


def _robot_in_words(session: Session, found: Diagnosis) -> str:
    places = formatting.listed(
        [f"{i}, {formatting.place_with_article(c.at)}" for i, c in enumerate(found.causes, 1)] or ["none"]
    )
    return f"The robot {session.robot.name} as a stick figure, from the front and from its left; marked places: {places}."


@dataclass(frozen=True)
class Panel:
    """A signature as the page shows it; `name` is that of its PNG."""

    name: str
    cause: int | None
    at: str
    title: str
    caption: str
    drawing: Drawing

    @property
    def says(self) -> str:
        """The description of the picture, for readers who cannot see it."""
        return f"{self.title}. {self.caption or 'The error against position, load, direction of motion and time; points: each posture separately; line: the law of the cause.'}"


def signature_panels(found: Diagnosis, timed: bool) -> list[Panel]:
    """All signatures, in the order of the causes; those of the unexplained part last, the largest share
    first. Not `timed`: their rows are counted."""

    def title(cause: int | None, at: str) -> str:
        place = formatting.place_with_article(at)
        if cause is None:
            return f"The unexplained part, at {place}"
        return f"{cause + 1}. {formatting.effect_in_words(found.causes[cause].effect)} at {place}"

    panels = [
        Panel(f"signature-{k}", s.cause, s.at, title(s.cause, s.at), "", draw_signature(s, k, timed))
        for k, s in enumerate(found.signatures)
    ]
    panels += [
        Panel(
            f"track-{k}",
            t.cause,
            t.at,
            title(t.cause, t.at),
            formatting.track_caption(t.at, t.what, len(t.components)),
            draw_track(t, k, timed),
        )
        for k, t in enumerate(found.tracks)
        if len(t.frame)
    ]
    panels += [
        Panel(
            f"field-{k}",
            f.cause,
            f.at,
            title(f.cause, f.at),
            formatting.field_caption(f.over, f.with_cause is not None),
            draw_field(f, k),
        )
        for k, f in enumerate(found.fields)
        if len(f.at_points)
    ]
    places = [place.at for place in found.where]

    def rank(panel: Panel) -> tuple[int, int]:
        if panel.cause is not None:
            return panel.cause, 0
        return len(found.causes), places.index(panel.at) if panel.at in places else len(places)

    return sorted(panels, key=rank)


def _that_fit(panels: list[Panel]) -> list[Panel]:
    """The first panels, as many as the page may hold."""
    room, shown = LARGEST_PICTURES, []
    for panel in panels:
        room -= len(panel.drawing.svg)
        if room < 0:
            break
        shown.append(panel)
    return shown
