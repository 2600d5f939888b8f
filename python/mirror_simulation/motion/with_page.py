"""The diagnosis of a motion as the command `diagnose` asks for it: the entry point of `mirror_posture.motion`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from mirror_posture.diagnosis import Diagnosis
from mirror_posture.session import Session

from .diagnose import MOST_CAUSES, diagnose_motion, with_checked
from .page import write_motion_report


def diagnose_with_page(
    session: Session, *, model: Path | None, check: Sequence[Session], most_causes: int
) -> tuple[Diagnosis, Callable[[Path], Path]]:
    """The diagnosis, and what writes its page, pictures and patched model into a folder."""
    done = diagnose_motion(session, model=model, most_causes=min(most_causes, MOST_CAUSES))
    done = with_checked(done, check, model)
    return done.diagnosis, lambda folder: write_motion_report(done, folder)
