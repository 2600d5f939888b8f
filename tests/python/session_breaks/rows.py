"""Rows of the tables and their ids."""

from __future__ import annotations

import math
import random
from pathlib import Path

from .kinds import kind, observed, read, tables, write


@kind("any")
def rows_gone(folder: Path, chance: random.Random) -> str:
    file = chance.choice(tables(folder))
    head, *body = read(file)
    share = chance.choice([0.0, 0.01, 0.03, 0.1, 0.3, 0.7])
    body = (
        body[: math.ceil(share * len(body))]
        if chance.random() < 0.5
        else chance.sample(body, math.ceil(share * len(body)))
    )
    write(file, [head, *body])
    return f"{file.name}: {share:.0%} left"


@kind("refused")
def a_row_twice(folder: Path, chance: random.Random) -> str:
    file = chance.choice(tables(folder))
    rows = read(file)
    rows.insert(chance.randrange(1, len(rows)), list(rows[chance.randrange(1, len(rows))]))
    write(file, rows)
    return file.name


@kind("refused")
def a_row_too_short_or_long(folder: Path, chance: random.Random) -> str:
    file = chance.choice(tables(folder))
    rows = read(file)
    k = chance.randrange(1, len(rows))
    rows[k] = rows[k][: chance.randrange(1, len(rows[0]))] if chance.random() < 0.5 else [*rows[k], "1"]
    write(file, rows)
    return f"{file.name}, row {k}"


@kind("refused")
def observations_of_frames_that_are_not_there(folder: Path, chance: random.Random) -> str:
    file = observed(folder)
    rows = read(file)
    c = rows[0].index("frame")
    rows[chance.randrange(1, len(rows))][c] = chance.choice(["99999", "-1", "1.5", "x"])
    write(file, rows)
    return file.name


@kind("any")
def frame_ids_shifted(folder: Path, chance: random.Random) -> str:
    """Every observation is told of the next frames."""
    file, by = observed(folder), chance.choice([1, 3])
    rows = read(file)
    c = rows[0].index("frame")
    frames = [row[0] for row in read(folder / "frames.csv")[1:]]
    after = {frame: frames[(k + by) % len(frames)] for k, frame in enumerate(frames)}
    for row in rows[1:]:
        row[c] = after[row[c]]
    write(file, rows)
    return f"by {by}"


@kind("any")
def posture_ids_of_other_rows(folder: Path, chance: random.Random) -> str:
    rows = read(folder / "frames.csv")
    c = rows[0].index("posture")
    how = chance.choice(["rolled", "all one", "every row its own", "negative", "halved"])
    ids = [row[c] for row in rows[1:]]
    new = {
        "rolled": ids[1:] + ids[:1], "all one": ["0"] * len(ids), "every row its own": [str(k) for k in range(len(ids))],
        "negative": [f"-{i}" for i in ids], "halved": [str(int(i) // 2) for i in ids],
    }[how]  # fmt: skip
    for row, value in zip(rows[1:], new, strict=True):
        row[c] = value
    write(folder / "frames.csv", rows)
    return how


@kind("refused")
def names_of_targets_that_are_not_there(folder: Path, chance: random.Random) -> str:
    file = observed(folder)
    rows = read(file)
    c = next(i for i, name in enumerate(rows[0]) if name in ("target", "marker"))
    one = chance.choice(sorted({row[c] for row in rows[1:]}))
    new = chance.choice(["nobody", one.upper() + "2", one + "_", "", "Board"])
    for row in rows[1:]:
        if row[c] == one:
            row[c] = new
    write(file, rows)
    return f"{one} is {new!r}"


@kind("any")
def two_targets_exchanged(folder: Path, chance: random.Random) -> str:
    file = observed(folder)
    rows = read(file)
    c = next(i for i, name in enumerate(rows[0]) if name in ("target", "marker"))
    names = sorted({row[c] for row in rows[1:]})
    a, b = chance.sample(names, 2)
    for row in rows[1:]:
        row[c] = {a: b, b: a}.get(row[c], row[c])
    write(file, rows)
    return f"{a} and {b}"
