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
    assert found.gap.after_m < 0.7e-3
