"""Signatures of what is no joint, as pictures; places and gaps as people read them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import mirror_posture as mp
from mirror_posture.diagnosis import Diagnosis, Field, Gap, Track
from mirror_posture.diagnosis.formatting import place_with_article, sentence
from mirror_posture.diagnosis.next_step import next_step, shows_in_picture_only
from mirror_posture.diagnosis.page import write_report
from mirror_posture.diagnosis.panel_plots import draw_field, draw_track
from mirror_posture.diagnosis.plots import gap_told
from mirror_posture.pages import Drawing
from tracked_session import write_tracked

rng = np.random.default_rng(3)


def track_entry(
    at: str, what: str, unit: str, components: list[str], axes: list[dict[str, str]]
) -> dict[str, Any]:
    points = []
    for frame in range(40):
        fitted = (0.004 * rng.normal(size=len(components))).tolist()
        points.append(
            {
                "frame": frame,
                "against": rng.uniform(-1.0, 1.0, len(axes)).tolist(),
                "error": [value + 0.0002 * float(rng.normal()) for value in fitted],
                "std": [0.0002] * len(components),
                "fitted": fitted,
            }
        )
    return {
        "cause": None,
        "at": at,
        "what": what,
        "unit": unit,
        "components": components,
        "against": axes,
        "points": points,
    }


TIME = {"name": "time", "unit": "s"}
ELBOW = {"name": "position of joint:r_elbow", "unit": "rad"}
MARKER = track_entry(
    "marker:r_hand",
    "shift",
    "m",
    ["x", "y", "z"],
    [{"name": f"direction of gravity, {axis}", "unit": ""} for axis in "xyz"] + [TIME],
)
FOCAL = track_entry("camera", "focal", "1", ["focal length"], [ELBOW, TIME])


def field_entry(over: str, compared: bool) -> dict[str, Any]:
    axes, unit, reach = (2, "px", 600.0) if over == "image" else (3, "m", 0.05)
    points = []
    for k in range(30):
        at = rng.uniform(0.0, reach, 2) - (0.0 if over == "image" else reach / 2)
        point = {
            "of": "markers" if over == "image" and k % 3 == 0 else "corners",
            "at": at.tolist(),
            "count": 50,
            "without": (0.002 * reach * rng.normal(size=axes)).tolist(),
            "std": [1e-4 * reach] * axes,
        }
        points.append(point | ({"with": [0.0] * axes} if compared else {}))
    at = "camera" if over == "image" else "board"
    return {
        "cause": None,
        "at": at,
        "over": over,
        "unit": unit,
        "size": [reach, 0.75 * reach],
        "points": points,
    }


def document(**more: Any) -> dict[str, Any]:
    gap = {"before_m": 0.0016, "after_m": 0.0016, "noise_floor_m": 0.0015, "held_out_postures": 40}
    gap |= {
        "before_px": 0.9,
        "after_px": 0.9,
        "noise_floor_px": 0.3,
        "closed": 0.0,
        "closed_ci95": [0.0, 0.0],
    }
    where = [{"at": "marker:r_hand", "share": 1.0, "depends_on": "posture"}]
    head = {
        "format": "mirror-posture/diagnosis",
        "version": 1,
        "verdict": "unknown",
        "sentence": "it lies at marker:r_hand",
    }
    return head | {"causes": [], "where": where, "gap": gap} | more


def colours_of(drawing: Drawing) -> int:
    """How many pixels of a PNG are neither white nor grey."""
    picture = cv2.imdecode(np.frombuffer(drawing.png, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None and min(picture.shape[:2]) > 200
    return int((np.ptp(picture.astype(int), axis=2) > 60).sum())


def parsed(entry: dict[str, Any]) -> Track | Field:
    found = Diagnosis.from_document(document(**{"fields" if "over" in entry else "tracks": [entry]}))
    return (*found.tracks, *found.fields)[0]


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        (MARKER, ["x, mm", "z, mm", "direction of gravity, y", "time, s"]),
        (FOCAL, ["focal length, %", "r_elbow, °", "time, s"]),
    ],
)
def test_a_track_shows_each_component_against_each_quantity(entry: dict[str, Any], words: list[str]) -> None:
    track = parsed(entry)
    assert isinstance(track, Track)
    assert track.error.shape == (40, len(entry["components"])) and track.values.shape == (
        40,
        len(entry["against"]),
    )
    drawing = draw_track(track, 0)
    for word in words:
        assert word in drawing.svg
    assert colours_of(drawing) > 500
    # A session without times: its rows are counted.
    counted = draw_track(track, 0, timed=False).svg
    assert ">row<" in counted and "time, s" not in counted


@pytest.mark.parametrize("over", ["image", "board"])
@pytest.mark.parametrize("compared", [True, False])
def test_a_field_shows_arrows_with_their_scale(over: str, compared: bool) -> None:
    field = parsed(field_entry(over, compared))
    assert isinstance(field, Field) and (field.with_cause is not None) == compared
    drawing = draw_field(field, 0)
    assert ("without the unexplained part" in drawing.svg) == compared
    assert f" {'px' if over == 'image' else 'mm'}" in drawing.svg
    assert colours_of(drawing) > 500
    still = draw_field(replace(field, without=0.0 * field.without), 0)
    assert colours_of(still) < colours_of(drawing)


def test_the_page_holds_every_panel_with_a_caption(tmp_path: Path) -> None:
    session = mp.load_session(write_tracked(tmp_path / "session", 7))
    found = Diagnosis.from_document(document(tracks=[MARKER, FOCAL], fields=[field_entry("image", True)]))
    page = write_report(session, found, tmp_path).read_text(encoding="utf-8")
    assert "It lies at marker r_hand" in page and "The unexplained part, at marker r_hand" in page
    assert "off its mount" in page and "Relative error of the focal length" in page and "(blue)" in page
    assert page.index("at marker r_hand</h3>") < page.index("at the camera</h3>")
    names = {file.name for file in (tmp_path / "pictures").iterdir()}
    assert names == {"gap.png", "robot.png", "track-0.png", "track-1.png", "field-0.png"}


def test_a_gap_that_is_mostly_the_noise_of_depth_is_told_in_pixels() -> None:
    noisy = Gap(0.0016, 0.0016, 0.0015, before_px=0.9, after_px=0.8, noise_floor_px=0.3)
    assert gap_told(noisy)[:2] == ([0.9, 0.8, 0.3], "px")
    clear = replace(noisy, before_m=0.008)
    assert gap_told(clear)[:2] == (pytest.approx([8.0, 1.6, 1.5]), "mm")
    without_pictures = Gap(0.0016, 0.0016, 0.0015)
    assert gap_told(without_pictures)[1] == "mm"


def test_places_say_what_they_are() -> None:
    assert place_with_article("camera") == "the camera"
    assert place_with_article("joint:a<-joint:b") == "joint a from joint b"
    assert sentence("at joint:x with joint:y") == "At joint x with joint y"
    nowhere = Diagnosis.from_document(document(where=[{"at": "unknown", "share": 1.0}]))
    assert "no single place" in next_step(nowhere)
    corners = Diagnosis.from_document(document(where=[{"at": "camera", "share": 1.0}]))
    assert "Look at the camera:" in next_step(corners)
    for at, depends_on, said in [
        ("board", "nothing", "not flat"),
        ("mirror", "nothing", "bent in one direction"),
        ("camera", "position of joint:neck", "mount"),
        ("joint:elbow", "posture, each by itself", "slips"),
        ("joint:elbow", "time", "warms up"),
        ("link:upper_arm", "time", "grows"),
        ("camera", "time", "creeps"),
        ("marker:hand", "time", "peels off"),
    ]:
        left = [{"at": at, "share": 1.0, "depends_on": depends_on}]
        told = next_step(Diagnosis.from_document(document(verdict="unknown", where=left)))
        assert said in told and "does this" in told
        cause = {"effect": "gear_ratio", "at": "joint:x", "probability": 0.9, "parameters": {}}
        assert said in next_step(
            Diagnosis.from_document(document(verdict="partial", where=left, causes=[cause]))
        )
    by_load = [{"at": "joint:elbow", "share": 1.0, "depends_on": "load"}]
    assert "does this" not in next_step(Diagnosis.from_document(document(verdict="unknown", where=by_load)))
    only = document(
        verdict="none", sentence="No cause is named: a at b would make the gap smaller in the picture"
    )
    assert next_step(Diagnosis.from_document(only)).startswith("Record more views of each posture")
    assert shows_in_picture_only(Diagnosis.from_document(only))
    assert not shows_in_picture_only(Diagnosis.from_document(document(verdict="none")))
    slipped = {"effect": "pairing", "at": "data", "probability": 0.98, "parameters": {}}
    rows = Diagnosis.from_document(document(verdict="explained", causes=[slipped]))
    assert next_step(rows).startswith("Mend the rows")
