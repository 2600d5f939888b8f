"""The report as one HTML file that needs no network."""

from __future__ import annotations

import re
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup, escape

from ..session import Session
from . import formatting
from .panel_plots import draw_field, draw_track
from .plots import Drawing, draw_gap, draw_signature
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


def write_report(session: Session, found: Diagnosis, folder: Path) -> Path:
    """Writes `report.html` and `pictures/*.png` into a folder that is there; returns the page."""
    drawings: dict[str, Drawing] = {"gap": draw_gap(found.gap), "robot": draw_robot(session, found)}
    panels = signature_panels(found)
    drawings |= {panel.name: panel.drawing for panel in panels}
    pictures = folder / "pictures"
    pictures.mkdir(exist_ok=True)
    for name, drawing in drawings.items():
        (pictures / f"{name}.png").write_bytes(drawing.png)
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    text = resources.files(__package__).joinpath(TEMPLATE).read_text(encoding="utf-8")
    page = environment.from_string(text).render(
        found=found,
        session=session.folder.resolve().name,
        robot=session.robot.name,
        postures=len(set(session.frames.posture.tolist())),
        frames=len(session.frames),
        headline=HEADLINES[found.verdict],
        svg={name: Markup(drawing.svg) for name, drawing in drawings.items()},
        told=formatting,
        panels=panels,
        code=_code,
        unexplained=any(place.depends_on for place in found.where),
        slipped=any(cause.effect == "pairing" for cause in found.causes),
        rivals=any(cause.alternatives for cause in found.causes),
        joints=sorted({joint for posture in found.next_postures for joint in posture}),
    )
    file = folder / "report.html"
    file.write_text(page, encoding="utf-8")
    return file


@dataclass(frozen=True)
class Panel:
    """A signature as the page shows it; `name` is that of its PNG."""

    name: str
    cause: int | None
    at: str
    caption: str
    drawing: Drawing


def signature_panels(found: Diagnosis) -> list[Panel]:
    """All signatures, as the causes stand; those of the unexplained part last, the largest share first."""
    panels = [
        Panel(f"signature-{k}", s.cause, s.at, "", draw_signature(s, k))
        for k, s in enumerate(found.signatures)
    ]
    panels += [
        Panel(f"track-{k}", t.cause, t.at, formatting.track_caption(t.at, t.what), draw_track(t, k))
        for k, t in enumerate(found.tracks)
        if len(t.frame)
    ]
    panels += [
        Panel(
            f"field-{k}",
            f.cause,
            f.at,
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


def _code(text: str) -> Markup:
    """Words between backticks as code, the rest escaped."""
    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(text))))
