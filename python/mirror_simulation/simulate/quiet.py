"""Simulations that diverge without a trace in the user's folder."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import mujoco

_lock = threading.Lock()
_running = 0
_heard: Callable[..., Any] | None = None


@contextmanager
def quiet() -> Iterator[None]:
    """While it lasts MuJoCo writes no MUJOCO_LOG.TXT into the working directory, in any thread: the caller says what diverges."""
    global _running, _heard
    with _lock:
        if not _running:
            _heard = mujoco.get_mju_user_warning()
            mujoco.set_mju_user_warning(lambda _: None)
        _running += 1
    try:
        yield
    finally:
        with _lock:
            _running -= 1
            if not _running:
                mujoco.set_mju_user_warning(_heard)
