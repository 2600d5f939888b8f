"""The effects of a motion in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

WORDS: Mapping[str, str] = {
    "latency": "pictures show the body at an earlier moment than their time stamps say",
    "servo_lag": "the joint follows its command with a delay (first-order filter)",
    "servo_gain": "stiffness or damping of the position loop differ from the model",
    "viscous_friction": "a torque against the motion, in proportion to the speed",
    "coulomb_friction": "dry friction against the motion, the same at all speeds",
    "reflected_inertia": "more (or less) inertia of motor and gears at the joint",
    "torque_limit": "an upper limit of the servo's torque",
    "velocity_limit": "an upper limit of the command's speed",
    "joint_offset": "a wrong zero",
    "gear_ratio": "a proportional transmission error",
    "joint_compliance": "the joint yields in proportion to its load",
    "backlash": "a play: the output lies on the side to which its load pushes it",
    "marker_mount": "the marker is displaced on its link",
    "camera_mount": "the camera is displaced relative to the board",
    "board_mount": "the board is displaced on its link",
}

REMEDIES: Mapping[str, str] = {
    "latency": "shift the pictures' time stamps by it, or trigger the camera by the log's clock",
    "servo_lag": "look for a filter or a smoothed command in the driver, or put it into the simulator (`model.xml`)",
    "servo_gain": "set the position loop's gains, or the model's, to agree",
    "viscous_friction": "put it into the model (`damping`); look at grease and cables where it is new",
    "coulomb_friction": "put it into the model (`frictionloss`); look at bearings and brakes where it is new",
    "reflected_inertia": "put it into the model (`armature`): motor and gear as the joint feels them",
    "torque_limit": "put it into the model (`forcerange`), or raise the drive's limit of current",
    "velocity_limit": "put it into the command's path in the simulator, or raise the drive's limit of speed",
}
"""What to do about the effects that only a motion shows."""


def sentence(verdict: str, causes: Sequence[Mapping[str, Any]], gap: Mapping[str, Any]) -> str:
    """The diagnosis in a sentence."""
    before, after, floor = gap["before_px"], gap["after_px"], gap["noise_floor_px"]
    names = ", ".join(f"{c['effect'].replace('_', ' ')} at {c['at']}" for c in causes)
    if verdict == "none":
        return f"the simulator follows the motion to the noise: {before:.2f} px, noise {floor:.2f} px"
    if verdict == "unknown":
        return f"the simulator is {before:.2f} px off the motion (noise {floor:.2f} px), and no effect of the vocabulary explains it"
    told = f"{names}: the gap in motion falls from {before:.2f} to {after:.2f} px (noise {floor:.2f} px)"
    return told if verdict == "explained" else f"{told}; a remainder is left that no effect explains"
