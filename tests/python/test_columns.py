"""A column of tubes that slide out of each other: its bending, and the play of its guide, told by their names and in their sizes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import mirror_posture as mp
from lifting_column import READ_M_PER_S2, TUBE_M, write_column


def test_bending_that_grows_with_extension_and_play_in_tilt_are_told_apart(tmp_path: Path) -> None:
    softness = (2e-5, 4e-5)
    found = mp.diagnose(write_column(tmp_path / "both", 1, softness, play_rad=0.004))
    causes = {cause.effect: cause for cause in found.causes}
    assert set(causes) == {"column_bending", "tilt_play_1"}
    assert {cause.at for cause in found.causes} == {"link:tube"}
    assert all(cause.probability > 0.9 for cause in found.causes)
    gap = found.gap
    assert gap.before_m and gap.after_m and gap.after_m < 0.25 * gap.before_m
    # The tip's slope for each newton metre, half out: what the slices' slopes add up to. Direction 1 is y, direction 2 is x.
    lift, extension = 0.6, 1.2
    z = np.linspace(0.0, TUBE_M + extension, 2001)
    tubes = sum(((b < z) & (z < b + TUBE_M)).astype(int) for b in (0.0, lift, extension))
    length = float(np.mean(1.0 / np.maximum(tubes, 1))) * (TUBE_M + extension)
    told = {name: value.value for name, value in causes["column_bending"].parameters.items()}
    grown = extension / (1.0 - extension / (1.2 * 2.4))
    for direction, soft in (("1", softness[1]), ("2", softness[0])):
        slope = told[f"compliance_{direction}_rad_per_nm"] + grown * told[f"growth_{direction}_rad_per_nm_m"]
        assert 0.75 < slope / (soft * length) < 1.25, (direction, slope, soft * length)
    play = causes["tilt_play_1"].parameters
    width = play["width_rad"].value + grown * play["growth_rad_per_m"].value
    true = 0.004 * (TUBE_M / 2.0) / (TUBE_M - lift)
    assert 0.6 < width / true < 1.4, (width, true)


def test_play_alone_is_no_bending_and_a_stiff_column_is_nothing(tmp_path: Path) -> None:
    play = mp.diagnose(write_column(tmp_path / "play", 3, (0.0, 0.0), play_rad=0.004))
    assert [cause.effect for cause in play.causes] == ["tilt_play_1"]
    stiff = mp.diagnose(write_column(tmp_path / "stiff", 4, (0.0, 0.0), play_rad=0.0))
    assert stiff.verdict == "none" and not stiff.causes


def test_a_floor_that_yields_is_told_and_the_arms_accelerometer_agrees(tmp_path: Path) -> None:
    found = mp.diagnose(
        write_column(tmp_path / "soft", 5, (0.0, 0.0), 0.0, ground_rad_per_nm=(4e-5, 8e-5), sensor=True)
    )
    assert [cause.effect for cause in found.causes] == ["transverse_compliance"]
    (witness,) = found.document["accelerometer_witness"]
    assert witness["named"]
    # Two axes across the direction each have the noise.
    noise_rad = READ_M_PER_S2 / 9.81 * np.sqrt(2.0)
    assert witness["before_rad"] > 4.0 * noise_rad
    assert witness["after_rad"] < 1.2 * noise_rad
