"""Commands killed at random moments: what stands in their place afterwards is whole, the old or the new.

`python tests/python/killed_commands.py SESSION... --kills 500`: `diagnose --out` and `apply` write into the same folders again and
again, over what an earlier run (of another session, too) left there, and are killed by SIGKILL at a random moment.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from mirror_posture import load_session


def start(words: Sequence[str]) -> int:
    """A command in a forked process; its number."""
    child = os.fork()
    if child:
        return child
    try:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        sys.argv = ["mirror-posture", *words]
        from mirror_posture.cli.app import main

        main()
    except SystemExit as end:
        os._exit(int(end.code or 0))
    except BaseException:
        os._exit(99)
    os._exit(0)


def whole(out: Path, better: Path, sentences: dict[str, str]) -> tuple[str | None, str | None]:
    """Whose diagnosis and whose corrected session stand there; fails for halves and mixtures."""
    of = None
    if out.exists():
        assert not (out / ".being-replaced").exists()
        tree = json.loads((out / "diagnosis.json").read_text(encoding="utf-8"))
        of = next(name for name, sentence in sentences.items() if tree["sentence"] == sentence)
        page = (out / "report.html").read_text(encoding="utf-8")
        assert page.rstrip().endswith("</html>") and f"<title>Diagnosis of {of}</title>" in page
        pictures = sorted(path.name for path in (out / "pictures").iterdir())
        assert "gap.png" in pictures and all(
            (out / "pictures" / name).read_bytes().endswith(b"IEND\xaeB`\x82") for name in pictures
        )
        assert (out / "next-postures.csv").exists() == bool(tree["next_postures"])
    corrected = None
    if better.exists():
        load_session(better)
        corrected = (better / "session.toml").read_text(encoding="utf-8").splitlines()[0]
    return of, corrected


def run(sessions: Sequence[Path], kills: int, seed: int, below: Path) -> Counter[str]:
    """Kills so many commands; what stood there, by whose it was."""
    from mirror_posture.diagnosis import diagnose
    from mirror_posture.diagnosis.page import write_report  # noqa: F401

    chance = random.Random(seed)
    out, better = below / "out", below / "better"
    sentences, times = {}, {}
    for session in sessions:
        begun = time.monotonic()
        sentences[session.name] = diagnose(session).sentence
        os.waitpid(start(["diagnose", str(session), "--out", str(below / f"first-{session.name}")]), 0)
        times[session.name] = time.monotonic() - begun
    seen: Counter[str] = Counter()
    for _ in range(kills):
        session = chance.choice(list(sessions))
        applied = chance.random() < 0.3
        first = below / f"first-{session.name}"
        words = (
            ["apply", str(session), str(first), "--out", str(better), "--overwrite"]
            if applied
            else ["diagnose", str(session), "--out", str(out)]
        )
        child = start(words)
        time.sleep(chance.uniform(0.0, (0.3 if applied else 1.0) * times[session.name]))
        os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
        of, corrected = whole(out, better, sentences)
        seen["ended before the kill" if os.WIFEXITED(status) else "killed"] += 1
        seen[f"{'a' if of or corrected else 'no'} whole result stands there"] += 1
    for session in sessions[:1]:
        assert os.waitpid(start(["diagnose", str(session), "--out", str(out)]), 0)[1] == 0
        assert (
            os.waitpid(start(["apply", str(session), str(out), "--out", str(better), "--overwrite"]), 0)[1]
            == 0
        )
    left = [path.name for path in below.iterdir() if path.name.startswith(".")]
    assert not left, left
    return seen


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sessions", type=Path, nargs="+")
    parser.add_argument("--kills", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    below = Path(tempfile.mkdtemp())
    try:
        print(dict(run([path.resolve() for path in options.sessions], options.kills, options.seed, below)))
    finally:
        shutil.rmtree(below)
