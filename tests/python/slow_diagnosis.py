"""A diagnosis that takes its time, for tests in which a worker is lost while it has a job."""

from __future__ import annotations

import time

from mirror_posture.fleet import PackedSession, diagnose_packed


def diagnose_slowly(session: PackedSession) -> str:
    """The diagnosis, not before a second is over."""
    time.sleep(1.0)
    return diagnose_packed(session)
