"""A robot measures, corrects and diagnoses its own posture in a mirror.

    import mirror_posture as mp

    session = mp.load_session("my-session")          # a folder: model, camera, pictures or image points
    session = mp.detect_session(session).session     # pictures to image points
    found = mp.measure(session)                      # mirrors and markers, with covariances
    found.markers.point_in_root_m, found.markers.covariance_in_root_m2, found.markers.model_in_root_m
    mp.diagnose(session).causes                      # what is wrong with the model, where, and by which effect

NumPy in and out, batches first, one row a frame or a marker. Every error is a `MirrorPostureError`; Ctrl-C during a diagnosis
raises `DiagnosisInterrupted`, a `KeyboardInterrupt`. What the modules hold besides: `robot` (kinematics), `mirror` (the estimators), `triangulate`, `optics` (glass, balls), `calibrate`,
`detect` (pictures), `render` (pictures with truth), `session` (files).
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from ._core import MirrorPostureError, __version__

if TYPE_CHECKING:
    from .board import Board
    from .calibrate import calibrate_from_mirror_views, calibrate_with_second_camera
    from .camera import Camera
    from .detect import detect_picture, detect_session
    from .diagnosis import Diagnosis, DiagnosisInterrupted, diagnose
    from .marker import ColorRange, Marker
    from .measurement import Measurement, MeasureOptions, measure, measure_all
    from .mirror import Mirror
    from .mirror_pictures import markers_from_views, mirror_from_picture, mirrors_from_pictures
    from .render import render_session
    from .robot import Robot
    from .session import Session, SessionError, load_session, write_session

# Loaded at first use: OpenCV and Arrow take longer to load than most commands run.
_HOME = {
    "Board": "board",
    "Camera": "camera",
    "ColorRange": "marker",
    "Diagnosis": "diagnosis",
    "DiagnosisInterrupted": "diagnosis",
    "Marker": "marker",
    "MeasureOptions": "measurement",
    "Measurement": "measurement",
    "Mirror": "mirror",
    "Robot": "robot",
    "Session": "session",
    "SessionError": "session",
    "calibrate_from_mirror_views": "calibrate",
    "calibrate_with_second_camera": "calibrate",
    "detect_picture": "detect",
    "detect_session": "detect",
    "diagnose": "diagnosis",
    "load_session": "session",
    "markers_from_views": "mirror_pictures",
    "measure": "measurement",
    "measure_all": "measurement",
    "mirror_from_picture": "mirror_pictures",
    "mirrors_from_pictures": "mirror_pictures",
    "render_session": "render",
    "write_session": "session",
}

__all__ = [
    "Board",
    "Camera",
    "ColorRange",
    "Diagnosis",
    "DiagnosisInterrupted",
    "Marker",
    "MeasureOptions",
    "Measurement",
    "Mirror",
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
    "markers_from_views",
    "measure",
    "measure_all",
    "mirror_from_picture",
    "mirrors_from_pictures",
    "render_session",
    "write_session",
]


_MODULES = frozenset(
    "calibrate camera correct detect diagnosis measurement mirror optics render robot robots session triangulate".split()
)


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return importlib.import_module(f".{name}", __name__)
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f".{_HOME[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, *_MODULES})
