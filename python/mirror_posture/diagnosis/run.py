"""The diagnosis of a session: from a folder or a loaded session to a `Diagnosis`."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from threading import Event, Thread

from .._core import DiagnosisProgress, GapRecording, MirrorPostureError
from ..arguments import checked_arguments
from ..error_pickling import PickledWhole
from ..session import Session, as_session
from ..view_check import refuse_unnamed_mistakes
from .encoders import encoder_witness
from .fingerprint import KEY, fingerprint
from .formatting import REFUSED
from .markers import marker_of_place, only_markers
from .own_effects import OwnEffect, Tabulated, tabulate
from .recording import to_core
from .result import Diagnosis
from .vocabulary import checked_effects

MOST_CAUSES = 6
"""Causes that a search adds at most: beyond them the small errors are a group (`geometry`)."""
WITNESS = "witness:"


class DiagnosisInterrupted(PickledWhole, KeyboardInterrupt):
    """Ctrl-C during a diagnosis; `found` is the partial result."""

    def __init__(self, found: Diagnosis) -> None:
        self.found = found
        super().__init__(found.sentence)


POLL_S = 0.1


@contextmanager
def _watched(watch: DiagnosisProgress, told: Callable[[str, int], None] | None) -> Iterator[None]:
    """Reports the stage and the number of causes found so far whenever they change, from a separate thread."""
    if told is None:
        yield
        return
    over = Event()

    def look() -> None:
        last = ("", 0)
        while not over.wait(POLL_S):
            now = watch.stage
            if now != last:
                told(*now)
                last = now

    thread = Thread(target=look, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


@checked_arguments
def diagnose(
    session: Session | str | os.PathLike[str],
    *,
    without: Sequence[str] = (),
    check: Sequence[Session | str | os.PathLike[str]] = (),
    withhold: Sequence[str] = (),
    most_causes: int = MOST_CAUSES,
    effects: Sequence[OwnEffect] = (),
    markers: bool = False,
    progress: Callable[[str, int], None] | None = None,
) -> Diagnosis:
    """Diagnoses a session: where the model is wrong, which effect causes it, and how far the gap shrinks.

    `without` are effects to leave out of the vocabulary; `check` further sessions that are only predicted
    (nothing is fitted but their own mirrors); `withhold` markers (`marker:NAME`, or the bare name) that
    take no part in the fit and are then predicted. `effects` are your own, tried in addition to the
    vocabulary at every place that they name; `markers` requests each marker posture by posture, for
    drawing. `progress` is called, from another thread, with the current stage and the number of causes
    found so far. In a session with pictures and no image points, board and balls are detected first.

    Raises:
        DiagnosisInterrupted: Ctrl-C (it is a `KeyboardInterrupt`); `found` has the partial result.
        MirrorPostureError: an invalid session, an unknown effect or marker, too little to diagnose, a camera's link or pictures that are
            not what they claim, where the vocabulary has no word for it (`view_check`).
    """
    left_out = checked_effects(without)
    loaded = _loaded(session)
    others = [_other(other.folder.name, to_core(other), effects) for other in map(_loaded, check)]
    names = tuple(dict.fromkeys(marker_of_place(loaded, place) for place in withhold))
    seen = loaded
    if names:
        kept = [name for name in loaded.marker_names if name not in names]
        if not kept:
            raise MirrorPostureError(
                f"withhold: got all markers ({', '.join(names)}); needed at least one that the fit may see"
            )
        seen = only_markers(loaded, kept)
        others += [_other(WITNESS + name, to_core(only_markers(loaded, [name])), effects) for name in names]
    refuse_unnamed_mistakes(seen)
    recording = to_core(seen)
    watch, own = DiagnosisProgress(), tabulate(effects, recording)
    try:
        with _watched(watch, progress):
            tree = json.loads(recording.diagnose(left_out, most_causes, others, own, markers, watch))
    except KeyboardInterrupt:
        so_far = json.loads(watch.so_far(recording)) | {KEY: fingerprint(loaded)}
        raise DiagnosisInterrupted(Diagnosis.from_document(so_far)) from None
    tree[KEY] = fingerprint(loaded)
    if tree["verdict"] == "insufficient":
        # OpenCV takes longer to load than most sessions to diagnose.
        from ..detect.refused import not_detected

        if refused := not_detected(loaded):
            tree["sentence"] = f"{tree['sentence']} {REFUSED}{refused}."
    if prismatic := [joint.name for joint in loaded.robot.joints if joint.kind == "prismatic"]:
        tree["prismatic_joints"] = prismatic
    if names:
        checked = tree["gap"].get("checked", [])
        tree["witness"] = [
            {
                "marker": entry["session"][len(WITNESS) :],
                "before_m": entry["before_m"],
                "after_m": entry["after_m"],
            }
            | ({"left_out": entry["left_out"]} if "left_out" in entry else {})
            for entry in checked
            if entry["session"].startswith(WITNESS)
        ]
        tree["gap"]["checked"] = [entry for entry in checked if not entry["session"].startswith(WITNESS)]
    encoders = encoder_witness(loaded, tree)
    if encoders:
        tree["encoder_witness"] = encoders
    found = Diagnosis.from_document(tree)
    if not loaded.frames.accelerometer_links:
        return found
    from .accelerometers import accelerometer_witness

    accelerometers = accelerometer_witness(loaded, found)
    tree["accelerometer_witness"] = list(accelerometers.entries)
    tree["warnings"] = [*tree.get("warnings", ()), *accelerometers.warnings]
    return Diagnosis.from_document(tree)


def _other(
    name: str, recording: GapRecording, effects: Sequence[OwnEffect]
) -> tuple[str, GapRecording, list[Tabulated]]:
    return name, recording, tabulate(effects, recording, other=True)


def _loaded(session: Session | str | os.PathLike[str]) -> Session:
    loaded = as_session(session)
    if loaded.detected or not any(loaded.image_files) or loaded.points is not None:
        return loaded
    from ..detect import detect_session

    return detect_session(loaded).session
