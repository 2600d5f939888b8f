"""Lens, board and glass that differ from their files: the optics through which the simulated body is seen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from mirror_posture import MirrorPostureError

from .changed import Changed, Law, Values


def in_lens(change: Callable[[Any, Values], dict[str, Any]]) -> Law:
    def law(changed: Changed, name: str, value: Values) -> tuple[str, str]:
        camera = changed.session.camera
        if camera is None:
            raise MirrorPostureError("the session has no camera; a cause at the camera is of another session")
        fields = change(camera, value)
        changed.session = replace(changed.session, camera=replace(camera, **fields))
        return "", f"camera: {', '.join(fields)}"

    return law


def focal(camera: Any, value: Values) -> dict[str, Any]:
    factor = 1.0 + value["scale_error"]
    return {"focal_px": (factor * camera.fx_px, factor * camera.fy_px)}


def center(camera: Any, value: Values) -> dict[str, Any]:
    return {"center_px": (camera.cx_px + value.get("du_px", 0.0), camera.cy_px + value.get("dv_px", 0.0))}


def lens(camera: Any, value: Values) -> dict[str, Any]:
    first, *rest = camera.distortion or (0.0,) * 5
    model = "plumb_bob" if camera.distortion_model == "none" else camera.distortion_model
    return {"distortion_model": model, "distortion": (first + value["dk1"], *rest)}


def board_scale(changed: Changed, name: str, value: Values) -> tuple[str, str]:
    board = changed.session.board
    if board is None:
        raise MirrorPostureError("the session has no board; a cause at the board is of another session")
    square_m = (1.0 + value["scale_error"]) * board.square_m
    changed.session = replace(changed.session, board=replace(board, square_m=square_m))
    return "", f"board: squares of {square_m * 1e3:.4f} mm"


def mirror_glass(changed: Changed, name: str, value: Values) -> tuple[str, str]:
    mirror = changed.session.mirror
    if mirror is None:
        raise MirrorPostureError("the session has no mirror; a cause at the mirror is of another session")
    thickness = max(0.0, value["thickness_m"])
    changed.session = replace(changed.session, mirror=replace(mirror, glass_thickness_m=thickness))
    return "", f"mirror: {thickness * 1e3:.3f} mm of glass"
