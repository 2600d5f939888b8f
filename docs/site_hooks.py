"""What the site is built from beside the pages: references made by the product itself, and the notebooks as pages."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

DOCS = Path(__file__).resolve().parent
REFERENCE = DOCS / "reference"
NOTEBOOKS = DOCS / "notebooks"


def on_config(config: Any) -> Any:
    """Pages that the navigation does not name yet stand under one head."""
    named = json.dumps(config["nav"])
    files = (file.relative_to(DOCS).as_posix() for file in sorted(DOCS.rglob("*.md")))
    more = [name for name in files if name not in named and not name.startswith("reference/")]
    if more:
        config["nav"].append({"More": more})
    return config


def on_pre_build(config: Any) -> None:
    """Writes docs/reference, which is not kept."""
    from mirror_posture.reference import write_reference

    REFERENCE.mkdir(exist_ok=True)
    write_reference(REFERENCE)
    (REFERENCE / "commands.md").write_text(commands(), encoding="utf-8")
    for file in sorted(NOTEBOOKS.glob("*.ipynb")):
        (REFERENCE / f"notebook-{file.stem}.md").write_text(notebook_as_page(file), encoding="utf-8")


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Links to files beside docs/ (sources, benches) are words here."""

    def outside(link: re.Match[str]) -> str:
        target = (DOCS / page.file.src_uri).parent / link[2].partition("#")[0]
        return link[0] if target.resolve().is_relative_to(DOCS) else link[1]

    return re.sub(r"\[([^\]]+)\]\((\.\.[^)\s]*)\)", outside, markdown)


def commands() -> str:
    """Every command with its options, from the program itself."""
    import typer.main

    from mirror_posture.cli.app import app

    text = "# Commands\n\nMade from the program; `mirror-posture COMMAND --help` says the same.\n"

    def describe(name: str, command: Any) -> str:
        if hasattr(command, "commands"):
            return "".join(describe(f"{name} {inner}", one) for inner, one in command.commands.items())
        found = f"\n## {name}\n\n{plain(command.help)}\n\n| option | default | what |\n| --- | --- | --- |\n"
        for parameter in command.params:
            if getattr(parameter, "hidden", False) or parameter.name == "help":
                continue
            is_option = parameter.param_type_name == "option"
            names = ", ".join(f"`{one}`" for one in parameter.opts) if is_option else f"`{parameter.name.upper()}`"
            default = "" if parameter.default in (None, False, ()) or callable(parameter.default) else f"`{parameter.default}`"
            found += f"| {names} | {default} | {plain(getattr(parameter, 'help', '') or '').replace('|', '/')} |\n"
        return found

    def plain(words: str | None) -> str:
        # An angle bracket would be taken for HTML.
        return (words or "").replace("<", "&lt;").strip() if words and "\n" in words else " ".join((words or "").split())

    group: Any = typer.main.get_command(app)
    for name, command in group.commands.items():
        text += describe(name, command)
    return text


def notebook_as_page(file: Path) -> str:
    """Text, code and printed outputs of a notebook, as Markdown."""
    tree = json.loads(file.read_text(encoding="utf-8"))
    parts = []
    for cell in tree["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source)
            continue
        parts.append(f"```python\n{source}\n```")
        printed = "".join("".join(output.get("text", [])) for output in cell["outputs"])
        if printed:
            parts.append(f"```text\n{printed.rstrip()}\n```")
    return "\n\n".join(parts) + f"\n\nThe notebook is `docs/notebooks/{file.name}`; the tests run it.\n"
