"""Cells and columns of the tables."""

from __future__ import annotations

import math
import random
from pathlib import Path

from .kinds import TEXT, NotHere, joints_of, kind, read, scaled, tables, write


@kind("any")
def cells_of_something_else(folder: Path, chance: random.Random) -> str:
    odd = ["", "nan", "inf", "-inf", "1e308", "-1e308", "1e999", "x", "0x10", "1,5", "1_0", "9" * 40, "-1", "1e15", "é", "\t", '"', "None",
           "TRUE", "1e-320", "२", "\u202e5", "=1+1", "0,1"]  # fmt: skip
    file = chance.choice(tables(folder))
    rows = read(file)
    for _ in range(chance.choice([1, 1, 2, 3, 30])):
        rows[chance.randrange(1, len(rows))][chance.randrange(len(rows[0]))] = chance.choice(odd)
    write(file, rows)
    return file.name


@kind("any")
def a_digit_of_a_cell(folder: Path, chance: random.Random) -> str:
    file = chance.choice(tables(folder))
    rows = read(file)
    r, c = chance.randrange(1, len(rows)), chance.randrange(len(rows[0]))
    text = rows[r][c]
    k = chance.randrange(len(text) + 1)
    rows[r][c] = text[:k] + chance.choice("0123456789.-e ") + text[k + 1 :]
    write(file, rows)
    return f"{file.name}: {text!r} is {rows[r][c]!r}"


@kind("any")
def a_column_in_another_unit(folder: Path, chance: random.Random) -> str:
    file = chance.choice(tables(folder))
    rows = read(file)
    c = chance.choice([i for i, name in enumerate(rows[0]) if name not in TEXT])
    factor = chance.choice([1000.0, 57.29577951, 1e-3, -1000.0, 1e6, 1e200, -1.0, 0.01745329252, 0.1, 25.4])
    scaled(rows, c, factor)
    write(file, rows)
    return f"{file.name}: {rows[0][c]} by {factor:g}"


@kind("any")
def a_column_shifted(folder: Path, chance: random.Random) -> str:
    file = chance.choice(tables(folder))
    rows = read(file)
    c = chance.choice([i for i, name in enumerate(rows[0]) if name not in TEXT])
    by = chance.choice([1e7, -1.0, 0.5, math.pi, 100.0])
    scaled(rows, c, 1.0, by)
    write(file, rows)
    return f"{file.name}: {rows[0][c]} by {by:g}"


@kind("any")
def a_column_gone(folder: Path, chance: random.Random) -> str:
    file = chance.choice(tables(folder))
    rows = read(file)
    c = chance.randrange(len(rows[0]))
    write(file, [row[:c] + row[c + 1 :] for row in rows])
    return f"{file.name}: {rows[0][c]}"


@kind("refused")
def a_column_twice(folder: Path, chance: random.Random) -> str:
    file = chance.choice(tables(folder))
    rows = read(file)
    c = chance.randrange(len(rows[0]))
    write(
        file, [[*row, row[c] if k else row[c] + chance.choice(["", " ", "\t"])] for k, row in enumerate(rows)]
    )
    return f"{file.name}: {rows[0][c]}"


@kind("any")
def a_column_of_another_name(folder: Path, chance: random.Random) -> str:
    file = chance.choice(tables(folder))
    rows = read(file)
    c = chance.randrange(len(rows[0]))
    name = rows[0][c]
    rows[0][c] = chance.choice([name.upper(), " ", "no_such_joint", "measured:" + name, "accelerometer:base_link:x", "é", name + "\u200b",
                                name[:-1], "frame2", "measured:"])  # fmt: skip
    write(file, rows)
    return f"{file.name}: {name} is {rows[0][c]!r}"


@kind("any")
def a_column_empty_constant_rolled_or_reversed(folder: Path, chance: random.Random) -> str:
    file = chance.choice(tables(folder))
    rows = read(file)
    c = chance.randrange(len(rows[0]))
    how = chance.choice(["empty", "constant", "rolled", "reversed", "sorted", "shuffled"])
    values = [row[c] for row in rows[1:]]
    by = chance.choice([1, 2, 7])
    new = {
        "empty": [""] * len(values), "constant": values[:1] * len(values), "rolled": values[by:] + values[:by],
        "reversed": values[::-1], "sorted": sorted(values), "shuffled": chance.sample(values, len(values)),
    }[how]  # fmt: skip
    for row, value in zip(rows[1:], new, strict=True):
        row[c] = value
    write(file, rows)
    return f"{file.name}: {rows[0][c]} {how}"


@kind("any")
def two_columns_exchanged(folder: Path, chance: random.Random) -> str:
    file = chance.choice(tables(folder))
    rows = read(file)
    a, b = chance.sample(range(len(rows[0])), 2)
    rows[0][a], rows[0][b] = rows[0][b], rows[0][a]
    write(file, rows)
    return f"{file.name}: {rows[0][a]} and {rows[0][b]}"


@kind("any")
def columns_of_sensors_that_read_nonsense(folder: Path, chance: random.Random) -> str:
    rows = read(folder / "frames.csv")
    j = chance.choice(joints_of(rows))
    how = chance.choice(
        [
            "encoder in degrees",
            "encoder of noise",
            "encoder of zeros",
            "accelerometer of noise",
            "encoder of nowhere",
        ]
    )
    if how.startswith("accelerometer"):
        for axis in "xyz":
            for k, row in enumerate(rows):
                row.append(repr(chance.gauss(0, 10)) if k else f"accelerometer:base_link:{axis}")
    else:
        name = f"measured:{'nowhere' if 'nowhere' in how else rows[0][j]}"
        if name in rows[0]:
            raise NotHere
        for k, row in enumerate(rows):
            value = {"degrees": 57.29577951 * float(row[j]) if k else 0.0, "noise": chance.gauss(0, 1)}.get(
                how.split()[-1], 0.0
            )
            row.append(repr(value) if k else name)
    write(folder / "frames.csv", rows)
    return how
