"""A camera of another curve than sRGB's: what the balls' channels show of it, and that the claims hold it."""

from __future__ import annotations

import numpy as np
import pytest

from mirror_posture.detect import detect_markers
from mirror_posture.detect.ball import OutlineFit
from mirror_posture.detect.curve import Curve, board_curve, curve_doubt, with_curve_doubt
from mirror_posture.detect.sharpening import MOST_STRENGTH_PX2, ghost_and_sharpening
from outline_fits import outline_fit
from test_blurred_balls import BALLS, CAMERA, MARKERS, expected, light, outline
from test_detect_ghost import BOARD
from test_detect_sharpening import drawn_of, light_of_a_board, pictured, sharpened


def told_by(deviations: float | None) -> OutlineFit:
    """A ball whose channels say so much of the curve."""
    return outline_fit((40.0, 30.0), 9.0, curve_deviations=deviations, curve_moved_px=np.array([0.03, 0.0]))


def test_several_balls_must_agree_that_the_curve_is_another() -> None:
    told = [told_by(one) for one in (-3.0, -3.2, -3.4, -3.1)]
    assert curve_doubt(told) == pytest.approx(3.15 - 0.7)
    assert curve_doubt(told[:2]) == 1.0
    # Balls that contradict each other show their own shading.
    assert curve_doubt([told_by(one) for one in (-6.0, 5.0, 2.0, -1.0)]) == pytest.approx(1.0, abs=0.1)
    assert curve_doubt([None, told_by(None), *told[:2]]) == 1.0


def test_balls_that_show_the_usual_curve_lessen_the_doubt() -> None:
    """A measurement of 0 with a deviation as large as the prior's halves the variance."""
    told = [told_by(one) for one in (-0.1, 0.1, 0.0, 0.05)]
    assert curve_doubt(told) == pytest.approx(np.sqrt(0.5), abs=0.01)
    fit = with_curve_doubt(told_by(0.0), curve_doubt(told))
    assert fit is not None
    assert np.linalg.eigvalsh(fit.centroid_covariance_px2).min() > 0.0
    assert fit.centroid_covariance_px2[0, 0] < told_by(0.0).centroid_covariance_px2[0, 0]


def test_a_doubted_curve_widens_a_claim_where_it_moves_the_ball() -> None:
    fit = told_by(-3.0)
    wide = with_curve_doubt(fit, 3.0)
    assert wide is not None
    assert wide.centroid_covariance_px2 - fit.centroid_covariance_px2 == pytest.approx(
        np.diag([8.0 * 0.03**2, 0.0])
    )
    assert with_curve_doubt(fit, 1.0) is fit and with_curve_doubt(None, 3.0) is None


@pytest.mark.parametrize(("power", "least"), [(0.75, 1.3), (1.35, 1.0)])
def test_pictures_of_another_curve_are_claimed_less(power: float, least: float) -> None:
    """The same light by two curves: the balls' errors grow where the background differs from side to side, and the claims must."""
    noise = np.random.default_rng(3).normal(0.0, 1.0, (240, 320, 3))
    picture = np.clip(np.rint(255.0 * light() ** (power / 2.2) + noise), 0, 255).astype(np.uint8)
    own = np.clip(np.rint(255.0 * light() ** (1.0 / 2.2) + noise), 0, 255).astype(np.uint8)
    views = detect_markers(picture, MARKERS, CAMERA, expected=expected(1))
    others = detect_markers(own, MARKERS, CAMERA, expected=expected(1))
    assert len(views) == len(BALLS) and all(view.ok for view in views)
    claimed = [float(np.sqrt(np.trace(view.covariance_px2))) for view in views]
    usual = [float(np.sqrt(np.trace(view.covariance_px2))) for view in others]
    assert max(np.divide(claimed, usual)) >= least
    for view in views:
        error = np.subtract(view.pixel_px, outline(view.name)[0])
        assert float(error @ np.linalg.solve(view.covariance_px2, error)) < 12.0, view.name


def told_by_board(power: float, seed: int, ghost: float = 0.0, strength: float = 0.0) -> Curve:
    """What a board shows whose levels (0..1) are sRGB's to a power."""
    levels = pictured(light_of_a_board(seed), seed, ghost) / 255.0
    graded = np.clip(np.rint(255.0 * levels**power), 0, 255).astype(np.uint8)
    drawn = drawn_of(sharpened(graded, strength))
    found = board_curve(drawn, BOARD, *ghost_and_sharpening(drawn, None))
    assert found is not None
    return found


@pytest.mark.parametrize("ghost", [0.0, 0.06])
def test_a_board_tells_the_usual_curve_and_another(ghost: float) -> None:
    """The light of a level L is sRGB's of L^(1 / power): about its power of that."""
    for seed in range(3):
        usual, darker = told_by_board(1.0, seed, ghost), told_by_board(1.3, seed, ghost)
        assert abs(usual.deviations) < 0.4 and usual.std < 0.75, usual
        true = -np.log(1.3) / np.log(1.085)
        assert darker.deviations < -1.5 and abs(darker.deviations - true) < 2.5 * darker.std, darker
        # A curve that is far from the usual one is known less well: one power is not all of it.
        assert darker.std > usual.std


def test_where_sharpening_was_undone_the_curve_is_known_less_well(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its strength was told by sRGB's curve, and hides another one."""
    told = told_by_board(1.0, 0, strength=0.25)
    monkeypatch.setattr("mirror_posture.detect.curve.SHARPENING_STD_PX2", 0.0)
    assert told.std > told_by_board(1.0, 0, strength=0.25).std + 0.02


def test_a_board_that_looks_sharper_than_cameras_make_it_tells_no_curve() -> None:
    drawn = drawn_of(pictured(light_of_a_board(1), 1))
    assert board_curve(drawn, BOARD, None, 0.5) is not None
    assert board_curve(drawn, BOARD, None, MOST_STRENGTH_PX2) is None


def test_the_curve_that_a_board_tells_is_in_the_claims() -> None:
    """Known well, the curve's part of the covariances is less."""
    noise = np.random.default_rng(3).normal(0.0, 1.0, (240, 320, 3))
    picture = np.clip(np.rint(255.0 * light() ** (1.0 / 2.2) + noise), 0, 255).astype(np.uint8)
    claimed = [
        [
            np.trace(view.covariance_px2)
            for view in detect_markers(picture, MARKERS, CAMERA, expected=expected(1), curve=curve)
        ]
        for curve in (Curve(0.0, 0.1), Curve(0.0, 1.0), Curve(0.0, 3.0))
    ]
    assert np.all(np.diff(claimed, axis=0) >= 0.0) and np.max(np.diff(claimed, axis=0)) > 0.0
