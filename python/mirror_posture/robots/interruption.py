"""Signals that end a program are turned into an exception, so that a robot is brought to rest before the
program ends.

`SIGINT` raises `KeyboardInterrupt` in Python already. `SIGTERM` and `SIGHUP` would end the program between
two instructions, with the torque on.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

ENDING = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP", "SIGBREAK") if hasattr(signal, name))
"""Signals that end a program without a handler; not all exist on every system."""


class Interrupted(SystemExit):
    """A signal that ends the program; if it is not caught the program ends with code 128 + its number."""

    def __init__(self, number: int) -> None:
        super().__init__(128 + number)
        self.signal_name = signal.Signals(number).name

    def __str__(self) -> str:
        return self.signal_name


def _raise(number: int, frame: FrameType | None) -> None:
    raise Interrupted(number)


class _Handlers:
    """Handlers that are installed while they are needed, once for all robots."""

    def __init__(self) -> None:
        self.users = 0
        self.before: dict[int, Any] = {}
        self.process = 0

    def acquire(self) -> bool:
        if threading.current_thread() is not threading.main_thread():
            return False
        if self.users == 0 or self.process != os.getpid():
            self.users, self.process, self.before = 0, os.getpid(), {}
            for number in ENDING:
                # Somebody's own handler is theirs; an ignored SIGHUP is nohup's, and meant.
                if signal.getsignal(number) is signal.SIG_DFL:
                    self.before[number] = signal.signal(number, _raise)
        self.users += 1
        return True

    def release(self) -> None:
        if self.users == 0 or self.process != os.getpid():
            return
        self.users -= 1
        if self.users or threading.current_thread() is not threading.main_thread():
            return
        for number, handler in self.before.items():
            if signal.getsignal(number) is _raise:
                signal.signal(number, handler)
        self.before = {}


_handlers = _Handlers()


def handle_ending_signals() -> bool:
    """Makes signals that end the program raise `Interrupted` until `let_signals_end` was called as often.

    Only the main thread can do that; returns whether it was done. The user's own handlers are not replaced.
    """
    return _handlers.acquire()


def let_signals_end() -> None:
    """The opposite of `handle_ending_signals`."""
    _handlers.release()


@contextmanager
def ending_signals() -> Iterator[None]:
    """Within it `SIGTERM` and `SIGHUP` raise `Interrupted`, as Ctrl-C raises `KeyboardInterrupt`."""
    acquired = handle_ending_signals()
    try:
        yield
    finally:
        if acquired:
            let_signals_end()


@contextmanager
def undisturbed() -> Iterator[None]:
    """Within it no signal breaks off what makes a robot safe; the first that came is raised afterwards."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    before = {}
    for number in (signal.SIGINT, *ENDING):
        handler = signal.getsignal(number)
        # None: a handler that was not installed from Python cannot be restored.
        if handler is not None and handler is not signal.SIG_IGN:
            before[number] = signal.signal(number, lambda n, frame: came.append(n))
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    # Reached only where nothing else is being raised, which has priority.
    if came:
        signal.raise_signal(came[0])
