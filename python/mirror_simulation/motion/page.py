"""The report of a diagnosed motion as one HTML file that needs no network: who must act, then the staircase."""

from __future__ import annotations

import base64
from dataclasses import replace
from pathlib import Path

from mirror_posture import __version__
from mirror_posture.diagnosis import actions, formatting, limits
from mirror_posture.diagnosis.actions import Concerned, concerned
from mirror_posture.diagnosis.next_postures import write_next_postures
from mirror_posture.diagnosis.page import HEADLINES
from mirror_posture.diagnosis.result import Diagnosis
from mirror_posture.file_names import file_name_of
from mirror_posture.pages import inline, render

from .diagnose import MotionDiagnosis
from .patched import patched_model
from .pictures import joint_pictures, staircase
from .words import REMEDIES

TEMPLATE = "motion.html.j2"
MODEL = "model.xml"
NEXT_POSTURES = "next-postures.csv"


def write_motion_report(done: MotionDiagnosis, folder: Path) -> Path:
    """Writes `report.html`, `pictures/*.png`, the patched `model.xml` and, if there are moves,
    `next-postures.csv`; returns the page."""
    steps, joints = staircase(done), joint_pictures(done)
    (folder / "pictures").mkdir(exist_ok=True)
    files = {"staircase": steps} | {f"joint-{file_name_of(joint)}": drawn for joint, drawn in joints.items()}
    for name, drawing in files.items():
        (folder / "pictures" / f"{name}.png").write_bytes(drawing.png)
    (folder / MODEL).write_text(
        patched_model(done.problem.rollouts, done.found.best.causes), encoding="utf-8"
    )
    session, found = done.problem.session, done.diagnosis
    if found.next_postures:
        write_next_postures(found, folder / NEXT_POSTURES)
    values = {
        "version": __version__,
        "found": found,
        "session": session.folder.resolve().name,
        "robot": session.robot.name,
        "motion": found.document["motion"],
        "headline": HEADLINES[found.verdict],
        "told": formatting,
        "acts": actions,
        "concerned": _who_must_act(found),
        "limits": limits.table(found),
        "staircase": inline(steps, _steps_in_words(found)),
        # Each of its lines has a point a picture: as SVG they would be megabytes.
        "joints": [
            (joint, base64.b64encode(drawing.png).decode("ascii")) for joint, drawing in joints.items()
        ],
    }
    file = folder / "report.html"
    file.write_text(render(__package__, TEMPLATE, values), encoding="utf-8")
    return file


def _who_must_act(found: Diagnosis) -> list[Concerned]:
    """As of still sessions, with the remedies of a motion's own effects."""
    return [
        replace(
            group,
            actions=tuple(
                replace(action, do=REMEDIES.get(found.causes[action.number - 1].effect, action.do))
                for action in group.actions
            ),
        )
        for group in concerned(found)
    ]


def _steps_in_words(found: Diagnosis) -> str:
    steps = found.document["gap"]["steps"]
    told = "; ".join(f"{step['added'] or 'the model as it is'}: {step['rms_px']:.2f} px" for step in steps)
    return f"Bars: the gap of simulator against motion as causes are added: {told}."
