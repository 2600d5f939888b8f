"""What `diagnose` writes is the public format, version 2; the validator that says so finds what is not."""

from __future__ import annotations

import copy
import json
from typing import Any

import pytest

import mirror_posture as mp
from diagnosis_format import faults
from mirror_posture.diagnosis.formatting import steps
from tracked_session import write_tracked


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Of a session with two causes, as it is written."""
    folder = tmp_path_factory.mktemp("tracked")

    def actual(q: dict[str, float]) -> dict[str, float]:
        return q | {"r_elbow": 1.05 * q["r_elbow"], "r_shoulder_roll": q["r_shoulder_roll"] + 0.03}

    found = mp.diagnose(write_tracked(folder / "session", 3, actual))
    return json.loads(found.to_json())


def test_what_is_written_is_the_public_format(tree: dict[str, Any]) -> None:
    assert faults(tree) == []
    assert len(tree["causes"]) == 2 and len(tree["gap"]["steps"]) == 3
    sizes = [step["rms_m"] for step in tree["gap"]["steps"]]
    assert sizes == sorted(sizes, reverse=True)
    # Points alone: nothing of a picture is told, and never as 0.
    assert tree["gap"]["before_px"] is None and tree["gap"]["steps"][0]["rms_px"] is None
    assert steps(mp.Diagnosis.from_document(tree)).count("→") == 2


def test_steps_that_are_not_told_have_no_unit(tree: dict[str, Any]) -> None:
    of_mistakes = copy.deepcopy(tree)
    of_mistakes["gap"]["steps"][1]["rms_m"] = None
    before, between, after = steps(mp.Diagnosis.from_document(of_mistakes)).split(" → ")
    assert between == "?" and before != "?" and after.endswith(" mm")


def test_version_1_is_still_read(tree: dict[str, Any]) -> None:
    old = copy.deepcopy(tree) | {"version": 1}
    for key in ("limits", "data"):
        del old[key]
    del old["gap"]["steps"]
    for cause in old["causes"]:
        del cause["kind"], cause["stability"]
    found = mp.Diagnosis.from_document(old)
    assert found.gap.steps == () and found.limits == () and found.causes[0].stability is None


def _set(tree: dict[str, Any], path: str, value: Any) -> None:
    *ahead, last = path.split(".")
    at: Any = tree
    for key in ahead:
        at = at[int(key) if key.isdigit() else key]
    at[last] = value


@pytest.mark.parametrize(
    ("path", "value", "named"),
    [
        ("version", 1, "version"),
        ("gap.before_m", 0, "gap.before_m"),
        ("gap.after_m", 0.5, "gap.after_m"),
        ("gap.steps.0.added", "backlash@joint:r_elbow", "gap.steps"),
        ("gap.steps.1.rms_m", 0.0, "steps[1].rms_m"),
        ("causes.0.kind", "somebody", "kind"),
        ("causes.0.stability", 1.2, "stability"),
        ("causes.0.at", "elbow", "a place"),
        ("causes.0.probability", 1.01, "probability"),
        ("data.points_used", 10**6, "data.points"),
        ("data.left_out", [{"frame": 1, "target": "r_hand", "deviations": 9.0, "why": ""}], "why"),
        ("limits.0.parameters", {"offset_rad": 0.0}, "parameters"),
        ("verdict", "none", "none with causes"),
        ("where.0.share", 0.0, "largest first"),
    ],
)
def test_the_validator_finds_what_is_not_as_the_format_says(
    tree: dict[str, Any], path: str, value: Any, named: str
) -> None:
    wrong = copy.deepcopy(tree)
    _set(wrong, path, value)
    assert any(named in fault for fault in faults(wrong)), faults(wrong)
