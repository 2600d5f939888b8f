"""The pages: who must act is told first, nothing shows zeros, everything has words, and a real browser lays it out at any width."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import mirror_posture as mp
from browser import CHROMIUM, OVERFLOW, Browser
from mirror_lab.robots import HiddenEffect, TwinOptions, TwinRobot
from mirror_posture.cli.app import app
from mirror_posture.correct import PAPER_VIEWS
from mirror_posture.diagnosis import Diagnosis, limits
from mirror_posture.diagnosis import page as page_module
from mirror_posture.diagnosis.page import write_report
from mirror_posture.diagnosis.plots import draw_signature
from mirror_posture.session import write_session
from session_folder import SESSION, write_folder
from test_diagnose_panels import FOCAL, field_entry
from tracked_session import write_tracked

WIDTHS = (380, 820, 1400)
LARGEST_PAGE = 3_000_000


def estimate(value: float, std: float) -> dict[str, float]:
    return {"value": value, "std": std}


def signature(cause: int | None, at: str, count: int) -> dict[str, Any]:
    rng = np.random.default_rng(1)
    points = [
        {"frame": k, "position": q, "torque_nm": 0.1 * q, "direction": 1.0, "time_s": float(k), "error": 0.01 * q, "std": 1e-3, "fitted": 0.01 * q}
        for k, q in enumerate(rng.uniform(-1.0, 1.0, count))
    ]  # fmt: skip
    return {"cause": cause, "at": at, "unit": "rad", "points": points}


def rich_document(points: int = 40) -> dict[str, Any]:
    """A diagnosis with one of everything: causes of each kind, an ambiguous one, small errors with zeros among them."""
    member = {"effect": "link_length", "at": "link:r_forearm", "parameter": "dx_m"}
    members = [
        member | {"value": 0.0021, "std": 0.0002},
        member | {"at": "link:r_upper_arm", "value": -0.0007, "std": 0.0002},
        member | {"at": "link:l_forearm", "value": 0.0, "std": 0.0},
        {"effect": "joint_offset", "at": "joint:l_elbow", "parameter": "offset_rad", "value": 0.012, "std": 0.001},
    ]  # fmt: skip
    causes = [
        {"effect": "joint_frozen", "at": "joint:l_elbow", "kind": "data", "probability": 0.99, "parameters": {}},
        {"effect": "board_mount", "at": "board", "kind": "setup", "probability": 0.97,
         "parameters": {"dx_m": estimate(0.003, 0.0002), "dy_m": estimate(0.0, 0.0)}},
        {"effect": "backlash", "at": "joint:r_elbow", "kind": "robot", "probability": 0.71, "words": "the gear has play",
         "parameters": {"width_rad": estimate(0.03, 0.001)},
         "alternatives": [{"effect": "stiction", "at": "joint:r_elbow", "probability": 0.28},
                          {"effect": "drift", "at": "joint:r_elbow", "probability": 0.001}]},
        {"effect": "geometry", "at": "robot", "kind": "robot", "probability": 0.95, "parameters": {"spread_m": estimate(0.001, 0.0002)}, "members": members},
    ]  # fmt: skip
    return {
        "format": "mirror-posture/diagnosis",
        "version": mp.diagnosis.result.VERSION,
        "verdict": "partial",
        "sentence": "it is joint:r_elbow",
        "causes": causes,
        "where": [{"at": "joint:r_elbow", "share": 0.9}, {"at": "marker:r_hand", "share": 0.1, "depends_on": "posture"}, {"at": "mirror", "share": 0.0}],
        "gap": {"before_m": 0.01, "after_m": 0.002, "noise_floor_m": 0.001, "closed": 0.9, "closed_ci95": [0.8, 0.95],
                "before_px": 9.0, "after_px": 2.0, "noise_floor_px": 0.3, "held_out_postures": 3},
        "data": {"frames_given": 9, "frames_used": 8, "postures_given": 5, "postures_used": 4, "points_given": 60, "points_used": 59,
                 "left_out": [{"frame": 3, "target": "r_hand", "deviations": 40.0, "why": "far from the best model"}]},
        "warnings": ["joints that never moved: head_yaw"],
        "next_postures": [{"r_elbow": 0.3, "head_yaw": 0.0}, {"r_elbow": -0.3, "head_yaw": 0.0}],
        "trace": ["add backlash@joint:r_elbow: log odds 12.0"],
        "ranking": [{"effect": "backlash", "at": "joint:r_elbow", "log_bayes": 12.0}, {"effect": "drift", "at": "joint:r_elbow", "log_bayes": -3.0}],
        "signatures": [signature(2, "joint:r_elbow", points)],
        "tracks": [FOCAL],
        "fields": [field_entry("image", True)],
    }  # fmt: skip


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> mp.Session:
    return mp.load_session(write_tracked(tmp_path_factory.mktemp("pages") / "session", 7))


@pytest.fixture(scope="module")
def diagnosed(session: mp.Session, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_report(
        session, Diagnosis.from_document(rich_document()), tmp_path_factory.mktemp("diagnosed")
    )


def test_who_must_act_comes_first(diagnosed: Path) -> None:
    page = diagnosed.read_text(encoding="utf-8")
    robot, setup, data = (page.index(f"<h3>{who}</h3>") for who in ("The robot", "The set-up", "The data"))
    assert robot < setup < data < page.index("<svg")
    act = page[page.index('id="act"') : page.index("</section>")]
    assert robot < page.index("<b>backlash at joint r_elbow</b>") < setup
    assert setup < page.index("<b>board mount at the board</b>") < data < page.index("<b>joint frozen")
    assert act.count(">ambiguous<") == 1 and "stiction at joint r_elbow (28 %)" in act
    assert "repair the joint or its log" in act


def test_the_largest_small_errors_are_named_and_no_row_is_zero(diagnosed: Path) -> None:
    page = diagnosed.read_text(encoding="utf-8")
    largest = page[page.index("The largest of 4") :]
    assert (
        0
        < largest.index("joint offset at joint l_elbow")
        < largest.index("link r_forearm")
        < largest.index("link r_upper_arm")
    )
    assert "link l_forearm" not in page and "1 that is zero in the digits shown" in page
    assert not re.search(r"[ +-]0\.00 ± 0\.00", page)
    rows = re.findall(r"<tr>(.*?)</tr>", page, re.DOTALL)
    assert not any(">0 %<" in row or "drift" in row or "head_yaw" in row for row in rows)


def test_every_picture_has_words_and_every_place_that_scrolls_takes_the_keyboard(diagnosed: Path) -> None:
    page = diagnosed.read_text(encoding="utf-8")
    pictures = re.findall(r"<svg[^>]*>", page)
    assert len(pictures) == 5
    for picture in pictures:
        words = re.search(r'aria-label="([^"]+)"', picture)
        assert 'role="img"' in picture and words and len(words[1]) > 30
    for place in re.findall(r'<div class="wide"[^>]*>', page):
        assert 'tabindex="0"' in place and 'role="region"' in place and 'aria-label="' in place


def test_a_big_session_s_page_stays_small() -> None:
    """1,495 postures (a UR10's session) are drawn as pixels; of more panels than fit the first are shown."""
    (big,) = Diagnosis.from_document(rich_document(1495) | {"tracks": [], "fields": []}).signatures
    drawing = draw_signature(big, 0)
    assert "<image" in drawing.svg and len(drawing.svg) < 150_000
    panel = page_module.Panel("signature-0", 0, "joint:r_elbow", "title", "", drawing)
    shown = page_module._that_fit([panel] * 40)
    assert 10 < len(shown) < 40
    assert sum(len(panel.drawing.svg) for panel in shown) <= page_module.LARGEST_PICTURES < 0.8 * LARGEST_PAGE
    assert "time, s" in drawing.svg
    counted = draw_signature(big, 0, timed=False).svg
    assert ">row<" in counted and "time, s" not in counted


@pytest.mark.parametrize(
    ("sizes", "said"),
    [
        (
            (0.002, 0.004, 0.2),
            "These postures would have hidden (95 %) a joint's zero by 0.23 ° (11 ° at roll).",
        ),
        (
            (0.002, 0.004, None),
            "These postures would have hidden (95 %) a joint's zero by 0.23 ° (0.23 ° at yaw). They cannot show a joint's zero at roll "
            "at all.",
        ),
        ((0.002, None, None), "These postures cannot show a joint's zero at yaw and roll at all."),
    ],
)
def test_a_place_that_is_not_seen_is_no_size(sizes: tuple[float | None, ...], said: str) -> None:
    """Before: "would have hidden (95 %) a joint's zero by any size (any size at roll)"."""
    told = [
        {"effect": "joint_offset", "at": f"joint:{name}", "parameters": {"offset_rad": size}}
        for name, size in zip(("pitch", "yaw", "roll"), sizes, strict=True)
    ]
    assert limits.line(Diagnosis.from_document(rich_document() | {"limits": told})) == said


def assert_laid_out(pages: list[Path], shot: Path) -> None:
    with Browser() as browser:
        for page in pages:
            for width in WIDTHS:
                # All share one sheet of styles: the dark one is tried on the first.
                for dark in (False, True) if page == pages[0] else (False,):
                    browser.open(page, width, dark=dark)
                    assert browser.evaluate(OVERFLOW) == [], (page.name, width)
                    background = browser.evaluate("getComputedStyle(document.body).backgroundColor")
                    assert background == ("rgb(22, 24, 28)" if dark else "rgb(255, 255, 255)")
            # On paper it is dark on white, whatever the screen is.
            browser.open(page, 760, dark=True, printed=True)
            assert browser.evaluate(OVERFLOW) == []
            assert browser.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
        browser.picture(shot)
    assert shot.stat().st_size > 10_000


@pytest.fixture(scope="module")
def others(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The pages of check, of a broken session as well, and of measure."""
    folder = tmp_path_factory.mktemp("others")

    def run(*words: object, code: int = 0) -> str:
        ended = CliRunner().invoke(app, [str(word) for word in words])
        assert ended.exit_code == code, ended.output
        return ended.output

    looks = []
    with TwinRobot(
        [HiddenEffect("joint_offset", "joint:r_elbow", {"offset_rad": 0.05})], TwinOptions(pictures=False)
    ) as robot:
        robot.command({"r_shoulder_pitch": -0.5, "r_shoulder_roll": 0.9, "r_elbow": 0.5})
        for view in PAPER_VIEWS:
            robot.turn(view)
            looks.append(robot.look())
        write_session(robot.nominal.session(looks, [0, 0]), folder / "session")
    pages = {name: folder / f"{name}.html" for name in ("measure", "check", "broken")}
    assert "written" in run("measure", folder / "session", "--page", pages["measure"])
    assert "unusual" in run("check", folder / "session", "--page", pages["check"])
    toml = SESSION.replace("0.014", "14.0").replace("corners = [3, 2]", "corners = [1, 2]")
    run("check", write_folder(folder / "broken", session=toml), "--page", pages["broken"], code=1)
    return pages


def test_measure_and_check_have_pages(others: dict[str, Path]) -> None:
    text = {name: file.read_text(encoding="utf-8") for name, file in others.items()}
    assert (
        "r_hand" in text["measure"]
        and 'role="img"' in text["measure"]
        and " mm (RMS) from where" in text["measure"]
    )
    assert re.search(r"unusual</span></td><td>postures</td><td>1</td>", text["check"])
    assert "plausible</span></td><td>length of gravity" in text["check"]
    assert (
        "What is wrong: 2" in text["broken"]
        and "board.corners" in text["broken"]
        and "board.square" in text["broken"]
    )


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed")
def test_a_browser_lays_the_pages_out(diagnosed: Path, others: dict[str, Path], tmp_path: Path) -> None:
    assert_laid_out([diagnosed, *others.values()], tmp_path / "page.png")


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed")
def test_the_check_of_the_layout_sees_what_is_wrong(tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    page.write_text(
        "<h1 style='white-space: nowrap'>" + 60 * "word " + "</h1><p style='margin-top: -40px'>over</p>"
    )
    with Browser() as browser:
        browser.open(page, 380)
        found = " ".join(browser.evaluate(OVERFLOW))
    assert "the page is" in found and "H1 is cut" in found and "H1 over P" in found
