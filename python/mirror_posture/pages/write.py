"""From a template to the text of a page."""

from __future__ import annotations

import re
from collections.abc import Mapping
from importlib import resources
from typing import Any

from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup, escape

from .drawing import Drawing

BASE = "base.html.j2"


def render(package: str, template: str, values: Mapping[str, Any]) -> str:
    """The page of a template of a package, which extends `base.html.j2`; all values are escaped."""

    def load(name: str) -> str:
        where = __package__ if name == BASE else package
        return resources.files(where).joinpath(name).read_text(encoding="utf-8")

    environment = Environment(
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        loader=FunctionLoader(load),
    )
    environment.filters["code"] = _code
    environment.filters["name"] = _name
    return environment.get_template(template).render(values)


def inline(drawing: Drawing, says: str) -> Markup:
    """A picture within the page, with a description for readers who cannot see it."""
    head = f'<svg role="img" aria-label="{escape(" ".join(says.split()))}"'
    if (width := re.search(r'<svg[^>]*? width="([\d.]+)pt"', drawing.svg)) is not None:
        head += f' style="--drawn: {float(width[1]) / 0.75:.0f}px"'
    return Markup(drawing.svg.replace("<svg", head, 1))


def _code(text: str) -> Markup:
    """Words between backticks as code, the rest escaped."""
    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(text))))


def _name(text: str) -> Markup:
    """Words with names of links and joints in them, which may be broken behind an underscore and nowhere else."""
    return Markup(str(escape(text)).replace("_", "_<wbr>"))
