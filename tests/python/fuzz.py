"""Fuzzes the borders that Python reads: `python tests/python/fuzz.py --runs 100000`, or one target: `... session_toml`.

Inputs are mutations of sound ones and of the corpus (`fuzz/corpus/`). With `--guided` the fuzzer atheris (libFuzzer for Python) steers by
coverage, where it is installed. What fails is written into the corpus's folder as `crash-...`, and is run by the tests from then on.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import random
import sys
import tempfile
import time
import warnings
from collections import Counter
from dataclasses import replace
from pathlib import Path

from fuzz_mutations import mutated, unended
from fuzz_targets import CORPUS, TARGETS, run

SLOWEST_S = 5.0


def seeds(name: str) -> list[bytes]:
    """The target's own seeds and its files in the corpus."""
    folder = CORPUS / name
    kept = [file.read_bytes() for file in sorted(folder.iterdir())] if folder.is_dir() else []
    return [*TARGETS[name].seeds, *kept]


def fuzz(name: str, runs: int, seed: int, seconds: float = float("inf"), keep: bool = False) -> Counter[str]:
    """Runs a target on its corpus and on so many mutations; how they ended."""
    target = TARGETS[name]
    ends: Counter[str] = Counter()
    own = seeds(name)
    chance, until = random.Random(f"{name}-{seed}"), time.monotonic() + seconds
    inputs = unended(chance, replace(target, seeds=tuple(own)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for number in range(len(own) + runs):
            if time.monotonic() > until:
                break
            data = own[number] if number < len(own) else next(inputs)
            begun = time.process_time()
            try:
                ends["taken" if run(target, data) else "refused"] += 1
                assert time.process_time() - begun < SLOWEST_S, f"took {time.process_time() - begun:.1f} s"
            except AssertionError as error:
                ends["failed"] += 1
                place = CORPUS / name
                if keep and ends["failed"] <= 20:
                    place.mkdir(parents=True, exist_ok=True)
                    (place / f"crash-{hashlib.sha256(data).hexdigest()[:12]}").write_bytes(data)
                print(f"{name}: {error}\n    {data[:200]!r}", flush=True)
                if not keep:
                    raise
    return ends


def guided(name: str, runs: int, seed: int) -> None:
    """libFuzzer's own search, by the coverage of this project's Python and of the parsers in Python below it."""
    import atheris

    target = TARGETS[name]
    run(target, target.seeds[0])
    for module in [
        m for m in sys.modules.values() if getattr(m, "__name__", "").startswith("mirror_posture")
    ]:
        for value in list(vars(module).values()):
            if (
                callable(value)
                and getattr(value, "__module__", None) == module.__name__
                and hasattr(value, "__code__")
            ):
                setattr(module, value.__name__, atheris.instrument_func(value))
    chance = random.Random(seed)

    def mutate(data: bytes, largest: int, number: int) -> bytes:
        if chance.random() < 0.5:
            return bytes(atheris.Mutate(data, largest))
        return mutated(data or target.seeds[0], chance, target, number)[:largest]

    with tempfile.TemporaryDirectory() as found:
        for data in seeds(name):
            Path(found, hashlib.sha256(data).hexdigest()[:12]).write_bytes(data)
        artifacts = f"{CORPUS / name}{os.sep}"
        Path(artifacts).mkdir(parents=True, exist_ok=True)
        atheris.Setup(
            [sys.argv[0], found, f"-runs={runs}", f"-seed={seed}", "-max_len=20000", "-timeout=10", "-rss_limit_mb=2000",
             f"-artifact_prefix={artifacts}"],
            lambda data: run(target, data) and None, custom_mutator=mutate,
        )  # fmt: skip
        warnings.simplefilter("ignore")
        atheris.Fuzz()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("targets", nargs="*", help=f"Of {', '.join(TARGETS)}; all without one.")
    parser.add_argument("--runs", type=int, default=100_000, help="Of each target.")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=float("inf"), help="No longer than this for each.")
    parser.add_argument("--guided", action="store_true", help="By coverage, one target.")
    options = parser.parse_args()
    if options.guided:
        guided(options.targets[0], options.runs, options.seed)
    else:
        failed = 0
        for name in options.targets or TARGETS:
            begun = time.process_time()
            ends = fuzz(name, options.runs, options.seed, options.seconds, keep=True)
            failed += ends["failed"]
            print(
                f"{name}: {sum(ends.values())} runs in {time.process_time() - begun:.0f} s, {dict(ends)}",
                flush=True,
            )
        sys.exit(1 if failed else 0)
