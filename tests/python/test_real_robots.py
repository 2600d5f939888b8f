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
    assert [cause.effect for cause in found.causes] == ["geometry"]
    assert found.gap.before_m > 1.3e-3
    assert found.gap.after_m < 0.55e-3


@pytest.mark.skipif(not UR10.is_dir(), reason="the real robots' data are not beside the project")
def test_small_errors_with_those_of_the_transmissions_predict_the_other_series() -> None:
    """Each joint has a curve of its own; what an eccentric gear explained is a part of it."""
    found = mp.diagnose(UR10 / "B", check=[UR10 / "C", UR10 / "D"])
    assert [(cause.effect, cause.at) for cause in found.causes] == [("geometry", "robot")]
    assert "transmission_error" in {member.effect for member in found.causes[0].members}
    assert found.gap.after_m < 0.25e-3 < 1.1e-3 < found.gap.before_m
    of_c, of_d = found.gap.checked
    assert of_c.after_m < 0.5e-3 < 0.9e-3 < of_c.before_m and of_d.after_m < 0.3e-3


@pytest.mark.skipif(not UR10.is_dir(), reason="the real robots' data are not beside the project")
def test_an_improbable_outlier_of_the_small_errors_is_told_among_them() -> None:
    """One link's length is needed to predict, and is found among the small errors in all resamples."""
    found = mp.diagnose(UR10 / "D")
    group = next(cause for cause in found.causes if cause.effect == "geometry")
    assert all(cause.probability > 0.05 for cause in found.causes)
    largest = max((m for m in group.members if m.effect == "link_length"), key=lambda m: abs(m.value))
    assert largest.at == "link:upper_arm_link"
