"""What all tests share: without a screen MuJoCo renders by EGL, which has to be said before it is first imported."""

from __future__ import annotations

import os
import sys

if sys.platform == "linux" and "DISPLAY" not in os.environ:
    os.environ.setdefault("MUJOCO_GL", "egl")
