"""The next step after a diagnosis: what to write, repair, measure or inspect."""

from __future__ import annotations

from collections import Counter

from .formatting import (
    BY_HAND,
    REFUSED,
    dependence,
    effect_in_words,
    listed,
    numbers_in_words,
    place_in_words,
    place_with_article,
)
from .parts import Place
from .result import Diagnosis

OFTEN = {
    "board": {"nothing": "a board that is not flat does this: lay a ruler on it"},
    "camera": {
        "nothing": "a lens model with too few terms in the camera file does this: calibrate it with more terms",
        "position": "a camera mount that yields as a joint moves does this: press on it",
        "time": "a mount that creeps or a lens that warms up does this: tighten the mount, and record once the camera is warm",
    },
    "link": {
        "time": "a link that grows as it warms up or a screw that settles does this, and a base that shifts on its floor: measure it cold and warm"
    },
    "marker": {"time": "a marker that slides or peels off does this: press on it, and fasten it anew"},
    "mirror": {
        "nothing": "a mirror that is bent in one direction does this, as a thin one that leans or hangs: look at a straight line along it, and support its back"
    },
    "joint": {
        "posture": "a column that holds another joint's values, other rows' or none does this: compare it with what the joint did; so does "
        "a clutch or a screw that slips: mark shaft and hub, move, and look",
        "row": "a joint that was homed again, slipped on its shaft or lost steps does this: diagnose the rows before and after apart",
        "time": "a zero that wanders as a drive warms up does this: record once it is warm, and home it before and after",
        "history": "a tendon or a harmonic drive that winds up does this: approach one posture from both sides",
    },
}
"""Usual reasons of an unexplained error, by the kind of its place and the variable on which it depends:
what to inspect first."""


IN_PICTURE_ONLY = "No cause is named"
"""How the sentence begins where a probable cause makes the gap smaller in pixels and not in metres."""


def next_step(found: Diagnosis) -> str:
    """What to do next, in one or two sentences."""
    verdict = found.verdict
    if verdict == "none":
        whole = frames_left_out(found)
        if whole:
            return (
                f"Look at the frames of which much was left out ({numbers_in_words(whole)}), whether their rows belong to their pictures. Beside them there is "
                "nothing to mend: the model predicts as well as the measurement's noise allows."
            )
        if shows_in_picture_only(found):
            return "Record more views of each posture, from nearer the mirror, and diagnose again: the depth of the markers is too uncertain to show what the picture shows."
        return "Nothing to mend: the model predicts as well as the measurement's noise allows."
    if verdict == "insufficient" and REFUSED in found.sentence:
        return "Give the camera file that fits the pictures, and run `mirror-posture detect` with --overwrite; then diagnose again."
    if verdict == "insufficient":
        return "Record more: postures in which the board and the markers are seen together; `mirror-posture check` tells what is missing."
    if found.document.get("motion", {}).get("next_moves") and any(c.alternatives for c in found.causes):
        return "Record a motion with the suggested moves too (report.html), and diagnose again: they separate the alternatives."
    if "motion" in found.document:
        return "Change the simulator's model as in the model.xml of --out, record another motion, and diagnose it with --check."
    shifted = [
        cause
        for cause in found.causes
        if _is_board_or_link({cause.effect, *(a.effect for a in cause.alternatives)})
    ]
    if shifted:
        return (
            "Measure the board's place on its link with a rule: through the mirror no posture tells a shifted board from a link's length. "
            "Write it into the URDF, and diagnose again."
        )
    rivals = [cause for cause in found.causes if cause.alternatives]
    if rivals and found.next_postures:
        return "Take the suggested postures and diagnose again: they separate the alternatives."
    if rivals:
        return "Record further postures, far from those of this session, and diagnose again: alternatives remain."
    if verdict == "unknown":
        look = f"Look at {_unexplained_place(found)}: no effect of the vocabulary explains it"
        return f"{look}{_what_often_does_it(found)}. A law of your own can be tried as an own effect."
    if any(cause.effect == "pairing" for cause in found.causes):
        return "Mend the rows of the frames table that hold other rows' measurement (delete them where the camera hung), then diagnose again."
    refused = [cause for cause in found.causes if cause.effect in BY_HAND and not cause.members]
    written = [cause for cause in found.causes if cause not in refused]
    steps = []
    if written:
        steps.append("Write the better model with `mirror-posture apply`")
    if refused:
        # A place that slipped, and came back, is named once.
        told = dict.fromkeys(f"{effect_in_words(c.effect)} at {place_in_words(c.at)}" for c in refused)
        names = listed(list(told))
        ways = list(dict.fromkeys(BY_HAND[cause.effect] for cause in refused))
        steps.append(f"{'no' if steps else 'No'} file can hold {names}: {'; '.join(ways)}")
    if verdict == "partial":
        look = f"Then look at {_unexplained_place(found)}{_what_often_does_it(found)}."
        return ". ".join(("; ".join(steps), look)) if steps else ""
    last = "Check it on a session of other postures with --check." if written else "Then diagnose again."
    return f"{'; '.join(steps)}. {last}"


def _is_board_or_link(effects: set[str]) -> bool:
    """Whether a shifted board and a link of another length are alternatives."""
    return {"board_mount", "link_length"} <= effects


def shows_in_picture_only(found: Diagnosis) -> bool:
    """Whether a probable cause is not named, since it makes the gap smaller in pixels only."""
    return found.verdict == "none" and found.sentence.startswith(IN_PICTURE_ONLY)


def frames_left_out(found: Diagnosis) -> list[int]:
    """Frames of which several observations, or the board, are far from the model: there it is a row or a picture that is wrong, not a detection."""
    reasons = ("nearly all that was seen", "far from all that small errors allow", "no flat mirror explains")
    far = [one for one in found.data.left_out if one.why.startswith(reasons)]
    counts = Counter(one.frame for one in far)
    return sorted({one.frame for one in far if counts[one.frame] > 1 or one.target == "board"})


def _unexplained(found: Diagnosis) -> Place | None:
    """The first place with a known dependence of the remainder."""
    return next((where for where in found.where if where.depends_on), None)


def _unexplained_place(found: Diagnosis) -> str:
    left = _unexplained(found)
    if left is None:
        camera = all(where.at != "unknown" for where in found.where)
        return "the camera" if camera else "the residuals, which no single place explains"
    at = place_with_article(left.at)
    if left.depends_on == "nothing":
        return f"{at}, where what is left is the same in every posture"
    return f"{at}, where what is left depends on {dependence(left.depends_on or '')}"


def _what_often_does_it(found: Diagnosis) -> str:
    """The usual reason in brackets; empty where there is none."""
    left = _unexplained(found)
    if left is None:
        return ""
    depends_on = (left.depends_on or "").split(",")[0].split(" of ")[0]
    often = OFTEN.get(left.at.split(":")[0], {}).get(depends_on)
    return f" ({often})" if often else ""
