"""Runs the commands of README and docs/ that take minutes, as they are printed: `python tests/python/slow_documents.py`.

In an empty folder, one after the other; each must end with exit code 0. What needs a camera, servos, a fleet or a
user's own files is not among them: `document_commands.ELSEWHERE` says which test runs its like.
"""

from __future__ import annotations

import shlex
import subprocess
import sys
import tempfile
import time

from document_commands import commands

SLOW = (
    ("README.md", "render"),
    ("README.md", "measure"),
    ("docs/correcting.md", "correct twin"),
    ("docs/reproduce.md", "reproduce"),
    ("docs/moving.md", "moving make"),
    ("docs/moving.md", "moving peers"),
)
"""Document, and how the command begins."""
QUARTER_OF_AN_HOUR = ("--pictures", "moving")
"""Words of commands that are run with `--all` only."""


def main() -> None:
    """Runs them; exits with 1 where one failed."""
    failed = []
    with tempfile.TemporaryDirectory() as folder:
        for printed in commands():
            words = shlex.split(printed.words)[1:]
            if not any(
                printed.document == d and printed.words.split(" ", 1)[1].startswith(w) for d, w in SLOW
            ):
                continue
            if any(option in words for option in QUARTER_OF_AN_HOUR) and "--all" not in sys.argv:
                continue
            start = time.monotonic()
            ended = subprocess.run(
                [sys.executable, "-m", "mirror_posture", *words], cwd=folder, capture_output=True, text=True
            )
            print(f"{ended.returncode}  {time.monotonic() - start:5.0f} s  {printed.words}", flush=True)
            if ended.returncode:
                failed.append(printed.words)
                print(ended.stderr)
    raise SystemExit(1 if failed else 0)


if __name__ == "__main__":
    main()
