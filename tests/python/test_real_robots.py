"""The diagnosis of real robots, whose measurements lie beside the project where there are any (and are never part of it).

A UR10 before a laser tracker (Landgraf et al., CASE 2021, series D): its errors are small ones of many joints and links.
"""

from __future__ import annotations

import pytest

import mirror_posture as mp
from session_folder import DATA

UR10 = DATA / "real" / "ipa_ur10"


@pytest.mark.skipif(not UR10.is_dir(), reason="the real robots' data are not beside the project")
@pytest.mark.parametrize("without", ["joint_coupling"])
def test_an_effect_more_or_less_in_the_vocabulary_does_not_lose_the_small_errors(without: str) -> None:
    """Free-form errors at two joints fit this arm better than small errors everywhere and predict held-out regions twice as badly."""
    session = mp.load_session(UR10 / "D")
    found = mp.diagnose(session, without=[without])
    assert [cause.effect for cause in found.causes] == ["geometry", "gear_eccentricity"]
    assert found.gap.before_m > 1.3e-3
    assert found.gap.after_m < 0.55e-3


@pytest.mark.skipif(not UR10.is_dir(), reason="the real robots' data are not beside the project")
@pytest.mark.parametrize("series", ["A", "B"])
def test_two_series_of_one_arm_have_the_same_eccentric_gear(series: str) -> None:
    """The gear's error is no larger than the small errors, but held-out regions need it."""
    found = mp.diagnose(UR10 / series)
    told = [(cause.effect, cause.at) for cause in found.causes]
    assert told == [("geometry", "robot"), ("gear_eccentricity", "joint:shoulder_pan_joint")]
    assert found.gap.after_m < 0.65e-3 < 1.1e-3 < found.gap.before_m


@pytest.mark.skipif(not UR10.is_dir(), reason="the real robots' data are not beside the project")
def test_an_improbable_outlier_of_the_small_errors_is_told_among_them() -> None:
    """One link's length is needed to predict, and is found among the small errors in all resamples."""
    found = mp.diagnose(UR10 / "D")
    group = next(cause for cause in found.causes if cause.effect == "geometry")
    assert all(cause.probability > 0.05 for cause in found.causes)
    largest = max((m for m in group.members if m.effect == "link_length"), key=lambda m: abs(m.value))
    assert largest.at == "link:upper_arm_link"
