"""A diagnosis as a recording for the Rerun viewer: the robot posture by posture, its markers before and after, residuals.

Needs the extra `rerun`. The recording is a file; `rerun FILE.rrd` shows it.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._core import MirrorPostureError
from ..pages.drawing import AFTER, BEFORE, FREE
from ..session import Session
from .result import Diagnosis
from .skeleton import CAUSE_COLOURS, guilty

if TYPE_CHECKING:
    from .parts import SeenMarker

MEASURED, BODY, JOINTS, POINTS = "#2f7f4f", "#777777", "#333333", "#9a9a9a"
MARKER_RADIUS_M = 0.004
BODY_RADIUS_M = 0.002
TIMELINE = "frame"
ARROW_FACTOR = 100.0
"""Residuals over the picture are drawn this many times longer, so that tenths of a pixel are visible."""


def write_recording(session: Session, found: Diagnosis, file: Path) -> Path:
    """Writes the recording; `found` must have been diagnosed with `markers=True`. Everything is in the root link's frame, m.

    | entity | what |
    | --- | --- |
    | `robot/links`, `robot/joints`, `robot/guilty` | the nominal model at the commanded posture; places of causes |
    | `markers/measured`, `/before`, `/after` | as seen, by the nominal model, by the model with the causes |
    | `markers/error_before`, `/error_after` | arrows from the prediction to what was seen |
    | `residual/MARKER/before_mm`, `/after_mm` | their lengths, as series over the frames |
    | `signature/PLACE/error_UNIT`, `/fitted_UNIT` | what each posture shows at a joint, and what the cause says; rad or m |
    | `signature/PLACE/WHAT/COMPONENT/error_UNIT`, … | the same of a marker, a link, an axis, the camera; `ratio` of a focal length |
    | `field/PLACE/without_px`, `/with_px` | mean residuals over the picture, as arrows that are drawn longer; corners over a board: `_m`, in space |

    Timelines are `frame` and, where the session has times, `time`.

    Raises:
        MirrorPostureError: the extra `rerun` is not installed; a diagnosis without its markers.
    """
    try:
        import rerun as rr  # type: ignore[import-not-found,import-untyped,unused-ignore]
    except ImportError:
        raise MirrorPostureError(
            "a recording needs Rerun's SDK, which is not installed: pip install 'mirror-posture[rerun]'"
        ) from None
    if not found.markers:
        raise MirrorPostureError(
            "got a diagnosis without its markers, needed one of `diagnose(…, markers=True)`"
        )
    recording: Any = rr.RecordingStream("mirror-posture diagnosis", recording_id=session.folder.name or None)
    recording.save(file)
    # The time of writing this file is not data of the robot.
    recording.set_log_time_enabled(False)
    recording.send_blueprint(_layout(found))
    recording.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    recording.log("verdict", rr.TextDocument(found.sentence), static=True)
    _log_postures(rr, recording, session, found)
    _log_signatures(rr, recording, session, found)
    _log_fields(rr, recording, found)
    recording.flush()
    recording.disconnect()
    return file


def _log_postures(rr: Any, recording: Any, session: Session, found: Diagnosis) -> None:
    robot = session.robot
    row = {int(number): index for index, number in enumerate(session.frames.frame)}
    by_frame: dict[int, list[SeenMarker]] = {}
    for entry in found.markers:
        by_frame.setdefault(entry.frame, []).append(entry)
    rows = [row[number] for number in by_frame]
    poses = robot.forward_kinematics(session.positions[rows])
    root = np.linalg.inv(poses[:, robot.link_index(session.root_link)])
    places = np.einsum("nij,nlj->nli", root, poses[:, :, :, 3])[:, :, :3]
    links = [(robot.link_index(j.parent_link), robot.link_index(j.child_link)) for j in robot.joints]
    moving = [robot.link_index(j.child_link) for j in robot.joints if j.kind != "fixed"]
    marked = [entry for entry in guilty(session, found) if entry[0] in robot.link_names]
    for name, colour in (("before", BEFORE), ("after", AFTER)):
        for marker in session.marker_names:
            style = rr.SeriesLines(colors=[_rgb(colour)], names=[f"{marker} {name}"])
            recording.log(f"residual/{rr.escape_entity_path_part(marker)}/{name}_mm", style, static=True)
    for at, (number, entries) in zip(places, by_frame.items(), strict=True):
        recording.set_time(TIMELINE, sequence=number)
        if session.frames.time_s is not None:
            recording.set_time("time", duration=float(session.frames.time_s[row[number]]))
        strips = [np.array([at[a], at[b]]) for a, b in links]
        recording.log("robot/links", rr.LineStrips3D(strips, colors=[_rgb(BODY)], radii=BODY_RADIUS_M))
        recording.log(
            "robot/joints", rr.Points3D(at[moving], colors=[_rgb(JOINTS)], radii=1.5 * BODY_RADIUS_M)
        )
        if marked:
            recording.log(
                "robot/guilty",
                rr.Points3D(
                    [at[robot.link_index(link)] for link, _, _ in marked],
                    colors=[_rgb(colour) for _, colour, _ in marked],
                    labels=[text for _, _, text in marked],
                    radii=2.0 * MARKER_RADIUS_M,
                ),
            )
        seen, before, after = (
            np.array([getattr(entry, key) for entry in entries])
            for key in ("measured_m", "before_m", "after_m")
        )
        for name, points, colour in (
            ("measured", seen, MEASURED),
            ("before", before, BEFORE),
            ("after", after, AFTER),
        ):
            labels = [entry.marker for entry in entries] if name == "measured" else None
            recording.log(
                f"markers/{name}",
                rr.Points3D(points, colors=[_rgb(colour)], labels=labels, radii=MARKER_RADIUS_M),
            )
        for name, points, colour in (("before", before, BEFORE), ("after", after, AFTER)):
            recording.log(
                f"markers/error_{name}",
                rr.Arrows3D(origins=points, vectors=seen - points, colors=[_rgb(colour)]),
            )
            for entry, length in zip(entries, np.linalg.norm(seen - points, axis=1), strict=True):
                recording.log(
                    f"residual/{rr.escape_entity_path_part(entry.marker)}/{name}_mm",
                    rr.Scalars(1000.0 * float(length)),
                )


def _layout(found: Diagnosis) -> Any:
    """The initial layout of the viewer: the robot beside the sentence, the residuals and the signatures."""
    import rerun.blueprint as rrb  # type: ignore[import-not-found,import-untyped,unused-ignore]

    series = [rrb.TimeSeriesView(origin="residual", name="distance to the measured marker, mm")]
    if found.signatures or found.tracks:
        series.append(rrb.TimeSeriesView(origin="signature", name="signatures"))
    views = [rrb.TextDocumentView(origin="verdict", name="verdict"), *series]
    if any(field.over == "image" for field in found.fields):
        views.append(rrb.Spatial2DView(origin="field", name="mean residuals over the picture"))
    robot = rrb.Spatial3DView(origin="/", contents=["robot/**", "markers/**"], name="robot")
    return rrb.Blueprint(rrb.Horizontal(robot, rrb.Vertical(*views), column_shares=[3, 2]))


def _log_signatures(rr: Any, recording: Any, session: Session, found: Diagnosis) -> None:
    frames = session.frames
    times = {} if frames.time_s is None else dict(zip(frames.frame.tolist(), frames.time_s, strict=True))
    series: list[tuple[str, str, int | None, Any, Any, Any]] = []
    for signature in found.signatures:
        base, unit = f"signature/{_entity(signature.at)}", signature.unit
        series.append((base, unit, signature.cause, signature.frame, signature.error, signature.fitted))
    for track in found.tracks:
        for column, component in enumerate(track.components):
            base = f"signature/{_entity(track.at)}/{track.what}/{component.replace(' ', '_')}"
            unit = "ratio" if track.unit == "1" else track.unit
            told = (track.error[:, column], track.fitted[:, column])
            series.append((base, unit, track.cause, track.frame, *told))
    for base, unit, cause, numbers, error, fitted in series:
        colour = FREE if cause is None else CAUSE_COLOURS[cause % len(CAUSE_COLOURS)]
        name = base.removeprefix("signature/")
        for what, values, shade in (("error", error, POINTS), ("fitted", fitted, colour)):
            entity = f"{base}/{what}_{unit}"
            style = rr.SeriesPoints(colors=[_rgb(shade)], names=[f"{name} {what}, {unit}"])
            recording.log(entity, style, static=True)
            for frame, value in zip(numbers.tolist(), values, strict=True):
                recording.set_time(TIMELINE, sequence=frame)
                if frame in times:
                    recording.set_time("time", duration=float(times[frame]))
                recording.log(entity, rr.Scalars(float(value)))


def _log_fields(rr: Any, recording: Any, found: Diagnosis) -> None:
    for field in found.fields:
        base = f"field/{_entity(field.at)}"
        for name, residual in (("without", field.without), ("with", field.with_cause)):
            if residual is None or not len(residual):
                continue
            if field.over == "board":
                at = np.column_stack([field.at_points, np.zeros(len(field.at_points))])
                arrows = rr.Arrows3D(origins=at, vectors=residual)
            else:
                arrows = rr.Arrows2D(origins=field.at_points, vectors=ARROW_FACTOR * residual)
            recording.log(f"{base}/{name}_{field.unit}", arrows, static=True)


def _entity(at: str) -> str:
    """A place as the path of an entity."""
    return at.replace("<-", "_from_").replace(":", "/")


def _rgb(colour: str) -> tuple[int, ...]:
    """`#2f7f4f` as three bytes."""
    return tuple(bytes.fromhex(colour[1:]))
