"""Drawn pictures against the light's path that the image points come from, and through the product's own detection."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="blind sessions need MuJoCo")

from mirror_lab.blind import optics
from mirror_lab.blind.drawing import rays, reflected
from mirror_lab.blind.make import make_cases
from mirror_lab.blind.shrinkage import load_pixels
from mirror_lab.blind.simulate import Options, simulate

LENS = optics.Lens(
    np.array([700.0, 702.0]),
    np.array([400.0, 300.0]),
    np.array([-0.06, 0.01, 1e-3, -2e-3, 0.002]),
    (800, 600),
    0.01,
)


@pytest.mark.parametrize(
    ("glass_m", "curvature"), [(0.0, (0, 0)), (0.006, (0, 0)), (0.0, (0.2, 0.2)), (0.0, (-0.3, 0.0))]
)
def test_a_pixels_ray_goes_through_the_point_that_is_seen_there(
    glass_m: float, curvature: tuple[float, float]
) -> None:
    """Two ways along one path: `optics` searches from the point, `pictures` walks from the pixel."""
    rng = np.random.default_rng(0)
    for _ in range(5):
        normal = np.array([0, 0, 1.0]) + rng.normal(0, 0.1, 3)
        normal /= np.linalg.norm(normal)
        point = rng.uniform([-0.2, -0.2, -0.05], [0.2, 0.2, 0.1], (40, 3))
        mirror = optics.Mirror(
            normal[None], np.array([0.35]), glass_m, 1.52, np.array(curvature, dtype=float)
        )
        seen = optics.apparent(mirror.rows(np.zeros(40, dtype=int)), point)
        direction = rays(LENS, LENS.image(seen, 1.01), 1.01)
        origin, out = reflected(mirror, 0, direction)
        off = np.linalg.norm(np.cross(point - origin, out), axis=1)
        assert off.max() < 2e-8, "m from the ray to the point"


def test_detection_finds_in_the_pictures_what_is_there(tmp_path: Path) -> None:
    from mirror_posture.detect import detect_session
    from mirror_posture.session import load_session

    options = Options(pictures=True, frames=(3, 4), least_postures=3)
    (folder,) = make_cases(tmp_path, 1, 5, options, [("drawn", "small", ["mirror_glass"])])
    assert not (folder / "detections.csv").exists()
    with (folder / "frames.csv").open(encoding="utf-8", newline="") as file:
        assert all((folder / row["image"]).is_file() for row in csv.DictReader(file))
    answer = json.loads((tmp_path / "answers" / "drawn.json").read_text(encoding="utf-8"))
    true = load_pixels(tmp_path / "answers" / "drawn.npz", answer["pixels_sha256"])
    got = detect_session(load_session(folder)).session.mirror_view
    assert got is not None and got.board_seen.all() and got.marker_seen.mean() > 0.8
    assert np.sqrt(np.mean((got.board_px - true.corners_px) ** 2)) < 0.15
    blobs = (got.marker_px - true.blobs_px)[got.marker_seen]
    assert np.sqrt(np.nanmean(blobs**2)) < 0.15


def test_mitsuba_draws_the_same_board_at_the_same_place() -> None:
    """A path tracer that nobody here wrote, through a real pane: same handedness, same squares."""
    pytest.importorskip("mitsuba", reason="needs the extra `blind`")
    from mirror_lab.blind import drawing, mitsuba_pictures

    options = Options(pictures=True, frames=(3, 4), least_postures=3)
    case = simulate("case", "small", ["mirror_glass"], np.random.default_rng(5), options)
    small = replace(
        case.lens, focal_px=case.lens.focal_px / 4, center_px=case.lens.center_px / 4, size_px=(200, 150)
    )
    assert case.view is not None
    near = (case.clean_corners_px[0] / 4, case.clean_blobs_px[0] / 4)
    own = drawing.draw(case.robot, small, case.view, 0, near).mean(axis=2)
    theirs = mitsuba_pictures.draw(case.robot, small, case.view, 0, paths=8).mean(axis=2)
    (left, top), (right, bottom) = near[0].min(0).astype(int) - 2, near[0].max(0).astype(int) + 3
    both = np.corrcoef(own[top:bottom, left:right].ravel(), theirs[top:bottom, left:right].ravel())[0, 1]
    mirrored = np.corrcoef(
        own[top:bottom, left:right].ravel(), theirs[top:bottom, left:right][:, ::-1].ravel()
    )
    assert both > 0.9 > mirrored[0, 1]
