"""Writes the causes into a `<ros2_control>` description: offsets and reductions of its transmissions."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

from ..._core import MirrorPostureError
from ...output_files import write_file
from ..parts import Cause
from ..vocabulary import joint_terms
from .another_robot import Check
from .xml_text import Element, XmlText, read_xml

WRITTEN = ("joint_offset", "gear_ratio")
SIMPLE = "SimpleTransmission"
_EXPRESSION = re.compile(r"\$\{([^}]*)\}\Z")


def patch_ros2_control(
    own: Path,
    causes: Sequence[Cause],
    out: Path,
    check: Check | None = None,
    sliding: Collection[str] = (),
) -> dict[tuple[str, str], str]:
    """Writes a file with `<ros2_control>` (a URDF, or xacro) whose transmissions allow for zeros and gears; returns what was written.

    A simple transmission reports `q = x / n + o` for an actuator's x, reduction n and offset o. The joint stands at `q + a + e q`
    (`joint_offset` a, `gear_ratio` e), so n becomes `n / (1 + e)` and o `(1 + e) o + a`: both causes of a joint are written at once. Only
    these numbers change; an expression `${x}` becomes `${(x) + a}`. The robot's URDF then stays as it is: told in both it would count twice.
    `check` takes the joints' names, unless some are expressions of xacro. `sliding` are joints whose offsets are lengths.

    Raises:
        MirrorPostureError: no such file, or none with `<ros2_control>`; what `check` raises.
    """
    document = XmlText(read_xml(own), str(own))
    sections = [element for element in document.elements if element.tag == "ros2_control"]
    if not sections:
        raise MirrorPostureError(
            f"{own}: has no <ros2_control>; give the file in which your hardware is described"
        )
    names = _joint_names(document)
    if check is not None and not any("$" in name for name in names):
        check(names)
    laws: dict[str, dict[str, float]] = {}
    written = [cause for cause in causes if cause.effect in WRITTEN]
    for cause in written:
        values = {key: estimate.value for key, estimate in cause.parameters.items()}
        law = laws.setdefault(cause.at, {})
        for term, value in joint_terms(cause.effect, values).items():
            law[term] = law.get(term, 0.0) + value
    lines = {}
    for at, law in laws.items():
        name = at.partition(":")[2]
        lines[at] = _write(document, law, name, "m" if name in sliding else "rad")
    write_file(out, document.text().encode("utf-8"))
    return {(cause.effect, cause.at): lines[cause.at] for cause in written}


def _write(document: XmlText, law: Mapping[str, float], name: str, unit: str) -> str:
    by_hand = _by_hand(law, unit)
    joints = [
        element
        for element in document.elements
        if element.tag == "joint"
        and element.attributes.get("name") == name
        and _inside(element, "ros2_control")
    ]
    held = [joint for joint in joints if joint.parent is not None and joint.parent.tag == "transmission"]
    if not held:
        return f"not written: {_why_not(document, joints, name)}{by_hand}"
    if len(held) > 1:
        return f"not written: joint {name} is in {len(held)} transmissions{by_hand}"
    transmission = held[0].parent
    assert transmission is not None
    plugin = transmission.find("plugin")
    kind = document.inner(plugin).strip() if plugin is not None else ""
    if not kind.endswith(SIMPLE):
        return f"not written: joint {name} has a transmission {kind or 'without a plugin'}, needed a {SIMPLE}{by_hand}"
    return _change(document, held[0], name, law, by_hand)


def _change(document: XmlText, joint: Element, name: str, law: Mapping[str, float], by_hand: str) -> str:
    """Writes the transmission's reduction and offset, or neither of them; `by_hand` then tells what to do instead."""
    factor, offset = 1.0 + law.get("share", 0.0), law.get("offset", 0.0)
    changes = [("mechanical_reduction", "1", "/", 0.0)] if "share" in law else []
    if "offset" in law or joint.find("offset") is not None:
        changes.append(("offset", "0", "*", offset))
    said, new, edits = [], "", []
    for tag, default, operator, summand in changes:
        element = joint.find(tag)
        text = default if element is None else document.inner(element).strip()
        after = _changed(text, operator, factor, summand)
        if after is None:
            return f"not written: {tag} of joint {name} is {text!r}{by_hand}"
        if element is None:
            new += f"<{tag}>{after}</{tag}>"
            said.append(f"{tag} {after}, none before")
        else:
            edits.append((element, after))
            said.append(f"{tag} {text} to {after}")
    for element, after in edits:
        document.set_inner(element, after)
    if new and joint.open_end == joint.end:
        document.replace(joint, f"<joint{_attributes(joint)}>{new}</joint>")
    elif new:
        document.insert_text_in(joint, new)
    return f"transmission of joint {name}: {', '.join(said)}"


def _changed(text: str, operator: str, factor: float, summand: float) -> str | None:
    """A number or an expression, times or by a factor, and a summand more; None for what is neither."""
    try:
        number = float(text)
    except ValueError:
        found = _EXPRESSION.match(text)
        if found is None:
            return None
        scaled = f" {operator} {factor:.12g}" if factor != 1.0 else ""
        added = f" {'-' if summand < 0 else '+'} {abs(summand):.12g}" if summand else ""
        return f"${{({found[1].strip()}){scaled}{added}}}"
    return f"{(number * factor if operator == '*' else number / factor) + summand + 0.0:.12g}"


def _why_not(document: XmlText, joints: Sequence[Element], name: str) -> str:
    """What the file has of a joint instead of a transmission."""
    if not joints:
        return f"no joint {name!r} in <ros2_control>; it has {', '.join(_joint_names(document)) or 'none'}"
    offset = next(
        (
            param
            for joint in joints
            for param in joint.children
            if param.tag == "param" and "offset" in param.attributes.get("name", "")
        ),
        None,
    )
    if offset is not None:
        param = offset.attributes["name"]
        return f"joint {name} has a parameter {param} = {document.inner(offset).strip()!r}, whose unit only its driver knows"
    return f"joint {name} has no <transmission>"


def _joint_names(document: XmlText) -> list[str]:
    """The joints of `<ros2_control>`, each once."""
    return list(
        dict.fromkeys(
            element.attributes.get("name", "")
            for element in document.elements
            if element.tag == "joint" and _inside(element, "ros2_control")
        )
    )


def _by_hand(law: Mapping[str, float], unit: str) -> str:
    told = [f"be {1.0 + law['share']:.9g} times as large"] if "share" in law else []
    told += [f"grow by {law['offset']:+.9g} {unit}"] if "offset" in law else []
    return f"; what the joint reports must {', then '.join(told)}"


def _attributes(joint: Element) -> str:
    return "".join(f" {key}={quoteattr(value)}" for key, value in joint.attributes.items())


def _inside(element: Element, tag: str) -> bool:
    at = element.parent
    while at is not None:
        if at.tag == tag:
            return True
        at = at.parent
    return False
