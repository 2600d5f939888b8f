"""Writes the causes into a `<ros2_control>` description: offsets and reductions of its transmissions."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from ..._core import MirrorPostureError
from ...output_files import write_file
from ..parts import Cause
from .another_robot import Check
from .xml_text import Element, XmlText, read_xml

WRITTEN = ("joint_offset", "gear_ratio")
SIMPLE = "SimpleTransmission"
_EXPRESSION = re.compile(r"\$\{([^}]*)\}\Z")


def patch_ros2_control(
    own: Path, causes: Sequence[Cause], out: Path, check: Check | None = None
) -> dict[tuple[str, str], str]:
    """Writes a file with `<ros2_control>` (a URDF, or xacro) whose transmissions allow for zeros and gears; returns what was written.

    A simple transmission reports `q = x / n + o` for an actuator's x, reduction n and offset o. The joint stands at `q + a`
    (`joint_offset` a), or at `(1 + e) q` (`gear_ratio` e), so o becomes `o + a`, or n becomes `n / (1 + e)` and o `(1 + e) o`. Only these
    numbers change; an expression `${x}` becomes `${x + a}`. The robot's URDF then stays as it is: told in both it would count twice.
    `check` takes the joints' names, unless some are expressions of xacro.

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
    told = {}
    for cause in causes:
        if cause.effect not in WRITTEN:
            continue
        name = cause.at.partition(":")[2]
        told[cause.effect, cause.at] = _write(document, cause, name)
    write_file(out, document.text().encode("utf-8"))
    return told


def _write(document: XmlText, cause: Cause, name: str) -> str:
    joints = [
        element
        for element in document.elements
        if element.tag == "joint"
        and element.attributes.get("name") == name
        and _inside(element, "ros2_control")
    ]
    held = [joint for joint in joints if joint.parent is not None and joint.parent.tag == "transmission"]
    if not held:
        return f"not written: {_why_not(document, joints, name)}{_by_hand(cause)}"
    if len(held) > 1:
        return f"not written: joint {name} is in {len(held)} transmissions{_by_hand(cause)}"
    transmission = held[0].parent
    assert transmission is not None
    plugin = transmission.find("plugin")
    kind = document.inner(plugin).strip() if plugin is not None else ""
    if not kind.endswith(SIMPLE):
        return f"not written: joint {name} has a transmission {kind or 'without a plugin'}, needed a {SIMPLE}{_by_hand(cause)}"
    if cause.effect == "joint_offset":
        return _add_offset(document, held[0], name, cause.parameters["offset_rad"].value)
    return _scale(document, held[0], name, 1.0 + cause.parameters["scale_error"].value)


def _add_offset(document: XmlText, joint: Element, name: str, offset: float) -> str:
    element = joint.find("offset")
    if element is None:
        if joint.open_end == joint.end:
            document.replace(
                joint, f'<joint name="{name}"{_other(joint)}><offset>{offset:.12g}</offset></joint>'
            )
        else:
            document.insert_text_in(joint, f"<offset>{offset:.12g}</offset>")
        return f"offset of the transmission of joint {name}: {offset:.6g} rad, none before"
    text = document.inner(element).strip()
    new = _changed(text, "+", offset)
    if new is None:
        return f"not written: the offset of joint {name} is {text!r}; add {offset:+.9g} rad to it"
    document.set_inner(element, new)
    return f"offset of the transmission of joint {name}: {text} to {new}"


def _scale(document: XmlText, joint: Element, name: str, factor: float) -> str:
    reduction, offset = joint.find("mechanical_reduction"), joint.find("offset")
    told = []
    for element, operator in ((reduction, "/"), (offset, "*")):
        if element is None:
            continue
        text = document.inner(element).strip()
        new = _changed(text, operator, factor)
        if new is None:
            return f"not written: {element.tag} of joint {name} is {text!r}; write it {operator} {factor:.9g}"
        told.append((element, text, new))
    if reduction is None:
        if joint.open_end == joint.end:
            return f"not written: joint {name} has no <mechanical_reduction>; write 1 / {factor:.9g}"
        document.insert_text_in(joint, f"<mechanical_reduction>{1.0 / factor:.12g}</mechanical_reduction>")
    for element, _, new in told:
        document.set_inner(element, new)
    said = [f"{element.tag} {text} to {new}" for element, text, new in told]
    if reduction is None:
        said.insert(0, f"mechanical_reduction {1.0 / factor:.9g}, none before")
    return f"transmission of joint {name}: {', '.join(said)}"


def _changed(text: str, operator: str, value: float) -> str | None:
    """A number or an expression, changed; None for what is neither."""
    try:
        number = float(text)
    except ValueError:
        found = _EXPRESSION.match(text)
        if found is None:
            return None
        if operator == "+":
            return f"${{({found[1].strip()}) {'-' if value < 0 else '+'} {abs(value):.12g}}}"
        return f"${{({found[1].strip()}) {operator} {value:.12g}}}"
    after = {"+": number + value, "*": number * value, "/": number / value}[operator]
    return f"{after + 0.0:.12g}"


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


def _by_hand(cause: Cause) -> str:
    if cause.effect == "joint_offset":
        return f"; what the joint reports must grow by {cause.parameters['offset_rad'].value:+.9g} rad"
    return (
        f"; what the joint reports must be {1.0 + cause.parameters['scale_error'].value:.9g} times as large"
    )


def _other(joint: Element) -> str:
    return "".join(f' {key}="{value}"' for key, value in joint.attributes.items() if key != "name")


def _inside(element: Element, tag: str) -> bool:
    at = element.parent
    while at is not None:
        if at.tag == tag:
            return True
        at = at.parent
    return False
