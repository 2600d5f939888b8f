"""Reference of the formats: JSON Schemas and Markdown pages, generated from the definitions that the
readers use."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .diagnosis.schema import described
from .diagnosis.schema import document_schema as diagnosis_schema
from .formats import Key, Section, camera_keys, plan_keys, servo_keys, session_keys
from .output_files import write_file
from .session.camera_formats import COEFFICIENT_NAMES

DRAFT = "https://json-schema.org/draft/2020-12/schema"


def schemas() -> dict[str, dict[str, Any]]:
    """The JSON Schema of each format, by its name."""
    session = session_keys.TOP.schema()
    gravity = {**session_keys.GRAVITY_VECTOR.schema(), "description": session_keys.GRAVITY_VECTOR.what}
    session["properties"]["gravity"] = {"anyOf": [gravity, session_keys.GRAVITY.schema()]}
    session["required"] = [*session["required"], "gravity"]
    found = {
        "session": session,
        "camera": camera_keys.document_schema(COEFFICIENT_NAMES),
        **{f"servos-{make}": dict(servo_keys.document_schema(make)) for make in servo_keys.MAKES},
        "plan": plan_keys.TOP.schema(),
        "diagnosis": diagnosis_schema(),
    }
    return {name: {"$schema": DRAFT, "title": name, **schema} for name, schema in found.items()}


def pages() -> dict[str, str]:
    """The reference page of each format, Markdown, by its file's name."""
    return {
        "session.md": _session_page(),
        "camera.md": _camera_page(),
        "servos.md": _servos_page(),
        "plan.md": _plan_page(),
        "diagnosis.md": _diagnosis_page(),
    }


def write_reference(folder: Path) -> list[Path]:
    """Writes all pages and schemas into a folder that is there."""
    files = [write_file(folder / name, text) for name, text in pages().items()]
    files += [write_file(folder / f"{name}.schema.json", _json(schema)) for name, schema in schemas().items()]
    return files


def _json(tree: dict[str, Any]) -> str:
    return json.dumps(tree, indent=1, ensure_ascii=False) + "\n"


def _head(title: str, schema: Sequence[str], text: str) -> str:
    links = " and ".join(f"[{name}.schema.json]({name}.schema.json)" for name in schema)
    return f"# {title}\n\nMade from the definitions that the reader checks by; as JSON Schema: {links}.\n\n{text}\n"


def _refused(rules: Sequence[str]) -> str:
    return "\nBeyond the schema the reader refuses:\n\n" + "".join(f"- {rule}\n" for rule in rules)


def _table(keys: Sequence[Key]) -> str:
    rows = ["| key | needs | default | what |", "| --- | --- | --- | --- |"]
    for key in keys:
        default = (
            "must be given" if key.required else "" if key.default is None else f"`{_toml(key.default)}`"
        )
        unit = f" ({key.unit})" if key.unit else ""
        rows.append(f"| `{key.name}` | {key.needed}{unit} | {default} | {key.what} |")
    return "\n".join(rows) + "\n"


def _toml(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)


def _section(section: Section, name: str) -> str:
    brackets = f"[[{name}]]" if section.repeated else f"[{name}]"
    text = f"\n## {brackets}\n\n{section.what}\n\n{_table(section.keys)}"
    for inner in section.sections:
        text += _section(inner, f"{name}.{inner.name}")
    return text


def _session_page() -> str:
    text = _head(
        "session.toml",
        ["session"],
        "Keys that are not listed are kept, named in a warning, and have no effect.",
    )
    text += "\n## At the top\n\n" + _table([*session_keys.TOP.keys, session_keys.GRAVITY_VECTOR])
    for section in (*session_keys.TOP.sections, session_keys.GRAVITY):
        text += _section(section, section.name)
    return text + _refused(session_keys.NOT_IN_A_SCHEMA)


def _camera_page() -> str:
    text = _head(
        "The camera's file", ["camera"], "ROS `camera_info`, YAML. Keys that are not listed are not read."
    )
    rows = [
        ("camera_matrix", camera_keys.MATRIX),
        ("distortion_model", f"{camera_keys.MODEL} One of {', '.join(f'`{m}`' for m in COEFFICIENT_NAMES)}."),
        ("distortion_coefficients", camera_keys.COEFFICIENTS),
    ]
    text += "\n" + _table((camera_keys.WIDTH, camera_keys.HEIGHT, camera_keys.CAMERA_NAME))
    text += "".join(f"| `{name}` | | must be given | {what} |\n" for name, what in rows)
    text += "\n| lens model | coefficients |\n| --- | --- |\n"
    text += "".join(f"| `{model}` | {', '.join(names)} |\n" for model, names in COEFFICIENT_NAMES.items())
    return text + _refused(camera_keys.NOT_IN_A_SCHEMA)


def _servos_page() -> str:
    text = _head(
        "servos.toml",
        [f"servos-{make}" for make in servo_keys.MAKES],
        "Which servo is which joint; the meaning is in [robots](../robots.md). A key that is not listed is refused, so that a misspelt limit is not ignored.",
    )
    for make in servo_keys.MAKES:
        text += f"\n## {make.capitalize()}\n"
        for section in (servo_keys.BUS[make], servo_keys.SERVO[make]):
            text += f"\n### [{section.name}]\n\n{section.what}\n\n{_table(section.keys)}"
    text += f"\n## [rest]\n\n{servo_keys.REST}\n"
    return text + _refused(servo_keys.NOT_IN_A_SCHEMA)


def _plan_page() -> str:
    text = _head(
        "plan.json",
        ["plan"],
        "Beside it lie postures.csv and views.csv ([setting up](../setting-up.md#the-plan)). A key that is not listed is refused.",
    )
    text += f"\n## The document\n\n{_table(plan_keys.TOP.keys)}"
    text += "".join(_objects(section, section.name) for section in plan_keys.TOP.sections)
    return text + _refused(plan_keys.NOT_IN_A_SCHEMA)


def _objects(section: Section, name: str) -> str:
    """A section of a JSON document, and those within it."""
    listed = "A list of objects. " if section.repeated else ""
    text = f"\n## `{name}`\n\n{listed}{section.what}\n\n{_table(section.keys)}"
    return text + "".join(_objects(inner, f"{name}.{inner.name}") for inner in section.sections)


def _diagnosis_page() -> str:
    text = _head(
        "diagnosis.json",
        ["diagnosis"],
        "Keys that are not listed may be there, because a newer core may write more. The meaning is in [diagnosing](../diagnosing.md).",
    )
    for name, kind in described().items():
        title = "The document" if not name else name
        lines = (kind.__doc__ or "").strip().splitlines()
        first = lines[0] if lines else ""
        text += f"\n## {title}\n\n{first}\n\n| key | type |\n| --- | --- |\n"
        for key, hint in kind.__annotations__.items():
            if key != "document":
                text += f"| `{key}` | {_type_in_words(str(hint))} |\n"
    return text


def _type_in_words(hint: str) -> str:
    """A Python type in the terms of JSON: `tuple[Cause, ...]` as `list of Cause`."""
    for pattern, words in (
        (r"tuple\[(\w+(?:\[[^\[\]]*\])?), \.\.\.\]", r"list of \1"),
        (r"tuple\[([^\[\]]*)\]", r"list of \1"),
        (r"Mapping\[str, ([^\[\]]*)\]", r"object of \1"),
        (r"\bIntegers\b", "list of int"),
        (r"\bFloats\b", "list of float"),
        (r" \| None", ", or null"),
        (r"\bstr\b", "text"),
        (r"\bfloat\b", "number"),
        (r"\bint\b", "whole number"),
        (r"\bbool\b", "true or false"),
    ):
        hint = re.sub(pattern, words, hint)
    return hint
