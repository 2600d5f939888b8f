"""What all tests share: without a screen MuJoCo renders by EGL, which has to be said before it is first imported."""

from __future__ import annotations

import os
import sys

from hypothesis import settings

if sys.platform == "linux" and "DISPLAY" not in os.environ:
    os.environ.setdefault("MUJOCO_GL", "egl")

# Property tests draw the same cases in every run, so that a test fails by a change and never by chance.
# Other cases: `pytest --hypothesis-profile=default`.
settings.register_profile("repeatable", derandomize=True)
settings.load_profile("repeatable")
