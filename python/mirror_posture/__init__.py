"""A robot measures, corrects and diagnoses its own posture in a mirror.

    import mirror_posture as mp

    session = mp.load_session("my-session")          # a folder: model, camera, pictures or image points
    session = mp.detect_session(session).session     # pictures to image points
    found = mp.measure(session)                      # mirrors and markers, with covariances
    found.markers.point_in_root_m, found.markers.covariance_in_root_m2, found.markers.model_in_root_m
    mp.diagnose(session).causes                      # what is wrong with the model, where, and by which effect

NumPy in and out, batches first, one row a frame or a marker. Every error is a `MirrorPostureError`. What the modules
hold besides: `robot` (kinematics), `mirror` (the estimators), `triangulate`, `optics` (glass, balls), `calibrate`,
`detect` (pictures), `render` (pictures with truth), `session` (files).
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from ._core import Camera, MirrorPostureError, __version__

if TYPE_CHECKING:
    from .calibrate import calibrate_from_mirror_views, calibrate_with_second_camera
    from .detect import detect_picture, detect_session
    from .diagnosis import Diagnosis, diagnose
    from .measurement import Measurement, MeasureOptions, measure, measure_all
    from .render import render_session
    from .robot import Robot
    from .session import Session, SessionError, load_session, write_session

# Loaded when first asked for: OpenCV and Arrow take longer to load than most commands run.
_HOME = {
    "Diagnosis": "diagnosis",
    "MeasureOptions": "measurement",
    "Measurement": "measurement",
    "Robot": "robot",
    "Session": "session",
    "SessionError": "session",
    "calibrate_from_mirror_views": "calibrate",
    "calibrate_with_second_camera": "calibrate",
    "detect_picture": "detect",
    "detect_session": "detect",
    "diagnose": "diagnosis",
    "load_session": "session",
    "measure": "measurement",
    "measure_all": "measurement",
    "render_session": "render",
    "write_session": "session",
}

__all__ = [
    "Camera",
    "Diagnosis",
    "MeasureOptions",
    "Measurement",
    "MirrorPostureError",
    "Robot",
    "Session",
    "SessionError",
    "__version__",
    "calibrate_from_mirror_views",
    "calibrate_with_second_camera",
    "detect_picture",
    "detect_session",
    "diagnose",
    "load_session",
    "measure",
    "measure_all",
    "render_session",
    "write_session",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f".{_HOME[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
