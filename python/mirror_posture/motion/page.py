"""The report of a diagnosed motion as one HTML file that needs no network: the staircase first."""

from __future__ import annotations

import base64
from importlib import resources
from pathlib import Path

from jinja2 import Environment, StrictUndefined

from ..diagnosis import formatting, limits
from ..diagnosis.page import HEADLINES
from .diagnose import MotionDiagnosis
from .patched import patched_model
from .pictures import pictures

TEMPLATE = "motion.html.j2"
MODEL = "model.xml"


def write_motion_report(done: MotionDiagnosis, folder: Path) -> Path:
    """Writes `report.html`, `pictures/*.png` and the patched `model.xml` into a folder that is there; returns the page."""
    drawings = pictures(done)
    (folder / "pictures").mkdir(exist_ok=True)
    for name, drawing in drawings.items():
        (folder / "pictures" / f"{name}.png").write_bytes(drawing.png)
    (folder / MODEL).write_text(
        patched_model(done.problem.rollouts, done.found.best.causes), encoding="utf-8"
    )
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    text = resources.files(__package__).joinpath(TEMPLATE).read_text(encoding="utf-8")
    session = done.problem.session
    page = environment.from_string(text).render(
        found=done.diagnosis,
        session=session.folder.resolve().name,
        robot=session.robot.name,
        motion=done.diagnosis.document["motion"],
        headline=HEADLINES[done.diagnosis.verdict],
        told=formatting,
        limits=limits.table(done.diagnosis),
        pictures=[
            (name.partition("-")[2], base64.b64encode(drawing.png).decode("ascii"))
            for name, drawing in drawings.items()
        ],
    )
    file = folder / "report.html"
    file.write_text(page, encoding="utf-8")
    return file
