"""A diagnosis in the terminal, and the files to which it is written."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ..counted import counted
from .output import Output

if TYPE_CHECKING:
    from ..diagnosis import Diagnosis
    from ..session import Session

NEXT_POSTURES = "next-postures.csv"
OWN_FILES = ("diagnosis.json", "report.html", "pictures", NEXT_POSTURES)
"""What --out writes: of an earlier run in the same folder nothing of it stays."""


def write_results(output: Output, session: Session, found: Diagnosis, folder: Path) -> None:
    """Writes diagnosis.json, the report with its pictures and the next postures into a folder, and prints
    their paths."""
    from ..diagnosis.next_postures import write_next_postures
    from ..diagnosis.page import write_report
    from ..output_files import new_folder

    with new_folder(folder, OWN_FILES) as part:
        (part / "diagnosis.json").write_text(found.to_json(), encoding="utf-8")
        write_report(session, found, part)
        if found.next_postures:
            write_next_postures(found, part / NEXT_POSTURES)
    if count := len(found.next_postures):
        output.say(
            f"written: {folder / NEXT_POSTURES}, {counted(count, 'posture')} that would separate the alternatives"
        )
    output.say(f"written: {folder / 'diagnosis.json'}, {folder / 'report.html'}, {folder / 'pictures'}")


def show_diagnosis(output: Output, folder: Path, found: Diagnosis) -> None:
    """Tables for people; for a program only the warnings."""
    if output.as_json:
        for warning in found.warnings:
            output.warn(warning)
        return
    from ..diagnosis.formatting import (
        ENCODER_COLUMNS,
        dependence,
        effect_in_words,
        ground_words,
        left_out_words,
        millimetres,
        numbers_in_words,
        percent,
        place_in_words,
        steps,
        tell_all,
        telling_encoders,
    )
    from ..diagnosis.limits import line as limits_line
    from ..diagnosis.next_step import next_step

    output.say(f"{folder}: {found.sentence}", style="bold")
    if found.causes:
        rows = [
            (
                effect_in_words(cause.effect),
                place_in_words(cause.at),
                percent(cause.probability),
                "\n".join(map(str, tell_all(cause)))
                + (f"\nframes {numbers_in_words(cause.frames)}" if cause.frames else ""),
                "\n".join(
                    f"{effect_in_words(a.effect)} at {place_in_words(a.at)} ({percent(a.probability)})"
                    for a in cause.alternatives
                ),
            )
            for cause in found.causes
        ]
        output.table(
            "Causes, the one that closes most of the gap first",
            ("*effect", "~at", "probability", "~parameters ± one std", "~alternatives"),
            rows,
        )
    gap = found.gap
    closed = ""
    if gap.closed is not None:
        closed = f"closed {percent(gap.closed)}"
        if gap.closed_ci95 is not None:
            closed += f" (95 %: {percent(gap.closed_ci95[0])} to {percent(gap.closed_ci95[1])})"
    if steps(found):
        closed += f"{'; ' if closed else ''}as the causes are added one by one: {steps(found)}"
    gaps: list[tuple[str, ...]] = [
        (
            "held-out postures of this session",
            millimetres(gap.before_m),
            millimetres(gap.after_m),
            millimetres(gap.noise_floor_m),
        )
    ]
    if (anew := gap.chosen_anew) is not None and anew.changed:
        gaps.append(("… with causes selected without them", "", millimetres(anew.rms_m), ""))
    for c in gap.checked:
        gaps.append((c.session, millimetres(c.before_m), millimetres(c.after_m), ""))
        if c.ground is not None:
            gaps.append(("… on its own ground", "", millimetres(c.ground.after_m), ""))
            closed += f"{'; ' if closed else ''}{c.session}: {ground_words(c.ground)}"
        if c.left_out is not None:
            closed += f"{'; ' if closed else ''}{c.session}: {left_out_words(c.left_out)}"
    gaps += [
        (f"marker {w.marker}, withheld", millimetres(w.before_m), millimetres(w.after_m), "")
        for w in found.witness
    ]
    for w in found.witness:
        if w.left_out is not None:
            closed += f"{'; ' if closed else ''}marker {w.marker}: {left_out_words(w.left_out)}"
    output.table(
        "Gap between prediction and observation, RMS, mm",
        ("~on", "before", "after", "noise floor"),
        gaps,
        caption=closed,
    )
    if found.data.left_out:
        reasons: dict[str, list[int]] = {}
        for left in found.data.left_out:
            reasons.setdefault(left.why, []).append(left.frame)
        output.table(
            f"Left out; used: {found.data.points_used} of {found.data.points_given} observations of markers",
            ("~why", "observations", "frames"),
            [
                (
                    why,
                    str(len(frames)),
                    f"{min(frames)}" if len(set(frames)) == 1 else f"{min(frames)} to {max(frames)}",
                )
                for why, frames in reasons.items()
            ],
            caption="each of them is in diagnosis.json",
        )
    read = found.document.get("encoder_witness", ())
    encoders = telling_encoders(read)
    if encoders:
        output.table(
            "Encoders that took no part in the fit: RMS of reading minus prediction, mrad (a prismatic joint: mm)",
            ("*joint", "before", "after", "before, zero free", "after, zero free"),
            [(e["joint"], *(f"{1e3 * e[key]:.2f}" for key in ENCODER_COLUMNS)) for e in encoders],
            caption=f"{counted(len(read) - len(encoders), 'other reads', 'others read')} what is predicted"
            if len(encoders) < len(read)
            else "",
        )
    accelerometers = found.document.get("accelerometer_witness", ())
    if accelerometers:
        columns = ("before_rad", "after_rad", "before_mount_free_rad", "after_mount_free_rad")
        output.table(
            "Accelerometers that took no part in the fit: RMS angle between reading and prediction, mrad",
            ("*link", "frames", "before", "after", "before, mount free", "after, mount free"),
            [
                (
                    a["link"],
                    str(a["frames"]),
                    *("" if a[key] is None else f"{1e3 * a[key]:.2f}" for key in columns),
                )
                for a in accelerometers
            ],
        )
    if limits_line(found):
        output.say(limits_line(found))
    for place in found.where:
        if place.depends_on:
            share = percent(place.share) if place.share >= 0.005 else "less than 1 %"
            output.say(
                f"unexplained at {place.at} ({share} of the gap): depends on {dependence(place.depends_on)}"
            )
    for warning in found.warnings:
        output.warn(warning)
    output.say(f"next: {next_step(found)}")
