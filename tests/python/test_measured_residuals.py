"""What residuals say of a claim: on chi-squared of known noise, and on a session whose camera sits elsewhere."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirror_posture import Board, Camera, MirrorPostureError, picture_residuals
from mirror_posture.measurement.inputs import core_input, nominal_camera_from_board
from mirror_posture.measurement.residuals import (
    DISAGREEING_MARKER,
    Assumed,
    excess_of_markers,
    judge_views,
    widen_markers,
)
from mirror_posture.mirror import Rig
from test_measurement import simulated


@pytest.mark.parametrize("factor", [1.0, 1.6])
def test_the_excess_of_markers_is_how_much_larger_their_deviations_are(factor: float) -> None:
    random = np.random.default_rng(2)
    freedom = np.tile([1, 2, 3, 5], 1500)
    chi_squared = factor**2 * random.chisquare(freedom)
    assert excess_of_markers(chi_squared, freedom) == pytest.approx(factor, rel=0.03)
    # Two views of one marker leave nothing to tell by, and less than was assumed claims no better.
    assert excess_of_markers(np.zeros(3), np.array([0, 0, 0])) == 1.0
    assert excess_of_markers(0.2 * chi_squared, freedom) == 1.0


def test_a_marker_whose_views_disagree_is_widened_by_as_much_as_they_do() -> None:
    random = np.random.default_rng(3)
    half = random.normal(size=(3, 3, 3))
    covariance = half @ half.swapaxes(1, 2)
    # A deviation that is three times as large as was claimed: nine times its square.
    wider, reasons = widen_markers(covariance, np.array([27.0, 3.0, 0.0]), np.array([3, 3, 0]))
    np.testing.assert_allclose(wider, covariance * np.array([9.0, 1.0, 1.0])[:, None, None])
    assert reasons == [None, None, None]
    far = 3.0 * (1.1 * DISAGREEING_MARKER) ** 2
    _, (reason,) = widen_markers(covariance[:1], np.array([far]), np.array([3]))
    assert reason is not None and "disagree" in reason


def test_what_corners_show_beyond_their_noise_is_taken_for_a_turn_of_the_mount(tmp_path: Path) -> None:
    session = simulated(tmp_path, noise_px=0.3, postures=12)
    core = core_input(session, nominal_camera_from_board(session))
    corners = session.mirror_view.board_px
    lever_px = np.sqrt(((corners - corners.mean(axis=1, keepdims=True)) ** 2).sum(axis=2).mean(axis=1))
    # Variances add: 0.3 px are 0.15 px of noise and 0.26 px of something else.
    turn = np.sqrt(0.3**2 - 0.15**2) / np.median(lever_px)
    tested = judge_views(session, core, Assumed(0.15, 0.15, None), 0.01, False)
    shown = tested.assumed.mount_covariance
    assert shown is not None and len(tested.warnings) == 1
    assert tested.assumed.corner_noise_px == pytest.approx(0.3, rel=0.05)
    assert np.sqrt(shown[0, 0]) == pytest.approx(turn, rel=0.08)
    # What was stated stays where it is more, with its correlations.
    stated = np.diag([(5.0 * turn) ** 2] * 3 + [1e-12] * 3)
    stated[0, 1] = stated[1, 0] = 0.5 * stated[0, 0]
    wider = judge_views(session, core, Assumed(0.15, 0.15, stated), 0.01, False).assumed.mount_covariance
    assert wider is not None
    np.testing.assert_allclose(wider[:3, :3], stated[:3, :3])
    assert np.diag(wider)[3:] == pytest.approx(np.diag(shown)[3:])
    # The noise as it is: nothing is widened.
    assert judge_views(session, core, Assumed(0.3, 0.3, None), 0.01, False).warnings == ()


@pytest.mark.parametrize("hidden", [0, 1, 5])
def test_what_a_view_shows_of_its_noise_counts_the_planes_three_numbers(hidden: int) -> None:
    random = np.random.default_rng(6)
    camera, board = Camera((1400, 1200), (693.0, 693.0), (699.5, 599.5)), Board(4, 3, 0.014)
    # The board beside the camera, its face to the mirror: x and z turned about.
    pose = np.diag([-1.0, 1.0, -1.0, 1.0])
    pose[:3, 3] = 0.02, 0.075, 0.01
    points = board.corner_in_board_m @ pose[:3, :3].T + pose[:3, 3]
    normal = np.array([0.1, -0.05, 1.0]) / np.linalg.norm([0.1, -0.05, 1.0])
    images = points + 2.0 * (0.16 - points @ normal)[:, None] * normal
    rig = Rig(camera, board, pose)
    squares = []
    for _ in range(150 if hidden < 5 else 400):
        seen = camera.project(images) + random.normal(0.0, 0.5, (12, 2))
        # Before, one hidden corner ended it: "smallest eigenvalue of the camera-board covariance: got NaN".
        seen[random.permutation(12)[:hidden]] = np.nan
        mirrors, warnings = picture_residuals.tested_mirrors(rig, seen[None], 0.1, ["drawn"])
        assert len(warnings) == 1
        squares.append(float(mirrors.noise_px[0]) ** 2)
    # 24 numbers less 3: the mean of χ² of 21 degrees of freedom, 150 times, is known to 3 %; of 11, 400 times, to 2 %.
    assert np.mean(squares) == pytest.approx(0.5**2, rel=0.08)


def test_a_view_of_no_corner_is_refused_and_the_worst_of_several_may_hide_some() -> None:
    random = np.random.default_rng(8)
    camera, board = Camera((1400, 1200), (693.0, 693.0), (699.5, 599.5)), Board(7, 5, 0.014)
    pose = np.diag([-1.0, 1.0, -1.0, 1.0])
    pose[:3, 3] = 0.04, 0.075, 0.01
    points = board.corner_in_board_m @ pose[:3, :3].T + pose[:3, 3]
    images = points + 2.0 * (0.16 - points[:, 2:]) * np.array([0.0, 0.0, 1.0])
    seen = camera.project(images) + random.normal(0.0, 1.0, (2, 35, 2)) * np.array([0.1, 0.5])[:, None, None]
    rig = Rig(camera, board, pose)
    whole, _ = picture_residuals.tested_mirrors(rig, seen, 0.1, ["good", "worse"])
    seen[1, :7] = np.nan
    part, warnings = picture_residuals.tested_mirrors(rig, seen, 0.1, ["good", "worse"])
    assert part.valid.all() and len(warnings) == 1
    # A fifth of the corners less says less; what is left of them shows other noise, whose square multiplies the covariance.
    assert part.noise_px[0] == pytest.approx(whole.noise_px[0], rel=0.2)
    ratio = part.covariances_m2[0].trace() / whole.covariances_m2[0].trace()
    assert 1.0 <= ratio / float(part.noise_px[0] / whole.noise_px[0]) ** 2 < 1.25, ratio
    seen[1] = np.nan
    with pytest.raises(MirrorPostureError, match=r"worse: .*does not fit"):
        picture_residuals.tested_mirrors(rig, seen, 0.1, ["good", "worse"])


def test_a_boards_stated_deviation_stays_beside_what_its_corners_show() -> None:
    random = np.random.default_rng(7)
    camera, board = Camera((1400, 1200), (693.0, 693.0), (699.5, 599.5)), Board(7, 5, 0.014)
    pose = np.diag([-1.0, 1.0, -1.0, 1.0])
    pose[:3, 3] = 0.04, 0.075, 0.01
    points = board.corner_in_board_m @ pose[:3, :3].T + pose[:3, 3]
    images = points + 2.0 * (0.16 - points[:, 2:]) * np.array([0.0, 0.0, 1.0])
    seen = camera.project(images) + random.normal(0.0, 0.4, (35, 2))
    spreads = []
    for stated in (None, np.diag([1e-2**2] * 3 + [3e-3**2] * 3)):
        mirrors, _ = picture_residuals.tested_mirrors(
            Rig(camera, board, pose, stated), seen[None], 0.1, ["drawn"]
        )
        spreads.append(float(mirrors.covariances_m2[0, 2, 2]))
    # 3 mm along the axis move the mirror's foot by 1.5 mm.
    assert spreads[1] > spreads[0] + 0.8 * 1.5e-3**2
