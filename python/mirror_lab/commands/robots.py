"""`mirror-posture correct twin|mujoco`: the simulated robots, opened from the settings of the command."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from mirror_posture._core import MirrorPostureError
from mirror_posture.robots import CommandedRobot, Nominal

from ..robots import HiddenEffect, TwinOptions, TwinRobot


def open_twin(settings: Mapping[str, Any], nominal: Nominal, say: Callable[[str], object]) -> CommandedRobot:
    """The twin. Raises `MirrorPostureError` for a hidden effect or a session that it cannot have."""
    return TwinRobot(
        _hidden(settings),
        TwinOptions(
            pictures=settings["pictures"],
            meshes=settings.get("meshes", False),
            noise_px=settings["noise_px"],
            stand_error_rad=math.radians(settings["stand_error_deg"]),
            seed=settings["seed"],
        ),
        nominal,
    )


def open_mujoco(
    settings: Mapping[str, Any], nominal: Nominal, say: Callable[[str], object]
) -> CommandedRobot:
    """The MuJoCo robot. Raises `MirrorPostureError` as `open_twin`, and where MuJoCo is not installed."""
    try:
        from ..robots.mujoco import MujocoOptions, MujocoRobot
    except ImportError:
        raise MirrorPostureError(
            "mujoco is not installed; pip install 'mirror-posture[lab,mujoco]'"
        ) from None

    return MujocoRobot(
        _hidden(settings),
        MujocoOptions(
            way="auto" if settings["pictures"] else "pixels",
            noise_px=settings["noise_px"],
            stand_error_rad=math.radians(settings["stand_error_deg"]),
            seed=settings["seed"],
        ),
        nominal,
    )


def _hidden(settings: Mapping[str, Any]) -> list[HiddenEffect]:
    return [hidden_effect(text) for text in settings["hide"]]


def hidden_effect(text: str) -> HiddenEffect:
    """`EFFECT@PLACE:PARAMETER=VALUE[,PARAMETER=VALUE]`, in the words of the vocabulary."""
    effect, at, rest = text.partition("@")
    # The place has a colon of its own: joint:r_elbow:offset_rad=0.04.
    place, colon, values = rest.rpartition(":")
    try:
        parameters = {k: float(v) for k, _, v in (part.partition("=") for part in values.split(","))}
    except ValueError:
        colon = ""
    if not (at and colon and place):
        raise MirrorPostureError(
            f"--hide: got {text!r}, needed EFFECT@PLACE:PARAMETER=VALUE, as in "
            "joint_offset@joint:r_elbow:offset_rad=0.04"
        )
    return HiddenEffect(effect, place, parameters)
