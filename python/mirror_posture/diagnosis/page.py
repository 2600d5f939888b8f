"""The report as one HTML file that needs no network."""

from __future__ import annotations

import re
from importlib import resources
from pathlib import Path

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup, escape

from ..session import Session
from . import people
from .plots import Drawing, draw_gap, draw_signature
from .result import Diagnosis
from .skeleton import draw_robot

TEMPLATE = "report.html.j2"
HEADLINES = {
    "none": "No gap",
    "explained": "Explained",
    "partial": "Partly explained",
    "unknown": "Not explained",
}


def write_report(session: Session, found: Diagnosis, folder: Path) -> Path:
    """Writes `report.html` and `pictures/*.png` into a folder that is there; returns the page."""
    drawings: dict[str, Drawing] = {"gap": draw_gap(found.gap), "robot": draw_robot(session, found)}
    for index, signature in enumerate(found.signatures):
        drawings[f"signature-{index}"] = draw_signature(signature)
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
        told=people,
        code=_code,
        unexplained=any(place.depends_on for place in found.where),
        rivals=any(cause.alternatives for cause in found.causes),
        joints=sorted({joint for posture in found.next_postures for joint in posture}),
    )
    file = folder / "report.html"
    file.write_text(page, encoding="utf-8")
    return file


def _code(text: str) -> Markup:
    """Words between backticks as code, the rest escaped."""
    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(text))))
