"""Units and noise of the whole session."""

from __future__ import annotations

import random
from pathlib import Path

from .kinds import edit, joints_of, kind, read, scaled, write


@kind("any")
def commands_in_another_unit(folder: Path, chance: random.Random) -> str:
    rows = read(folder / "frames.csv")
    factor = chance.choice([57.29577951, 1000.0, 0.01745329252, 11.377, 651.9])
    for c in joints_of(rows):
        scaled(rows, c, factor)
    write(folder / "frames.csv", rows)
    return f"by {factor:g}"


@kind("any")
def points_in_another_unit(folder: Path, chance: random.Random) -> str:
    rows = read(folder / "points.csv")
    factor = chance.choice([1000.0, 100.0, 39.37, 1e-3, 3.281, 1e6])
    for axis in "xyz":
        scaled(rows, rows[0].index(axis), factor)
    write(folder / "points.csv", rows)
    return f"by {factor:g}"


@kind("any")
def noise_that_cannot_be(folder: Path, chance: random.Random) -> str:
    value = chance.choice(
        [
            "0.0",
            "0",
            "-0.001",
            "1e-300",
            "1e-12",
            "1e-6",
            "0.02",
            "0.049",
            "0.2",
            "1.0",
            "10.0",
            "19.0",
            "300",
            "nan",
            "inf",
            '"x"',
        ]
    )
    edit(folder / "session.toml", r"(p\w+_std) = .*", rf"\1 = {value}")
    return value


@kind("refused")
def noise_of_nothing_or_everything(folder: Path, chance: random.Random) -> str:
    value = chance.choice(["0.0", "-0.1", "1000.0", "nan", "1e300"])
    edit(folder / "session.toml", r"(p\w+_std) = .*", rf"\1 = {value}")
    return value


@kind("refused")
def gravity_in_another_unit(folder: Path, chance: random.Random) -> str:
    value = chance.choice(
        [
            "[0, 0, -1.0]",
            "[0.0, 0.0, -9810.0]",
            "[0, 0, 0]",
            "[0, 0]",
            "-9.81",
            "[0, 0, nan]",
            "[0, 0, -32.2]",
        ]
    )
    edit(folder / "session.toml", r"gravity = .*", f"gravity = {value}")
    return value


@kind("any")
def gravity_in_another_direction(folder: Path, chance: random.Random) -> str:
    value = chance.choice(["[0.0, 0.0, 9.81]", "[9.81, 0, 0]", "[0, -9.81, 0]"])
    edit(folder / "session.toml", r"gravity = .*", f"gravity = {value}")
    return value


@kind("refused")
def lengths_in_mm(folder: Path, chance: random.Random) -> str:
    keys = ["square", "diameter", "glass_thickness"]
    key = chance.choice(keys)
    edit(folder / "session.toml", rf"{key} = (0\.0*[1-9]\d*)", lambda m: f"{key} = {1000.0 * float(m[1])}")
    return key
