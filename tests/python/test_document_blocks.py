"""Every block and every printed output of README and docs/ has a test that runs it or compares it, or stands in a list with the reason why none can."""

from __future__ import annotations

import re
import sys

import pytest

from document_commands import (
    DOCUMENTS,
    ELSEWHERE,
    NOT_IN_TESTS,
    OTHERS,
    PROGRAM,
    PROJECT,
    RUN,
    Printed,
    blocks,
    commands,
    elsewhere,
    runs_as_printed,
)

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

COMPARED_ELSEWHERE = {("docs/first-hour.md", "plan"), ("docs/measuring.md", "mirror")}
"""Outputs that `test_first_hour.py` compares with what the same rows tell again, and `test_mirror_pictures.py` where the pictures are."""


def listed() -> list[tuple[str, str, str]]:
    """Document, language and text of every block."""
    found = []
    for file in DOCUMENTS:
        name = file.relative_to(PROJECT).as_posix()
        found += [(name, language, text) for language, text in blocks(file.read_text(encoding="utf-8"))]
    return found


def lines_of(language: str, text: str) -> list[str]:
    """The commands of a block of shell, each in one line."""
    if language == "console":
        return re.findall(r"^\$ (.*)$", text, re.MULTILINE)
    return [
        line for line in text.replace("\\\n", " ").splitlines() if line.strip() and not line.startswith("#")
    ]


def other(name: str, text: str) -> tuple[str, str] | None:
    return next(
        (proof for (file, start), proof in OTHERS.items() if file == name and text.startswith(start)), None
    )


def unproved(name: str, language: str, text: str) -> list[str]:
    """What of a block nothing runs."""
    if other(name, text) is not None:
        return []
    if language not in ("", "sh", "bash", "console"):
        return [text.splitlines()[0]]
    left = []
    for line in lines_of(language, text):
        words = line.removeprefix(f"{PROGRAM} ")
        run = line.startswith(PROGRAM) and (
            runs_as_printed(Printed(name, " ".join(line.split()))) or elsewhere(line) is not None
        )
        if (
            not run
            and other(name, line) is None
            and not any(words.startswith(start) for start in NOT_IN_TESTS)
        ):
            left.append(line)
    return left


def test_every_block_is_run_by_a_test() -> None:
    found = listed()
    assert len(found) > 60
    assert [(name, line) for name, language, text in found for line in unproved(name, language, text)] == []


def test_every_printed_output_is_compared() -> None:
    printed = [p for p in commands() if p.output is not None]
    assert len(printed) > 25
    left = [
        p.words
        for p in printed
        if p.words.split()[1] not in RUN.get(p.document, ())
        and (p.document, p.words.split()[1]) not in COMPARED_ELSEWHERE
    ]
    assert left == []


def test_a_block_that_nothing_runs_would_be_seen() -> None:
    assert unproved("README.md", "sh", "frobnicate --all\n") == ["frobnicate --all"]
    assert unproved("README.md", "python", "import this\n") == ["import this"]
    assert unproved("docs/index.md", "sh", f"{PROGRAM} nonsense\n") == [f"{PROGRAM} nonsense"]


@pytest.mark.parametrize("key", OTHERS, ids=lambda key: ": ".join(key))
def test_the_proof_of_a_block_is_there(key: tuple[str, str]) -> None:
    name, start = key
    file, part = OTHERS[key]
    assert any(
        n == name and line.startswith(start)
        for n, language, text in listed()
        for line in (text, *lines_of(language, text))
    )
    assert not file or part in (PROJECT / "tests" / "python" / file).read_text(encoding="utf-8")


def test_nothing_that_is_run_by_hand_is_hidden_among_what_tests_run() -> None:
    by_hand = [start for start, proof in ELSEWHERE.items() if proof.by_hand]
    assert by_hand == [start for start in NOT_IN_TESTS if start in ELSEWHERE]


def test_the_tutorial_quotes_the_first_hour() -> None:
    hour = (PROJECT / "docs" / "first-hour.md").read_text(encoding="utf-8").splitlines()
    quoted = [
        line
        for name, language, text in listed()
        if name == "docs/tutorial.md" and language == "text"
        for line in text.splitlines()
    ]
    assert len(quoted) > 10
    for line in quoted:
        assert any(found.startswith(line.rstrip(" │")) for found in hour), line


def test_the_figures_of_the_first_hour_s_table_are_those_that_its_commands_print() -> None:
    text = (PROJECT / "docs" / "first-hour.md").read_text(encoding="utf-8")
    table, rest = text.split("## An SO-101 arm")
    figures = re.findall(
        r"(\d[\d.]*) ± (\d[\d.]*)(?:°| %)",
        "".join(line for line in table.splitlines() if line.startswith("|")),
    )
    assert len(figures) >= 6
    for value, std in figures:
        assert f"+{value} ± {std} " in rest, f"{value} ± {std}"


def test_extras_that_the_documents_name_are_there() -> None:
    project = tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    named = {
        extra
        for file in DOCUMENTS
        for extras in re.findall(r"mirror-posture\[([\w,]+)\]", file.read_text(encoding="utf-8"))
        for extra in extras.split(",")
    }
    assert len(named) > 5 and named <= set(project["optional-dependencies"])
