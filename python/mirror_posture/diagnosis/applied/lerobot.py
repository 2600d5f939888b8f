"""Writes zeros into a LeRobot calibration file: homing offsets, in ticks."""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Sequence
from pathlib import Path

from ..._core import MirrorPostureError
from ...input_files import given_text
from ...output_files import write_file
from ..parts import Cause
from .another_robot import Check

TICKS = 4096
"""A turn of the servos that LeRobot drives (STS3215, XL330, XL430)."""
MOST_TICKS = {"feetech": 2047, "dynamixel": 1_044_479}
"""Range of the register Homing_Offset."""
SIGN = {"feetech": -1, "dynamixel": 1}
"""Present_Position is the actual position minus the homing offset on Feetech servos, plus it on Dynamixel's."""


def patch_lerobot(
    own: Path,
    causes: Sequence[Cause],
    out: Path,
    motors: str = "feetech",
    check: Check | None = None,
    sliding: Collection[str] = (),
) -> dict[tuple[str, str], str]:
    """Writes a LeRobot calibration file whose homing offsets compensate joint offsets; returns what was
    written.

    `θ = q + a`: a motor's reading must grow by a, `a · 4096 / 2π` ticks, so its `homing_offset` changes by
    as many, down on Feetech servos, up on Dynamixel's. The ranges stay: LeRobot counts degrees from their
    middle. The motors' direction of counting is taken to be the joint's. Only the numbers change.
    `check` takes the motors' names; `sliding` are joints whose offsets are lengths, which no tick of a turn tells.

    Raises:
        MirrorPostureError: no such file, or not one of LeRobot's; unknown motors; an offset beyond the register; what `check` raises.
    """
    if motors not in SIGN:
        raise MirrorPostureError(f"motors: got {motors!r}, needed one of {', '.join(SIGN)}")
    text = given_text(own, "a LeRobot calibration file")
    try:
        tree = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise MirrorPostureError(f"{own}: is no JSON: {error}") from None
    if not isinstance(tree, dict) or not all(
        isinstance(motor, dict) and isinstance(motor.get("homing_offset"), int) for motor in tree.values()
    ):
        raise MirrorPostureError(
            f"{own}: is no LeRobot calibration: needed a whole `homing_offset` for each motor"
        )
    if check is not None:
        check(list(tree))
    told = {}
    for cause in causes:
        if cause.effect == "gear_ratio":
            told[cause.effect, cause.at] = "not written: a LeRobot calibration has zeros, no gear ratios"
        if cause.effect != "joint_offset":
            continue
        name, offset = cause.at.partition(":")[2], cause.parameters["offset_rad"].value
        if name not in tree:
            told[cause.effect, cause.at] = f"not written: no motor {name!r}; the file has {', '.join(tree)}"
            continue
        if name in sliding:
            told[cause.effect, cause.at] = (
                f"not written: joint {name} slides by {1e3 * offset:+.4g} mm, and the file does not say how far a turn "
                "of its motor moves it"
            )
            continue
        ticks = round(offset * TICKS / (2.0 * math.pi))
        before = tree[name]["homing_offset"]
        after = before + SIGN[motors] * ticks
        if abs(after) > MOST_TICKS[motors]:
            raise MirrorPostureError(
                f"{own}: motor {name!r} would need a homing_offset of {after}, the register holds ±{MOST_TICKS[motors]}; "
                "mount the horn anew, or calibrate again"
            )
        tree[name]["homing_offset"] = after
        told[cause.effect, cause.at] = f"homing_offset of {name}: {before} to {after}" + (
            "; its drive_mode is not 0, so try the sign on the robot first"
            if tree[name].get("drive_mode")
            else ""
        )
    # LeRobot's own form; where the file has another one (an editor's), that of its first indentation.
    indent = next(
        (len(line) - len(line.lstrip()) for line in text.splitlines() if line.startswith(" ")), None
    )
    ends = "\r\n" if "\r\n" in text else "\n"
    written = json.dumps(tree, indent=indent, ensure_ascii=False).replace("\n", ends)
    write_file(out, (written + (ends if text.endswith("\n") else "")).encode("utf-8"))
    return told
