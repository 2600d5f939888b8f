"""A recording's moments of rest as the frames of a session."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from glob import escape
from pathlib import Path

import cv2
import numpy as np
import pyarrow as pa

from .._core import MirrorPostureError
from ..arrays import Floats
from ..output_files import keep_files, new_folder
from ..picture_files import encoded_picture
from ..robot import Robot
from ..session.camera_info import dump_camera_info
from ..session.errors import choices
from ..session.metadata import load_metadata
from ..session.tables import find_table
from ..session.write import write_table
from .originals import (
    MADE,
    TABLES,
    made_by_import,
    made_line,
    picture_name,
    refuse_links,
    refuse_other_tables,
    refuse_replacing,
)
from .recording import JointLog, Picture, Recording
from .rest import ClockMatch, Rest, find_rests, match_clocks, picture_motion
from .robot_joints import check_limits, only_joints, refuse_other_case, taken_back

MARGIN = 0.2
"""Share of a rest that is left at either end: the robot may still swing, and the clocks' match has a width."""
SHARP_WIDTH_PX = 640
LEAST_TURN = math.radians(3.0)
"""A log in which no joint turns as far, taken for degrees, may be in rad: 3° are 172° there, more than most joints' whole range."""
BEGAN_WITHIN_S = 30.0


@dataclass(frozen=True)
class Imported:
    """The result: the frames, the rests without a picture, the clocks' alignment, and unusual findings."""

    frames: int
    rests: int
    clock: ClockMatch
    offset_s: float
    warnings: tuple[str, ...]


def import_recording(
    recording: Recording,
    folder: Path,
    *,
    joint_names: Mapping[str, str] | None = None,
    offset_s: float | None = None,
    tolerance: float = 0.003,
    least_s: float = 0.5,
    overwrite: bool = False,
    degrees: bool = False,
) -> Imported:
    """Writes frames.csv and images/ into a folder that `init` made: one frame for each moment of rest with
    a picture.

    Of a rest's pictures the sharpest is used, away from the rest's ends; a joint's position is its median
    there. `joint_names` renames the recording's joints to the URDF's. Without `offset_s` the clocks are
    aligned by comparing how much the pictures change with how far the joints move between the same moments; if that does not
    determine the offset, they are taken to agree, with a warning. Only the robot's joints decide what rests. The recording's camera replaces camera.yaml.
    Detections of earlier pictures are removed.
    `degrees` says that the recording was read as degrees, except for prismatic joints.

    Raises:
        MirrorPostureError: no session there, existing frames, pictures there that no import made, a log or points of other frames, a
            link in the place of images/, no joint of the robot in the recording, no rest, or none with a picture.
    """
    metadata = load_metadata(folder)
    robot = Robot.from_urdf(folder / metadata.robot)
    there = any(find_table(folder, stem) for stem in ("frames", "detections"))
    if there and not overwrite:
        raise MirrorPostureError(
            f"{folder}: has frames or detections already; add --overwrite to replace them"
        )
    if Path(recording.source).resolve().is_relative_to((folder / "images").resolve()):
        raise MirrorPostureError(
            f"{recording.source}: lies in the session's images/, where the import writes its own pictures; needed a recording elsewhere: "
            "move it out of there"
        )
    camera = None if recording.camera is None else metadata.camera or "camera.yaml"
    refuse_links(folder, (MADE,) if camera is None else (MADE, camera))
    refuse_other_tables(folder)
    log, warnings = recording.joints, list(recording.warnings)
    wanted = dict(joint_names or {})
    if unknown := [name for name in wanted if name not in log.names]:
        raise MirrorPostureError(
            f"{recording.source}: has no joint {unknown[0]!r}; it has {', '.join(log.names)}"
        )
    if elsewhere := [
        f"{theirs}={ours}" for theirs, ours in wanted.items() if ours not in robot.position_names
    ]:
        raise MirrorPostureError(
            f"--joint: got {elsewhere[0]!r}, needed THEIRS=OURS with OURS one of the robot's joints: {choices(robot.position_names)}"
        )
    if offset_s is not None and not math.isfinite(offset_s):
        raise MirrorPostureError(f"--offset-s: got {offset_s!r}, needed a finite number of seconds")
    columns = [(index, wanted.get(name, name)) for index, name in enumerate(log.names)]
    kept = [(index, name) for index, name in columns if name in robot.position_names]
    if not kept:
        raise MirrorPostureError(
            f"{recording.source}: none of its joints ({', '.join(log.names)}) is one of the robot's "
            f"({', '.join(robot.position_names)}); add --joint THEIRS=OURS"
        )
    if len({name for _, name in kept}) < len(kept):
        raise MirrorPostureError("--joint: two of the recording's joints get the same name")
    refuse_other_case(log, columns, robot)
    if degrees:
        slides = {joint.name for joint in robot.joints if joint.kind == "prismatic"}
        log = taken_back(log, [index for index, name in kept if name in slides])
        recording = replace(recording, joints=log)
        turning = log.position[:, [index for index, name in kept if name not in slides]]
        if turning.size and 0.0 < np.ptp(turning, axis=0).max() < LEAST_TURN:
            warnings.append(
                f"{log.source}: with --degrees no joint turns by {math.degrees(LEAST_TURN):g}° or more; if the log is in rad already, "
                "leave out --degrees"
            )
    warnings += check_limits(recording, robot, kept)
    if left := [*(name for _, name in columns if name not in robot.position_names), *log.others]:
        warnings.append(f"not joints of the robot, left out: {', '.join(left)}")
    if still := [name for name in robot.position_names if name not in {name for _, name in kept}]:
        warnings.append(f"not in the recording, assumed at 0: {', '.join(still)}")
    if not log.commanded:
        warnings.append(
            "the recording has measured positions only: they are written as if they had been commanded"
        )
    log = only_joints(log, kept)
    rests = find_rests(log, tolerance=tolerance, least_s=least_s)
    if not rests:
        raise MirrorPostureError(
            f"{recording.source}: no moment of {least_s:g} s in which all joints rest within {tolerance:g} rad; hold each "
            "posture longer, or change --rest-s and --tolerance"
        )
    sharp: list[float] = []

    def judged() -> Iterator[tuple[float, Picture]]:
        for time, picture in recording.pictures():
            sharp.append(sharpness(picture))
            yield time, picture

    picture_s, motion = picture_motion(judged())
    if not len(picture_s):
        raise MirrorPostureError(f"{recording.source}: holds no pictures")
    clock = (
        match_clocks(log, picture_s, motion)
        if _overlap(log, picture_s)
        else match_begins(log, picture_s, motion)
    )
    if offset_s is None:
        if not clock.trusted and not _overlap(log, picture_s):
            raise MirrorPostureError(
                f"{recording.source}: the clocks have nothing in common (pictures {picture_s[0]:.10g} to {picture_s[-1]:.10g} s, joints "
                f"{log.time_s[0]:.10g} to {log.time_s[-1]:.10g} s), and the pictures' movement does not show the offset (correlation "
                f"{clock.match:.2f}); give --offset-s"
            )
        offset_s = clock.offset_s if clock.trusted else 0.0
        if not clock.trusted:
            warnings.append(
                f"the pictures' movement does not show the clocks' offset (correlation {clock.match:.2f}): taken as 0; give --offset-s"
            )
    warnings += _beyond_log(log, picture_s, offset_s, least_s)
    chosen = _choose(rests, picture_s, sharp, offset_s)
    if not chosen:
        raise MirrorPostureError(
            f"{recording.source}: no picture lies in a moment of rest (pictures {picture_s[0]:g} to {picture_s[-1]:g} s, joints "
            f"{log.time_s[0]:g} to {log.time_s[-1]:g} s, offset {offset_s:g} s)"
            + (
                "; is the log in milliseconds? --time COLUMN=ms"
                if np.ptp(log.time_s) > 100.0 * np.ptp(picture_s)
                else ""
            )
        )
    if len(chosen) < len(rests):
        warnings.append(f"{len(rests) - len(chosen)} of {len(rests)} moments of rest have no picture")
    earlier = made_by_import(folder)
    refuse_replacing(folder, len(chosen), earlier, overwrite)
    # In one step, because frames of one recording with pictures of another would look valid.
    with new_folder(folder) as part:
        # A name is no pattern: what is kept is the old file itself, and must not be written into.
        made = (*TABLES, *earlier, MADE, *(() if camera is None else (camera,)))
        keep_files(folder, part, [escape(name) for name in made])
        _write(
            replace(recording, joints=log),
            part,
            [rests[index] for index in chosen],
            list(chosen.values()),
            offset_s,
        )
        if recording.camera is not None and camera is not None:
            (part / camera).write_text(dump_camera_info(recording.camera), encoding="utf-8")
    return Imported(len(chosen), len(rests), clock, offset_s, tuple(warnings))


def _beyond_log(log: JointLog, picture_s: Floats, offset_s: float, least_s: float) -> list[str]:
    """A warning where pictures before or after the log last as long as a moment of rest: those of that time are lost."""
    first, last = log.time_s[0] + offset_s, log.time_s[-1] + offset_s
    beyond = int(((picture_s < first) | (picture_s > last)).sum())
    if max(first - picture_s[0], picture_s[-1] - last) < least_s:
        return []
    return [
        f"{beyond} of {len(picture_s)} pictures lie outside of the log's times and are not used: pictures {picture_s[0]:.10g} to "
        f"{picture_s[-1]:.10g} s, {log.source} {first:.10g} to {last:.10g} s of the pictures' clock; record the joints for as long as "
        "the pictures"
    ]


def _overlap(log: JointLog, picture_s: Floats) -> bool:
    return bool(picture_s[0] <= log.time_s[-1] and picture_s[-1] >= log.time_s[0])


def match_begins(log: JointLog, picture_s: Floats, motion: Floats) -> ClockMatch:
    """Aligns clocks with different origins (one counts from 1970, for example): recordings that began
    within half a minute."""
    shift = float(picture_s[0] - log.time_s[0])
    found = match_clocks(log, picture_s - shift, motion, most_s=BEGAN_WITHIN_S)
    return replace(found, offset_s=shift + found.offset_s)


def _choose(rests: list[Rest], picture_s: Floats, sharp: list[float], offset_s: float) -> dict[int, int]:
    """The sharpest picture of each rest that has one: rest to number of the picture."""
    inner = [
        (
            rest.start_s + MARGIN * (rest.end_s - rest.start_s),
            rest.end_s - MARGIN * (rest.end_s - rest.start_s),
        )
        for rest in rests
    ]
    starts = np.array([start for start, _ in inner])
    best: dict[int, int] = {}
    for number, at in enumerate(picture_s - offset_s):
        index = int(np.searchsorted(starts, at, side="right")) - 1
        if index < 0 or at > inner[index][1]:
            continue
        if index not in best or sharp[number] > sharp[best[index]]:
            best[index] = number
    return dict(sorted(best.items()))


def sharpness(picture: Picture) -> float:
    """Variance of the Laplacian of a picture brought to one width: larger is sharper, for pictures of one scene."""
    gray = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    if gray.shape[1] > SHARP_WIDTH_PX:
        height = round(SHARP_WIDTH_PX * gray.shape[0] / gray.shape[1])
        gray = cv2.resize(gray, (SHARP_WIDTH_PX, height), interpolation=cv2.INTER_AREA)
    return float(cv2.Laplacian(gray, cv2.CV_64F).var())


def _write(
    recording: Recording,
    folder: Path,
    rests: list[Rest],
    chosen: list[int],
    offset_s: float,
) -> None:
    """One frame for each rest, with the picture of the number that was chosen for it."""
    log = recording.joints
    (folder / "images").mkdir(exist_ok=True)
    commanded, measured = [], []
    for rest in rests:
        inside = (log.time_s >= rest.start_s) & (log.time_s <= rest.end_s)
        commanded.append(np.median(log.position[inside], axis=0))
        if log.measured is not None:
            measured.append(np.median(log.measured[inside], axis=0))
    frame_of = {number: frame for frame, number in enumerate(chosen)}
    time_s, made = np.zeros(len(chosen)), [""] * len(chosen)
    # Pictures are read again, one at a time: all of them together can be larger than the memory.
    for number, (time, picture) in enumerate(recording.pictures()):
        frame = frame_of.get(number)
        if frame is None:
            continue
        name = picture_name(frame)
        data = encoded_picture(picture, name)
        (folder / name).write_bytes(data)
        time_s[frame], made[frame] = time - offset_s, made_line(name, data)
    (folder / MADE).write_text("".join(f"{line}\n" for line in made), encoding="utf-8")
    order = np.arange(len(chosen))
    columns = {
        "frame": order,
        "posture": order,
        "time_s": time_s,
        "image": pa.array(map(picture_name, range(len(chosen))), pa.string()),
        **{name: np.array(commanded)[:, index] for index, name in enumerate(log.names)},
    }
    if measured:
        columns |= {f"measured:{name}": np.array(measured)[:, index] for index, name in enumerate(log.names)}
    write_table(pa.table(columns), folder / "frames.csv")
