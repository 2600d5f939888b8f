"""Writes the results: one picture for each figure, and the comparison as Markdown, as one HTML file and as
JSON."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, StrictUndefined

from mirror_posture.output_files import write_file

from .claims import Experiment
from .experiments import Options

TEMPLATE = "report.html.j2"
COLUMNS = ("", "what", "the paper", "here", "")


def write(folder: Path, options: Options, done: Sequence[Experiment]) -> list[Path]:
    """Writes all results so far; called after each experiment, so that a stop loses nothing."""
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for experiment in done:
        for name, picture in experiment.pictures.items():
            file = folder / name
            if not file.exists() or file.read_bytes() != picture:
                write_file(file, picture)
            files.append(file)
    texts = {
        "reproduce.json": json.dumps(document(options, done), indent=1, allow_nan=False, ensure_ascii=False),
        "report.md": markdown(options, done),
        "report.html": html(options, done),
    }
    for name, text in texts.items():
        write_file(folder / name, text)
        files.append(folder / name)
    return files


def document(options: Options, done: Sequence[Experiment]) -> dict[str, Any]:
    """The whole comparison, as JSON can hold it."""
    return {
        "paper": "Hayashi, Tomizawa, Suehiro, Kudoh: Humanoid self-correction of posture using a mirror. IROS 2013",
        "options": {
            "pictures": options.pictures,
            "noise_px": None if options.pictures else options.noise_px,
            "trials": options.trials,
            "seed": options.seed,
            "only": list(options.only),
        },
        "experiments": {
            experiment.name: {
                "title": experiment.title,
                "claims": [vars(claim) for claim in experiment.claims],
                "notes": list(experiment.notes),
                "pictures": list(experiment.pictures),
                "data": _plain(experiment.data),
            }
            for experiment in done
        },
    }


def rows(done: Sequence[Experiment]) -> list[tuple[str, str, str, str, str]]:
    """The table: figure, what, the paper, here, verdict."""
    return [
        (experiment.label if first else "", claim.what, claim.paper, claim.here, claim.status)
        for experiment in done
        for first, claim in zip((True, *[False] * len(experiment.claims)), experiment.claims, strict=False)
    ]


def how(options: Options) -> str:
    """How the looks were made, in a sentence."""
    if options.pictures:
        return "drawn pictures (glass, sensor noise) through detection"
    return f"exact pixels with {options.noise_px:g} px of noise"


def markdown(options: Options, done: Sequence[Experiment]) -> str:
    """The table, then each figure with its notes."""
    lines = [
        f"# The paper's experiments in simulation\n\nMade with {how(options)}, seed {options.seed}.\n",
        "| figure | what | the paper | here | |",
        "| --- | --- | --- | --- | --- |",
    ]
    lines += ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows(done)]
    for experiment in done:
        lines.append(f"\n## {experiment.label}: {experiment.title}\n")
        lines += [f"![{experiment.title}]({name})" for name in experiment.pictures]
        lines += [f"\n{note}" for note in experiment.notes]
    return "\n".join(lines) + "\n"


def html(options: Options, done: Sequence[Experiment]) -> str:
    """One file that needs no network."""
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    template = resources.files(__package__).joinpath(TEMPLATE).read_text(encoding="utf-8")
    pictures = {
        name: base64.b64encode(picture).decode("ascii")
        for experiment in done
        for name, picture in experiment.pictures.items()
    }
    return environment.from_string(template).render(
        done=done, rows=rows(done), how=how(options), seed=options.seed, pictures=pictures
    )


def _plain(value: Any) -> Any:
    """Arrays as lists; what is not a number (not seen) as null."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value
