"""The staircase: the simulator's gap of the unchanged model, and with each cause of a diagnosis added in
turn."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mirror_posture import MirrorPostureError
from mirror_posture.diagnosis.applied.apply import FIRST, parts_of
from mirror_posture.diagnosis.parts import Cause
from mirror_posture.diagnosis.result import Diagnosis
from mirror_posture.measurement.inputs import require_detected
from mirror_posture.measurement.types import NothingMeasuredError
from mirror_posture.session import Session, load_session

from .causes import add_cause, is_held
from .changed import Changed
from .gap import SimulatedGap, simulated_gap
from .model import build
from .motion import Rest, execute

if TYPE_CHECKING:
    from .held_out import HeldOut


@dataclass(frozen=True)
class Stair:
    """The simulator with the causes up to `added` (None: the unchanged model). `what` describes the change;
    where `simulated` is False no simulator can represent the cause, and the gap is the previous one."""

    added: str | None
    what: str
    gap: SimulatedGap
    simulated: bool = True


@dataclass(frozen=True)
class Simulation:
    """A session's commands executed in MuJoCo, cause by cause."""

    model_file: Path
    stairs: tuple[Stair, ...]
    marker_names: tuple[str, ...]
    notes: tuple[str, ...]
    model_xml: str
    """The patched model, with a comment at each change."""
    told_before_m: float | None = None
    told_after_m: float | None = None
    told_before_px: float | None = None
    told_after_px: float | None = None
    """The diagnosis' own gap, on postures held out of its fit."""
    held_out: HeldOut | None = None
    """The simulator's gap on postures to which the causes were not fitted, if requested."""

    def to_tree(self) -> dict[str, Any]:
        """As JSON."""
        return {
            "format": "mirror-posture/simulation",
            "version": 1,
            "model": str(self.model_file),
            "steps": [
                {
                    "added": stair.added,
                    "what": stair.what,
                    "simulated": stair.simulated,
                    "rms_m": stair.gap.rms_m,
                    "rms_px": stair.gap.rms_px,
                    "markers": [
                        {"marker": name, "rms_m": _number(m), "rms_px": _number(px)}
                        for name, m, px in zip(
                            self.marker_names, stair.gap.marker_rms_m, stair.gap.marker_rms_px, strict=True
                        )
                    ],
                }
                for stair in self.stairs
            ],
            "diagnosis": {
                "before_m": self.told_before_m,
                "after_m": self.told_after_m,
                "before_px": self.told_before_px,
                "after_px": self.told_after_px,
            },
            "held_out": None if self.held_out is None else self.held_out.to_tree(),
            "notes": list(self.notes),
        }


def simulate(
    session: Session | str | os.PathLike[str],
    *,
    model: str | os.PathLike[str] | None = None,
    found: Diagnosis | None = None,
    workers: int = 0,
    progress: Callable[[str], None] | None = None,
) -> Simulation:
    """Executes a session in MuJoCo: the nominal model, then with each cause of a diagnosis added to that
    model.

    `model` is the user's own MJCF or URDF; None takes the session's URDF. Causes are added in the reported
    order.

    Raises:
        MirrorPostureError: a session without camera and board, or without detections; a model that MuJoCo cannot load, or that lacks
            a joint or link of the session.
        NothingMeasuredError: no frame shows a marker together with the board.
    """
    loaded = session if isinstance(session, Session) else load_session(session)
    if loaded.camera is None or loaded.board is None:
        raise MirrorPostureError(
            f"{loaded.folder}: has no camera and board; the simulator's gap is measured in the mirror's pictures"
        )
    require_detected(loaded)
    if found is not None:
        loaded = without_left_out(loaded, found)
    file = Path(model) if model is not None else None
    causes = list(found.causes) if found is not None else []

    def run(count: int) -> tuple[SimulatedGap, list[str | None], Changed]:
        """The simulator with the first `count` causes."""
        changed, told, rest = with_causes(loaded, file, causes[:count])
        gap = simulated_gap(changed.session, rest)
        if progress is not None:
            progress(_name(causes[count - 1]) if count else "nominal")
        return gap, told, changed

    with ThreadPoolExecutor(workers or os.cpu_count() or 1) as pool:
        results = list(pool.map(run, range(len(causes) + 1)))
    if not results[0][0].pixels and not results[0][0].measured:
        raise NothingMeasuredError(
            f"{loaded.folder}: no frame shows a marker together with the board in the mirror, so there is nothing to compare the "
            f"simulator with; `mirror-posture check {loaded.folder}` lists what is seen"
        )
    final = results[-1][2]
    stairs = [Stair(None, "the model as it is", results[0][0])]
    for cause, (gap, told, _) in zip(causes, results[1:], strict=True):
        what = told[-1]
        stairs.append(
            Stair(_name(cause), what or "no simulator can hold it: left out", gap, what is not None)
        )
    return Simulation(
        file or loaded.robot_file,
        tuple(stairs),
        loaded.marker_names,
        tuple(dict.fromkeys(note for result in results for note in result[2].simulator.notes)),
        _commented(final),
        *(
            (None,) * 4
            if found is None
            else (found.gap.before_m, found.gap.after_m, found.gap.before_px, found.gap.after_px)
        ),
    )


def with_causes(
    session: Session, model_file: Path | None, causes: Sequence[Cause]
) -> tuple[Changed, list[str | None], Rest]:
    """A session executed on a model with causes added: the model, the change for each (None: it cannot be
    represented), the rest."""
    torque = np.abs(
        session.robot.gravity_torques(session.positions, session.gravity_m_per_s2, session.root_link)
    )
    largest = dict(zip(session.robot.position_names, torque.max(axis=0).tolist(), strict=True))
    changed = Changed(build(session, model_file), session, largest)
    told = _add_all(changed, causes)
    rest = execute(changed.simulator, session, changed.drives, changed.swapped)
    if not rest.still.all():
        changed.simulator.notes.append(
            f"{int((~rest.still).sum())} of {len(rest.still)} frames had not come to rest"
        )
    return changed, told, rest


def without_left_out(session: Session, found: Diagnosis) -> Session:
    """The session without the observations that the diagnosis left out as false: its own gap does not count them."""
    left_out = found.document.get("data", {}).get("left_out", [])
    rows = {int(number): row for row, number in enumerate(session.frames.frame)}
    names = {name: index for index, name in enumerate(session.marker_names)}
    marker_seen, board_seen = session.mirror_view.marker_seen.copy(), session.mirror_view.board_seen.copy()
    for entry in left_out:
        row, target = rows.get(int(entry["frame"])), str(entry["target"])
        if row is None:
            continue
        target = target.removeprefix("marker:")
        if target in names:
            marker_seen[row, names[target]] = False
        elif target == "board":
            board_seen[row] = False
    view = replace(session.mirror_view, marker_seen=marker_seen, board_seen=board_seen)
    return replace(session, mirror_view=view)


def can_hold(cause: Cause) -> bool:
    """Whether a simulator can hold a cause, all its members if it is a group."""
    return all(is_held(part.effect) for part in parts_of(cause))


def _add_all(changed: Changed, causes: Sequence[Cause]) -> list[str | None]:
    """Adds causes, and returns the change for each, None where it cannot be represented.

    A part that is in series with a joint has its axis: what changes axes comes first, in the order in which `apply` writes it.
    """
    parts = [(index, part) for index, cause in enumerate(causes) for part in parts_of(cause)]
    said: list[list[str | None]] = [[] for _ in causes]
    for index, part in sorted(parts, key=lambda entry: FIRST.get(entry[1].effect, len(FIRST))):
        said[index].append(add_cause(changed, part))
    return [_in_a_line(cause, lines) for cause, lines in zip(causes, said, strict=True)]


def _in_a_line(cause: Cause, said: Sequence[str | None]) -> str | None:
    done = [line for line in said if line is not None]
    if not done:
        return None
    if not cause.members:
        return done[0]
    missing = len(said) - len(done)
    return f"{len(done)} small errors" + (f", {missing} left out" if missing else "")


def _name(cause: Cause) -> str:
    return f"{cause.effect}@{cause.at}"


def _commented(changed: Changed) -> str:
    """The model's XML, with a comment before each element that a cause changed (or, of optics, at the top)."""
    changed.simulator.compiled()
    lines = changed.simulator.spec.to_xml().splitlines()
    for element, comment in changed.comments:
        text = comment.replace("--", "- -")
        at = next((i for i, line in enumerate(lines) if element and f'name="{element}"' in line), 0)
        indent = lines[at][: len(lines[at]) - len(lines[at].lstrip())]
        lines.insert(at, f"{indent}<!-- {text} -->")
    return "\n".join(lines) + "\n"


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
