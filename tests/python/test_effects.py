"""The core's vocabulary of effects is the only one: Python's tables and the documents say what it says."""

import re
from pathlib import Path

import pytest

from mirror_posture._core import MirrorPostureError, effects, mistakes
from mirror_posture.diagnosis import formatting, vocabulary
from mirror_posture.diagnosis.applied import apply, mjcf

ROOT = Path(__file__).parents[2]


def test_names_are_the_cores() -> None:
    names = [effect["name"] for effect in effects()]
    assert len(set(names)) == len(names) >= 19
    assert vocabulary.EFFECTS == (*names, "geometry", "pairing", *vocabulary.MISTAKES)
    # Those of the format, and measured points in a left-handed frame.
    assert len(vocabulary.MISTAKES) == 12 + 1
    assert vocabulary.checked_effects(["backlash", "pairing"]) == ["backlash", "pairing"]
    with pytest.raises(MirrorPostureError, match=r"needed one of joint_compliance, .* more"):
        vocabulary.checked_effects(["compliance"])


def test_each_parameter_has_a_unit_for_people() -> None:
    unitless = {"dk1"}
    for effect in effects():
        for parameter in effect["parameters"]:
            assert parameter in unitless or any(parameter.endswith(ending) for ending in formatting.UNITS), (
                parameter
            )


def test_the_documents_table_says_what_the_core_says() -> None:
    text = (ROOT / "docs" / "effects.md").read_text(encoding="utf-8")
    rows = {
        m[1]: m.groups()[1:] for m in re.finditer(r"^\| `(\w+)` \| (.+?) \| (.+?) \| (.+?) \|$", text, re.M)
    }
    for effect in effects():
        told = (effect["signature"], effect["shown_by"], effect["confused_with"])
        assert rows[effect["name"]] == told, effect["name"]


def test_the_documents_table_of_mistakes_says_what_the_core_says() -> None:
    text = (ROOT / "docs" / "effects.md").read_text(encoding="utf-8")
    rows = {m[1]: m.groups()[1:] for m in re.finditer(r"^\| `(\w+)` \| (.+?) \| (.+?) \|$", text, re.M)}
    for mistake in mistakes():
        if mistake["is_mistake"]:
            assert rows[mistake["name"]] == (mistake["signature"], mistake["remedy"]), mistake["name"]


def test_a_joint_s_law_is_told_term_by_term() -> None:
    """What is fed forward, written and simulated is what the effect says of itself, not a list of names in Python."""
    for effect in effects():
        values = {name: 0.01 * (k + 1) for k, name in enumerate(effect["parameters"])}
        terms = vocabulary.joint_terms(effect["name"], values)
        assert list(terms.values()) == (list(values.values()) if effect["joint_law"] else []), effect["name"]
        assert effect["fed_forward"] == bool(terms.keys() - {"rate"}), effect["name"]
    assert vocabulary.joint_terms("stiction", {"deadband_rad": 0.02}) == {"dead_band": 0.02}
    assert vocabulary.joint_terms("axis_sign", {}) == {}


def test_where_an_effect_is_written_agrees_with_what_writes_it() -> None:
    written = {effect["name"]: effect["written_to"] for effect in effects()}
    assert set(written.values()) == {"urdf", "mjcf", "camera_file", "session", "nothing"}
    assert set(mjcf.MECHANICAL) == {"backlash", "stiction", "joint_compliance", "link_bending", "gear_ratio"}
    # What is written nowhere says why and what to do instead.
    nowhere = {name for name, where in written.items() if where == "nothing"}
    assert nowhere <= set(apply.NOT_IN_A_MODEL) and nowhere <= set(formatting.BY_HAND)
    assert not nowhere & set(mjcf.MECHANICAL)
