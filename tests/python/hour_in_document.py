"""What docs/first-hour.md quotes of a stranger's hour, compared with an hour that was just run, or written anew.

    python tests/python/strangers_hour.py OUT so101 folder
    python tests/python/hour_in_document.py OUT so101 folder [--write]

Written anew, what was detected is kept beside (`recorded_hour`): with it the tests run the page's commands without the pictures.
A quotation leaves out where the meshes lie (`--package`), the frames that `capture` tells one by one, and what `check` finds plausible.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

from document_commands import ANYTHING, PROGRAM, PROJECT, same
from recorded_hour import keep

DOCUMENT = PROJECT / "docs" / "first-hour.md"
SECTIONS = {
    ("so101", "folder"): "An SO-101 arm",
    ("g1-swapped", "folder"): "A G1's arm",
    ("so101", "mcap"): "The SO-101 from a recording",
    ("so101-swapped", "lerobot"): "The SO-101 from a LeRobot dataset, two servos exchanged",
}
AS_ABOVE = ("board", "init", "plan", "check")
"""Commands that the sections of recordings do not repeat."""


def said(transcript: str) -> dict[str, str]:
    """By command line, without `--package`: what was said."""
    found = {}
    for block in re.findall(r"^```\n\$ (.*?)^```", transcript, re.MULTILINE | re.DOTALL):
        line, _, output = block.partition("\n")
        found[re.sub(r" --package \S+", "", line)] = "".join(
            one.rstrip() + "\n" for one in output.splitlines()
        )
    return found


def quoted(line: str, output: str) -> str:
    """The output as the document prints it."""
    if line.startswith(f"{PROGRAM} capture"):
        first, *others = re.findall(r"^frame .*\n", output, re.MULTILINE)
        output = output.replace("".join([first, *others]), f"{first}{ANYTHING}\n")
    if line.startswith(f"{PROGRAM} plan"):
        output = re.sub(r"choosing among \d+ pictures", f"choosing among {ANYTHING} pictures", output)
    if line.startswith(f"{PROGRAM} check"):
        output = output.partition("What is plausible")[0] + f"{ANYTHING}\n"
    return output


def section_of(document: str, title: str) -> tuple[int, int]:
    """Where a section of the document begins and ends."""
    begin = document.index(f"## {title}\n")
    end = document.find("\n## ", begin)
    return begin, len(document) if end < 0 else end + 1


def printed(section: str) -> dict[str, str]:
    """By command line: the output that a section prints."""
    blocks = re.findall(r"^```console\n\$ (.*?)^```", section, re.MULTILINE | re.DOTALL)
    return {line: output for line, _, output in (block.partition("\n") for block in blocks)}


def differences(section: str, transcript: str) -> list[str]:
    """Commands that the section prints otherwise than they ran, and those that it lacks."""
    ran, told = said(transcript), printed(section)
    missing = [line for line in ran if line not in told and line.split()[1] not in AS_ABOVE]
    wrong = [line for line, output in told.items() if line not in ran or same(output, ran[line]) is not None]
    return [f"not printed: {line}" for line in missing] + [f"printed otherwise: {line}" for line in wrong]


def main() -> None:
    """Compares, or writes; exits with 1 where something differs."""
    out, name, way = sys.argv[1:4]
    transcript = (Path(out) / "transcript.md").read_text(encoding="utf-8")
    document = DOCUMENT.read_text(encoding="utf-8")
    begin, end = section_of(document, SECTIONS[name, way])
    section = document[begin:end]
    if "--write" in sys.argv:
        from strangers_hour import by_process

        detected = Path(out) / "detected"
        by_process(Path(out), ("detect", "session", "--out", "detected"))
        keep(Path(out) / "session", detected, f"{name}-{way}")
        head = section.partition("```console")[0]
        short = way != "folder"
        blocks = [
            f"```console\n$ {line}\n{quoted(line, output)}```\n"
            for line, output in said(transcript).items()
            if not (short and line.split()[1] in AS_ABOVE)
        ]
        section = head + "\n".join(blocks) + ("\n" if end < len(document) else "")
        DOCUMENT.write_text(document[:begin] + section + document[end:], encoding="utf-8")
    found = differences(section, transcript)
    print("\n".join(found) or "as printed")
    raise SystemExit(bool(found))


if __name__ == "__main__":
    main()
