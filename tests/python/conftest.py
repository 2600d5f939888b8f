"""What all tests share: how MuJoCo renders, which has to be said before it is first imported; Ctrl-C; the cases of property tests."""

from __future__ import annotations

import os
import signal
import sys

from hypothesis import settings

# A shell starts what runs in its background with SIGINT ignored, and children inherit that: tests of Ctrl-C would wait
# for what never comes.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
# The same of a closed terminal, under `nohup`.
if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

# Without a screen MuJoCo renders by EGL.
if sys.platform == "linux" and "DISPLAY" not in os.environ:
    os.environ.setdefault("MUJOCO_GL", "egl")

# Property tests draw the same cases in every run, so that a test fails by a change and never by chance.
# Other cases: `pytest --hypothesis-profile=default`.
settings.register_profile("repeatable", derandomize=True)
settings.load_profile("repeatable")
