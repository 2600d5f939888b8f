"""Adds the causes of a diagnosis one by one to the simulator's own model: what each effect is in MuJoCo.

Every law changes a `Changed` state (specification, drives, session) and returns one line that describes the
change; it becomes a comment in the written model. A simulator cannot represent effects without a law.
"""

from __future__ import annotations

from collections.abc import Mapping

from mirror_posture.diagnosis.parts import Cause
from mirror_posture.diagnosis.vocabulary import IN_WORDS, joint_terms

from . import frame_faults as frames
from . import optics_faults as optics
from .changed import Changed, Law
from .joint_faults import change_joint

LAWS: Mapping[str, Law] = {
    "link_bending": frames.link_bending,
    "link_length": frames.link_length,
    "link_twist": frames.link_twist,
    "axis_tilt": frames.axis_tilt,
    "axis_sign": frames.axis_sign,
    "joints_swapped": frames.joints_swapped,
    "marker_mount": frames.marker_mount,
    "camera_mount": frames.camera_mount,
    "board_mount": frames.board_mount,
    "camera_focal": optics.in_lens(optics.focal),
    "camera_center": optics.in_lens(optics.center),
    "lens_distortion": optics.in_lens(optics.lens),
    "board_scale": optics.board_scale,
    "mirror_glass": optics.mirror_glass,
}
"""For each effect of docs/effects.md that is no law of a joint: its representation in a simulator."""


def is_held(effect: str) -> bool:
    """Whether a simulator can hold an effect."""
    told = IN_WORDS.get(effect)
    return effect in LAWS or (told is not None and bool(told["joint_law"]))


def add_cause(changed: Changed, cause: Cause) -> str | None:
    """Adds a cause; None where no simulator can hold it.

    Raises:
        MirrorPostureError: a place that is not there.
    """
    value = {name: estimate.value for name, estimate in cause.parameters.items()}
    place, _, name = cause.at.partition(":")
    terms, law = joint_terms(cause.effect, value), LAWS.get(cause.effect)
    if terms:
        element, said = change_joint(changed, name, terms, value)
    elif law is not None:
        element, said = law(changed, name or place, value)
    else:
        return None
    changed.comments.append((element, f"{cause.effect} at {cause.at}: {said}"))
    return said
