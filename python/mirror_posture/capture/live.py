"""The state that the capture's page shows: JSON, and the last picture with its detections.

Both are read without the capture's lock: a moving robot must not stop the page.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ..robots.protocol import ImagePoints
from .loop import Capture

LIVE_WIDTH_PX = 800
DEGREES, MILLIMETRES = "°", " mm"


def state_of(capture: Capture) -> dict[str, Any]:
    """What the page shows, as JSON holds it."""
    current, found = capture.current, capture.found
    markers = capture.nominal.metadata.markers
    shown = [] if current is None else _joints(capture, current.commanded)
    return {
        "stage": capture.stage.value,
        "message": capture.message,
        "taken": sorted(capture.recorder.taken),
        "skipped": dict(capture.skipped),
        "planned": len(capture.plan),
        "motion": round(capture.stillness.motion, 2),
        "live": capture.source.live,
        "robot": None if capture.robot is None else capture.robot.name,
        "next": None
        if current is None
        else {
            "frame": current.frame,
            "posture": current.posture,
            "view": current.view,
            "joints": shown,
            "joints_deg": {one["name"]: one["value"] for one in shown if one["unit"] == DEGREES},
        },
        "board": bool(found is not None and found.board_seen.any()),
        "markers": [
            {
                "name": m.name,
                "hue": None if m.color is None else m.color.hue_deg,
                "seen": bool(found is not None and found.marker_seen[i]),
            }
            for i, m in enumerate(markers)
        ],
        "reasons": [] if found is None else list(found.reasons),
    }


def _joints(capture: Capture, commanded: Mapping[str, float]) -> list[dict[str, Any]]:
    """Each joint with its value and unit as a person measures it: degrees, or mm where it slides."""
    slides = {joint.name for joint in capture.nominal.robot.joints if joint.kind == "prismatic"}
    return [
        {"name": name, "value": round(1000.0 * float(value), 1), "unit": MILLIMETRES}
        if name in slides
        else {"name": name, "value": round(float(np.degrees(value)), 1), "unit": DEGREES}
        for name, value in commanded.items()
    ]


def live_jpeg(capture: Capture) -> bytes | None:
    """The last picture, small, with its detections drawn over it; None before the first."""
    shot, found = capture.last, capture.found
    if shot is None:
        return None
    scale = min(1.0, LIVE_WIDTH_PX / shot.picture.shape[1])
    size = (round(shot.picture.shape[1] * scale), round(shot.picture.shape[0] * scale))
    small = cv2.resize(shot.picture, size, interpolation=cv2.INTER_AREA)
    if found is not None:
        _draw(small, found, scale)
    return bytes(cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, 80])[1])


def _draw(picture: npt.NDArray[Any], found: ImagePoints, scale: float) -> None:
    for u, v in found.board_px[found.board_seen]:
        cv2.circle(picture, (round(u * scale), round(v * scale)), 3, (0, 200, 0), -1, cv2.LINE_AA)
    for u, v in found.marker_px[found.marker_seen]:
        at = (round(u * scale), round(v * scale))
        cv2.circle(picture, at, 13, (255, 255, 255), 4, cv2.LINE_AA)
        cv2.circle(picture, at, 13, (0, 160, 0), 2, cv2.LINE_AA)
