"""Names of robots are words wherever they are shown: page, pictures, terminal, models; whatever they hold."""

from __future__ import annotations

import io
import json
import re
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

import pytest
from rich.console import Console

from mirror_posture import load_session
from mirror_posture.cli.output import Output
from mirror_posture.diagnosis.page import write_report
from mirror_posture.diagnosis.result import VERSION, Diagnosis
from mirror_posture.pages import figure, finished, styled

SCRIPT = '"><img src=x onerror=alert(1)>'
NAMES = [
    SCRIPT,
    r"a\1 \g<0>",
    "[/red]",
    "joint a:b: of",
    "a$\\frac{$b",
    "'mirror-posture[mujoco]'",
    "%(x)s {y} {{z}}",
    "ü 関節",
]


class Tags(HTMLParser):
    """The tags of a page and their attributes."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))


@styled
def drawn(name: str) -> str:
    picture, axes = figure(3.0, 2.0)
    axes[0, 0].set_title(name)
    axes[0, 0].barh([name, "other"], [1.0, 2.0], label=name)
    axes[0, 0].legend()
    return finished(picture, f"signature-{name}").svg


def test_a_figure_whose_texts_would_be_formulas_is_refused() -> None:
    with pytest.raises(RuntimeError, match="styled"):
        figure(3.0, 2.0)


@pytest.mark.parametrize("name", NAMES)
def test_svg(name: str) -> None:
    svg = drawn(name)
    tree = ElementTree.fromstring(svg)
    assert {element.tag.rpartition("}")[2] for element in tree.iter()}.isdisjoint({"img", "script"})
    # What is told is the name itself, not a formula of it.
    assert any((element.text or "").strip() == name.strip() for element in tree.iter())
    ids = [element.get("id") for element in tree.iter() if element.get("id")]
    assert ids and all(re.fullmatch(r"[A-Za-z0-9_.-]+", found or "") for found in ids)
    assert all(used in ids for used in re.findall(r'(?:href="#|url\(#)([^")]+)', svg))


@pytest.mark.parametrize("name", NAMES)
def test_terminal(name: str) -> None:
    output = Output()
    text = io.StringIO()
    output.messages = Console(file=text, width=300, force_terminal=False, highlight=False)
    output.errors = output.messages
    output.table(name, ["*name", "n"], [(name, "1")], caption=name)
    output.say(name)
    output.warn(name)
    assert text.getvalue().count(name) == 5


def test_terminal_controls_are_replaced() -> None:
    output = Output()
    text = io.StringIO()
    output.messages = Console(file=text, width=300, force_terminal=False, highlight=False)
    output.say("a\x1b]0;owned\x07\x1b[2Jb\u202ec")
    assert not re.search("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202e]", text.getvalue())


def document(joint: str, marker: str) -> Diagnosis:
    """A diagnosis that blames a joint and a marker, with a panel of each."""
    place = f"joint:{joint}"
    estimate = {"value": 0.03, "std": 0.001}
    return Diagnosis.from_document(
        {
            "format": "mirror-posture/diagnosis",
            "version": VERSION,
            "verdict": "partial",
            "sentence": f"It is {joint} and {marker}.",
            "causes": [
                {"effect": "joint_offset", "at": place, "probability": 0.9, "parameters": {"offset_rad": estimate},
                 "alternatives": [{"effect": "marker_mount", "at": f"marker:{marker}", "probability": 0.1}]},
            ],
            "where": [{"at": place, "share": 0.9}, {"at": f"marker:{marker}", "share": 0.1}],
            "gap": {"before_m": 0.01, "after_m": 0.002, "noise_floor_m": 0.001, "closed": 0.9, "closed_ci95": [0.8, 0.95],
                    "before_px": 9.0, "after_px": 2.0, "noise_floor_px": 0.3, "held_out_postures": 3},
            "next_postures": [{joint: 0.3}],
            "warnings": [f"odd: {marker}"],
        }
    )  # fmt: skip


@pytest.mark.parametrize("name", [SCRIPT, " ".join(NAMES[1:])])
def test_page(name: str, tmp_path: Path) -> None:
    from session_folder import FRAMES, SESSION, URDF, write_folder

    urdf = URDF.replace('"elbow"', quoteattr(name)).replace("'elbow'", quoteattr(name))
    frames = FRAMES.replace("elbow", '"' + name.replace('"', '""') + '"', 1).replace(",measured:elbow", ",x")
    lines = frames.splitlines()
    frames = "\n".join([lines[0].removesuffix(",x"), *(line.rpartition(",")[0] for line in lines[1:])]) + "\n"
    toml = SESSION.replace('name = "hand"', f"name = {json.dumps(name)}")
    detections = "frame,target,index,u,v\n0,board,0,100.5,200.25\n"
    session = load_session(
        write_folder(tmp_path / "s", robot=urdf, frames=frames, session=toml, detections=detections,
                     points="frame,marker,x,y,z\n")
    )  # fmt: skip
    page = write_report(session, document(name, name), tmp_path).read_text(encoding="utf-8")
    tags = Tags(page)
    assert not any(tag in ("img", "script", "iframe", "object") for tag, _ in tags.found)
    assert not any(key.startswith("on") for _, attributes in tags.found for key in attributes)
    policy = next(
        a["content"]
        for t, a in tags.found
        if t == "meta" and a.get("http-equiv") == "Content-Security-Policy"
    )
    assert policy is not None and "default-src 'none'" in policy and "script-src" not in policy


def test_models_written_for_simulators(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    from mirror_posture.diagnosis.applied.mjcf import write_mjcf
    from mirror_posture.diagnosis.parts import Cause, Estimate
    from session_folder import FRAMES, URDF, write_folder

    heavy = URDF.replace('<link name="lower"/>', '<link name="lower"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" '
                         'iyy="1" iyz="0" izz="1"/></inertial></link>')  # fmt: skip
    urdf = heavy.replace('"elbow"', quoteattr(SCRIPT))
    frames = "\n".join(
        line.rpartition(",")[0]
        for line in FRAMES.replace(",elbow", ',"' + SCRIPT.replace('"', '""') + '"', 1).splitlines()
    )
    session = load_session(write_folder(tmp_path / "s", robot=urdf, frames=frames + "\n"))
    cause = Cause("backlash", f"joint:{SCRIPT}", 0.9, {"width_rad": Estimate(0.04, 0.001)})
    file = tmp_path / "robot.mjcf.xml"
    assert write_mjcf(session, urdf, [cause], file)
    model = mujoco.MjModel.from_xml_path(str(file))
    assert model.joint(f"{SCRIPT}_play").id >= 0
    assert not [element for element in ElementTree.parse(file).iter() if element.tag == "img"]
