"""Ways to break a session, by kind; each is told by what must come of it.

`refused`: one clear error. `same`: the diagnosis of the whole session, since nothing that counts was changed. `any`: an error, or an
answer other than "nothing is wrong": what was broken may still be diagnosed, named as a mistake, or be too little.
"""

from __future__ import annotations

import csv
import io
import math
import os
import random
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

Rows = list[list[str]]
Must = Literal["refused", "same", "any"]
Break = Callable[[Path, random.Random], str]
TEXT = ("target", "marker", "via", "image")
KEYS = (*TEXT, "frame", "posture", "index", "time_s")


class NotHere(Exception):
    """The session has nothing that could be broken so."""


@dataclass(frozen=True)
class Kind:
    """A way to break: `make` changes the folder and says what it did."""

    name: str
    must: Must
    make: Break


KINDS: list[Kind] = []


def kind(must: Must) -> Callable[[Break], Break]:
    def note(make: Break) -> Break:
        KINDS.append(Kind(make.__name__.replace("_", " "), must, make))
        return make

    return note


def read(file: Path) -> Rows:
    if not file.exists():
        raise NotHere
    with file.open(newline="", encoding="utf-8") as stream:
        return list(csv.reader(stream))


def write(file: Path, rows: Rows) -> None:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    file.write_text(text.getvalue(), encoding="utf-8")


def tables(folder: Path) -> list[Path]:
    return [
        folder / name for name in ("frames.csv", "detections.csv", "points.csv") if (folder / name).exists()
    ]


def observed(folder: Path) -> Path:
    return folder / ("detections.csv" if (folder / "detections.csv").exists() else "points.csv")


def scaled(rows: Rows, column: int, factor: float, shift: float = 0.0) -> None:
    for row in rows[1:]:
        row[column] = repr(float(row[column]) * factor + shift)


def edit(file: Path, pattern: str, by: str | Callable[[re.Match[str]], str], count: int = 0) -> None:
    """Replaces in a file, which must change."""
    if not file.exists():
        raise NotHere
    text = file.read_text(encoding="utf-8")
    new = re.sub(pattern, by, text, count=count)
    if new == text:
        raise NotHere
    file.write_text(new, encoding="utf-8")


def joints_of(rows: Rows) -> list[int]:
    return [i for i, name in enumerate(rows[0]) if name not in KEYS and ":" not in name]


# Cells.


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


# Columns.


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


# Rows and ids.


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


# Units of the whole session.


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


# session.toml.


@kind("any")
def a_line_of_the_settings_gone(folder: Path, chance: random.Random) -> str:
    file = folder / "session.toml"
    lines = file.read_text(encoding="utf-8").splitlines()
    k = chance.choice([k for k, line in enumerate(lines) if line.strip()])
    gone = lines.pop(k)
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return gone


@kind("any")
def a_value_of_the_settings(folder: Path, chance: random.Random) -> str:
    odd = ["1e308", "-1", "0", "nan", "inf", '""', '"x"', "[]", "{}", "true", "1000.0", "[0.0, 0.0, -1.0]", "[1, 1]", "[100, 100]",
           '"../../etc/passwd"', '"/etc/passwd"', "2026-01-01", "'''", "9" * 400, '"\\u0000"', "[[[[[[[]]]]]]]", '"base_link"']  # fmt: skip
    file = folder / "session.toml"
    lines = file.read_text(encoding="utf-8").splitlines()
    k = chance.choice([i for i, line in enumerate(lines) if "=" in line])
    lines[k] = lines[k].partition("=")[0] + "= " + chance.choice(odd)
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return lines[k][:60]


@kind("refused")
def links_that_are_not_there(folder: Path, chance: random.Random) -> str:
    key = chance.choice(["link", "root"])
    edit(folder / "session.toml", rf'\n{key} = "[^"]+"', f'\n{key} = "nowhere"', count=1)
    return key


@kind("any")
def a_marker_on_another_link(folder: Path, chance: random.Random) -> str:
    text = (folder / "session.toml").read_text(encoding="utf-8")
    links = re.findall(r'link = "(\w+_marker)"', text)
    a, b = chance.sample(links, 2)
    edit(folder / "session.toml", f'link = "{a}"', f'link = "{b}"', count=1)
    return f"{a} is {b}"


@kind("refused")
def markers_of_one_name_or_far_too_many(folder: Path, chance: random.Random) -> str:
    text = (folder / "session.toml").read_text(encoding="utf-8")
    link = re.findall(r'link = "(\w+_marker)"', text)[0]
    count = chance.choice([2, 1500])
    more = "".join(
        f'\n[[markers]]\nname = "{"same" if count == 2 else f"m{k}"}"\nlink = "{link}"\n'
        for k in range(count)
    )
    (folder / "session.toml").write_text(text + more, encoding="utf-8")
    return str(count)


@kind("any")
def a_board_of_other_corners(folder: Path, chance: random.Random) -> str:
    value = chance.choice(
        [
            "[5, 6]",
            "[7, 5]",
            "[6, 6]",
            "[2, 2]",
            "[100, 100]",
            "[101, 5]",
            "[0, 5]",
            "[6]",
            "[6.0, 5.0]",
            "[-6, 5]",
        ]
    )
    edit(folder / "session.toml", r"corners = .*", f"corners = {value}")
    return value


@kind("any")
def a_board_of_another_square(folder: Path, chance: random.Random) -> str:
    value = chance.choice([0.014, 0.02, 0.001, 0.1, 0.4, 1e-9])
    edit(folder / "session.toml", r"square = .*", f"square = {value * 1.07}")
    return f"{value * 1.07:g}"


@kind("refused")
def settings_of_another_format(folder: Path, chance: random.Random) -> str:
    a, b = chance.choice(
        [
            ('"mirror-posture/session"', '"x"'),
            ("version = 1", "version = 2"),
            ("version = 1", "version = 1.0"),
        ]
    )
    edit(folder / "session.toml", re.escape(a), b)
    return b


@kind("refused")
def settings_that_unfold(folder: Path, chance: random.Random) -> str:
    file = folder / "session.toml"
    text = file.read_text(encoding="utf-8")
    how = chance.choice(["deep", "large", "dotted", "inline"])
    more = {
        "deep": "a = " + "[" * 100_000, "large": "a = '" + "x" * 2_000_000 + "'", "dotted": ".".join("a" * 50_000) + " = 1",
        "inline": "a = " + "{a=" * 30_000 + "1" + "}" * 30_000,
    }[how]  # fmt: skip
    file.write_text(more + "\n" + text + ("" if how != "dotted" else "\n" * 1_000_001), encoding="utf-8")
    return how


# The robot.


@kind("any")
def a_robot_in_another_unit(folder: Path, chance: random.Random) -> str:
    attribute, factor = chance.choice(
        [("xyz", 1000.0), ("xyz", 100.0), ("xyz", 1e-3), ("rpy", 57.29577951), ("xyz", 39.37)]
    )
    edit(
        folder / "robot.urdf",
        rf'(<origin[^>]*){attribute}="([^"]+)"',
        lambda m: f'{m[1]}{attribute}="{" ".join(repr(float(x) * factor) for x in m[2].split())}"',
    )
    return f"{attribute} by {factor:g}"


@kind("any")
def one_part_of_the_robot(folder: Path, chance: random.Random) -> str:
    changes = [
        (r'xyz="[^"]+"', 'xyz="1e9 0 0"'), (r'xyz="[^"]+"', 'xyz="0 0"'), (r'xyz="[^"]+"', 'xyz="nan 0 0"'), (r'rpy="[^"]+"', 'rpy="0 0 90"'),
        (r'type="revolute"', 'type="floating"'), (r'type="revolute"', 'type="fixed"'), (r'type="revolute"', 'type="prismatic"'),
        (r'<axis xyz="[^"]+"', '<axis xyz="0 0 0"'), (r'<mass value="[^"]+"', '<mass value="-1"'), (r'<mass value="[^"]+"', '<mass value="1e300"'),
        (r'link="(\w+)"', 'link="nowhere"'), (r'upper="[^"]+"', 'upper="nan"'), (r'upper="[^"]+"', 'upper="-100"'), (r'lower="[^"]+"', 'lower="0.3"'),
        (r"</joint>", '<mimic joint="nowhere"/></joint>'), (r"<link name=\"\w+\"", '<link name=""'), (r"<link", "<lInk"), (r"/>", ">"),
    ]  # fmt: skip
    pattern, new = chance.choice(changes)
    file = folder / "robot.urdf"
    text = file.read_text(encoding="utf-8")
    found = list(re.finditer(pattern, text))
    if not found:
        raise NotHere
    one = chance.choice(found)
    file.write_text(text[: one.start()] + new + text[one.end() :], encoding="utf-8")
    return f"{one[0][:40]} is {new}"


@kind("refused")
def a_robot_that_unfolds(folder: Path, chance: random.Random) -> str:
    file = folder / "robot.urdf"
    text = file.read_text(encoding="utf-8")
    how = chance.choice(["entities", "deep", "attributes", "chain of mimics", "links", "cut"])
    if how == "entities":
        laughs = "".join(f"<!ENTITY l{k} '" + f"&l{k - 1};" * 10 + "'>" for k in range(1, 10))
        text = f'<!DOCTYPE r [<!ENTITY l0 "ha">{laughs}]>' + text.replace("<link", "&l9;<link", 1)
    elif how == "deep":
        text = text.replace("<link", "<a>" * 100_000 + "<link", 1)
    elif how == "attributes":
        text = text.replace("<link", "<link " + " ".join(f"a{k}='1'" for k in range(100_000)), 1)
    elif how == "chain of mimics":
        more = "".join(
            f'<link name="z{k}"/><joint name="y{k}" type="revolute"><parent link="{f"z{k - 1}" if k else "base_link"}"/><child link="z{k}"/>'
            f'<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/><mimic joint="y{(k + 1) % 9000}"/></joint>'
            for k in range(9000)
        )
        text = text.replace("</robot>", more + "</robot>")
    elif how == "links":
        text = text.replace("</robot>", "".join(f'<link name="z{k}"/>' for k in range(20_000)) + "</robot>")
    else:
        text = text[: chance.randrange(len(text) - 10)]
    file.write_text(text, encoding="utf-8")
    return how


# The camera.


@kind("any")
def a_number_of_the_camera(folder: Path, chance: random.Random) -> str:
    file = folder / "camera.yaml"
    if not file.exists():
        raise NotHere
    text = file.read_text(encoding="utf-8")
    found = list(re.finditer(r"(?<=[\[, ])-?\d+\.?\d*(?:e-?\d+)?(?=[,\]\n])", text))
    one = chance.choice(found)
    new = chance.choice(["0", "-1", "3.5", ".nan", ".inf", "1e308", "x", "[]", "1e9", "2.0"])
    file.write_text(text[: one.start()] + new + text[one.end() :], encoding="utf-8")
    return f"{one[0]} is {new}"


@kind("any")
def another_camera(folder: Path, chance: random.Random) -> str:
    how = chance.choice(
        [
            "half the resolution",
            "twice the focal length",
            "another lens",
            "principal point at the corner",
            "focal length in mm",
        ]
    )
    file = folder / "camera.yaml"
    if how == "half the resolution":
        edit(file, r"image_(width|height): *(\d+)", lambda m: f"image_{m[1]}: {int(m[2]) // 2}")
    elif how == "another lens":
        edit(file, r"plumb_bob", chance.choice(["rational_polynomial", "equidistant", "none", "3"]))
    else:
        import yaml

        tree = yaml.safe_load(file.read_text(encoding="utf-8")) if file.exists() else None
        if tree is None:
            raise NotHere
        data = tree["camera_matrix"]["data"]
        factor = {"twice the focal length": 2.0, "focal length in mm": 0.005}.get(how, 1.0)
        data[0], data[4] = data[0] * factor, data[4] * factor
        if how.startswith("principal"):
            data[2], data[5] = 0.0, 0.0
        file.write_text(yaml.safe_dump(tree), encoding="utf-8")
    return how


@kind("refused")
def a_camera_that_unfolds(folder: Path, chance: random.Random) -> str:
    file = folder / "camera.yaml"
    if not file.exists():
        raise NotHere
    text = file.read_text(encoding="utf-8")
    how = chance.choice(["aliases", "deep", "large", "many", "python"])
    text = {
        "aliases": "a0: &a0 [x]\n" + "".join(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]\n" for k in range(1, 10)),
        "deep": "a: " + "[" * 5000 + "]" * 5000 + "\n", "large": "a: '" + "x" * 2_000_000 + "'\n",
        "many": "a: [" + ", ".join("1" for _ in range(100_000)) + "]\n", "python": "a: !!python/object/apply:os.system [id]\n",
    }[how] + text  # fmt: skip
    file.write_text(text, encoding="utf-8")
    return how


# Files.


def some_file(folder: Path, chance: random.Random) -> Path:
    return chance.choice(sorted(path for path in folder.iterdir() if path.is_file()))


@kind("refused")
def a_file_that_is_none(folder: Path, chance: random.Random) -> str:
    file = some_file(folder, chance)
    data = file.read_bytes()
    how = chance.choice(
        [
            "missing",
            "pipe",
            "folder",
            "link out",
            "link to itself",
            "link to a device",
            "empty",
            "broken link",
        ]
    )
    file.unlink()
    if how == "pipe":
        os.mkfifo(file)
    elif how == "folder":
        file.mkdir()
    elif how == "link out":
        (folder.parent / f"outside-{file.name}").write_bytes(data)
        file.symlink_to(folder.parent / f"outside-{file.name}")
    elif how == "link to itself":
        file.symlink_to(file)
    elif how == "link to a device":
        file.symlink_to(chance.choice(["/dev/zero", "/dev/stdin", "/proc/self/mem"]))
    elif how == "broken link":
        file.symlink_to(folder / "nowhere")
    elif how == "empty":
        file.write_bytes(b"")
    return f"{file.name}: {how}"


@kind("any")
def a_file_damaged(folder: Path, chance: random.Random) -> str:
    file = some_file(folder, chance)
    data = file.read_bytes()
    how = chance.choice(["noise", "cut", "doubled", "a bit", "zeros", "a hole"])
    start = chance.randrange(len(data))
    new = {
        "noise": data[:start] + chance.randbytes(20) + data[start + 20 :], "cut": data[:start], "doubled": data + data,
        "a bit": data[:start] + bytes([data[start] ^ 1 << chance.randrange(8)]) + data[start + 1 :],
        "zeros": data[:start] + b"\0" * 100 + data[start + 100 :], "a hole": data[:start] + data[start + 200 :],
    }[how]  # fmt: skip
    file.write_bytes(new)
    return f"{file.name}: {how} at {start}"


@kind("refused")
def a_file_in_another_encoding(folder: Path, chance: random.Random) -> str:
    file = some_file(folder, chance)
    text = file.read_text(encoding="utf-8")
    how = chance.choice(["utf-16", "utf-32", "latin-1", "gzip"])
    if how == "gzip":
        import gzip

        file.write_bytes(gzip.compress(text.encode()))
    else:
        mark = "\n# é\n" if file.suffix in (".toml", ".yaml") else "é"
        file.write_bytes((text + mark if how == "latin-1" else text).encode(how))
    return f"{file.name}: {how}"


@kind("refused")
def a_table_of_another_dialect(folder: Path, chance: random.Random) -> str:
    file = chance.choice(tables(folder))
    text = file.read_text(encoding="utf-8")
    how = chance.choice(["semicolons", "tabs", "decimal commas", "no header", "comment"])
    text = {
        "semicolons": text.replace(",", ";"), "tabs": text.replace(",", "\t"), "decimal commas": text.replace(",", ";").replace(".", ","),
        "no header": text.partition("\n")[2], "comment": "# made by hand\n" + text,
    }[how]  # fmt: skip
    file.write_text(text, encoding="utf-8")
    return f"{file.name}: {how}"


@kind("refused")
def a_parquet_that_is_none(folder: Path, chance: random.Random) -> str:
    file = chance.choice(tables(folder))
    stream = io.BytesIO()
    pyarrow.parquet.write_table(pyarrow.csv.read_csv(file), stream)
    data = stream.getvalue()
    how = chance.choice(["both", "cut", "noise", "no magic", "csv inside", "empty", "nested", "a bomb"])
    if how != "both":
        file.unlink()
    if how == "nested":
        stream = io.BytesIO()
        pyarrow.parquet.write_table(
            pa.table({"frame": [[1, 2], [3]], "posture": [{"a": 1}, {"a": 2}]}), stream
        )
        data = stream.getvalue()
    elif how == "a bomb":
        stream = io.BytesIO()
        pyarrow.parquet.write_table(
            pa.table({"frame": pa.array([0] * 40_000_000, pa.int64())}), stream, compression="zstd"
        )
        data = stream.getvalue()
    start = chance.randrange(8, len(data) - 8)
    data = {
        "cut": data[:start], "noise": chance.randbytes(len(data)), "no magic": data[4:], "csv inside": b"frame,posture\n0,0\n", "empty": b"",
    }.get(how, data)  # fmt: skip
    file.with_suffix(".parquet").write_bytes(data)
    return f"{file.stem}: {how}"


@kind("refused")
def a_table_of_no_honest_size(folder: Path, chance: random.Random) -> str:
    file = chance.choice(tables(folder))
    text = file.read_text(encoding="utf-8")
    how = chance.choice(["columns", "a line without end", "a header without end"])
    if how == "columns":
        head, _, rest = text.partition("\n")
        text = f"{head},{','.join(f'c{k}' for k in range(100_000))}\n{rest}"
    elif how == "a line without end":
        text += "1," * 1_000_000
    else:
        text = '"' + text
    file.write_text(text, encoding="utf-8")
    return f"{file.name}: {how}"


# Evidence.


@kind("any")
def one_frame_or_few(folder: Path, chance: random.Random) -> str:
    count = chance.choice([0, 1, 2, 3, 5, 8])
    rows = read(folder / "frames.csv")
    kept = rows[: count + 1]
    write(folder / "frames.csv", kept)
    file = observed(folder)
    seen = read(file)
    frames = {row[0] for row in kept[1:]}
    write(file, [seen[0], *[row for row in seen[1:] if row[seen[0].index("frame")] in frames]])
    return str(count)


@kind("any")
def all_frames_the_same(folder: Path, chance: random.Random) -> str:
    how = chance.choice(["commands", "commands and what is seen"])
    rows = read(folder / "frames.csv")
    for row in rows[1:]:
        for c in joints_of(rows):
            row[c] = rows[1][c]
    write(folder / "frames.csv", rows)
    if how != "commands":
        file = observed(folder)
        seen = read(file)
        c = seen[0].index("frame")
        first = [row for row in seen[1:] if row[c] == rows[1][0]]
        write(file, [seen[0], *[[row[0], *one[1:]] for row in rows[1:] for one in first]])
    return how


@kind("any")
def no_mirror_no_marker_or_nothing(folder: Path, chance: random.Random) -> str:
    file = observed(folder)
    rows = read(file)
    c = next(i for i, name in enumerate(rows[0]) if name in ("target", "marker"))
    how = chance.choice(["no board", "board only", "nothing", "board in half of the frames", "one marker"])
    marker = next(row[c] for row in rows[1:] if row[c] != "board")

    def stays(row: list[str]) -> bool:
        if how == "no board":
            return row[c] != "board"
        if how == "board only":
            return row[c] == "board"
        if how == "one marker":
            return row[c] in ("board", marker)
        return how != "nothing" and (row[c] != "board" or int(row[0]) % 2 == 0)

    write(file, [rows[0], *filter(stays, rows[1:])])
    return how


@kind("any")
def pixels_that_cannot_be(folder: Path, chance: random.Random) -> str:
    rows = read(folder / "detections.csv")
    u, v = rows[0].index("u"), rows[0].index("v")
    how = chance.choice(
        [
            "flipped",
            "flipped up",
            "transposed",
            "all one place",
            "random",
            "half random",
            "behind",
            "doubled",
            "off by one",
            "rounded",
        ]
    )
    for row in rows[1:]:
        x, y = float(row[u]), float(row[v])
        if how == "half random" and chance.random() < 0.5:
            continue
        row[u], row[v] = (
            repr(a) for a in {
                "flipped": (799.0 - x, y), "flipped up": (x, 599.0 - y), "transposed": (y, x), "all one place": (400.0, 300.0),
                "random": (chance.uniform(0, 799), chance.uniform(0, 599)), "half random": (chance.uniform(0, 799), chance.uniform(0, 599)),
                "behind": (-x, -y), "doubled": (2 * x, 2 * y), "off by one": (x + 1.0, y + 1.0), "rounded": (round(x, -1), round(y, -1)),
            }[how]
        )  # fmt: skip
    write(folder / "detections.csv", rows)
    return how


@kind("any")
def boards_of_other_corners(folder: Path, chance: random.Random) -> str:
    rows = read(folder / "detections.csv")
    c = rows[0].index("index")
    how = chance.choice(["turned by 180°", "one off", "shuffled", "all zero", "beyond", "half of them"])
    order = list(range(30))
    chance.shuffle(order)
    for row in rows[1:]:
        i = int(row[c])
        if row[rows[0].index("target")] == "board":
            new = {
                "turned by 180°": 29 - i,
                "one off": (i + 1) % 30,
                "shuffled": order[i],
                "all zero": 0,
                "beyond": i + 5,
            }.get(how, i)
            row[c] = str(new)
    kept = [row for row in rows[1:] if how != "half of them" or row[1] != "board" or int(row[c]) % 2]
    write(folder / "detections.csv", [rows[0], *kept])
    return how


@kind("any")
def seen_directly_instead(folder: Path, chance: random.Random) -> str:
    rows = read(folder / "detections.csv")
    c = rows[0].index("via")
    how = chance.choice(["all", "markers", "board", "nonsense"])
    for row in rows[1:]:
        if how in ("all", "nonsense") or (row[1] == "board") == (how == "board"):
            row[c] = "window" if how == "nonsense" else "direct"
    write(folder / "detections.csv", rows)
    return how


@kind("any")
def points_that_cannot_be(folder: Path, chance: random.Random) -> str:
    rows = read(folder / "points.csv")
    k = [rows[0].index(axis) for axis in "xyz"]
    how = chance.choice(
        [
            "zeros",
            "one place",
            "noise",
            "mirrored",
            "axes exchanged",
            "half noise",
            "one axis zero",
            "another frame",
            "drifting",
        ]
    )
    for number, row in enumerate(rows[1:]):
        p = [float(row[c]) for c in k]
        if how == "half noise" and chance.random() < 0.5:
            continue
        q = {
            "zeros": [0.0, 0.0, 0.0], "one place": [0.1, 0.1, 0.1], "noise": [chance.gauss(0, 0.3) for _ in p], "mirrored": [p[0], -p[1], p[2]],
            "axes exchanged": [p[1], p[2], p[0]], "half noise": [chance.gauss(0, 0.3) for _ in p], "one axis zero": [0.0, p[1], p[2]],
            "another frame": [p[0] + 0.4, p[1] - 0.2, p[2]], "drifting": [p[0] + 1e-3 * number, p[1], p[2]],
        }[how]  # fmt: skip
        for c, value in zip(k, q, strict=True):
            row[c] = repr(value)
    write(folder / "points.csv", rows)
    return how


@kind("any")
def one_wild_value(folder: Path, chance: random.Random) -> str:
    file = observed(folder)
    rows = read(file)
    c = rows[0].index(chance.choice(["u", "v"] if file.stem == "detections" else ["x", "y", "z"]))
    value = chance.choice(["1e308", "1e12", "1e9", "1e6", "-1e4", "700", "1e-300", "0"])
    rows[chance.randrange(1, len(rows))][c] = value
    write(file, rows)
    return f"{rows[0][c]} = {value}"


@kind("any")
def time_that_cannot_be(folder: Path, chance: random.Random) -> str:
    rows = read(folder / "frames.csv")
    c = rows[0].index("time_s")
    how = chance.choice(["backwards", "constant", "huge", "jumps", "negative", "nan", "text"])
    for k, row in enumerate(rows[1:]):
        row[c] = {"backwards": repr(-2.0 * k), "constant": "5.0", "huge": repr(1e11 + k), "jumps": repr(chance.uniform(0, 1e6)),
                  "negative": repr(-1e6 + k), "nan": "nan", "text": "12:30:05"}[how]  # fmt: skip
    write(folder / "frames.csv", rows)
    return how


@kind("any")
def a_log_of_states_that_does_not_fit(folder: Path, chance: random.Random) -> str:
    rows = read(folder / "frames.csv")
    j = joints_of(rows)
    how = chance.choice(["too short", "falls", "other joint", "empty", "sound", "no time", "nan"])
    step = {"too short": 0.1, "falls": -1.0}.get(how, 2.0)
    names = ["nowhere" if how == "other joint" else rows[0][c] for c in j]
    log = [["time_s" if how != "no time" else "t", *names]]
    for k, row in enumerate(rows[1:]):
        log.append([repr(step * k), *("nan" if how == "nan" else row[c] for c in j)])
    write(folder / "states.csv", log[:1] if how == "empty" else log)
    return how


# What changes nothing.


@kind("same")
def other_order_same_content(folder: Path, chance: random.Random) -> str:
    how = chance.choice(["rows", "columns", "both"])
    for file in tables(folder):
        head, *body = read(file)
        if how != "columns" and file.stem != "frames":
            chance.shuffle(body)
        order = list(range(len(head)))
        if how != "rows" and file.stem != "frames":
            chance.shuffle(order)
        write(file, [[row[k] for k in order] for row in (head, *body)])
    return how


@kind("same")
def other_bytes_same_content(folder: Path, chance: random.Random) -> str:
    how = chance.choice(
        ["byte order mark", "CRLF", "no last end of line", "quotes", "blanks", "parquet", "link within"]
    )
    for file in tables(folder):
        text = file.read_text(encoding="utf-8")
        rows = read(file)
        if how == "byte order mark":
            file.write_bytes(b"\xef\xbb\xbf" + text.encode())
        elif how == "CRLF":
            file.write_bytes(text.replace("\n", "\r\n").encode())
        elif how == "no last end of line":
            file.write_text(text.rstrip("\n"), encoding="utf-8")
        elif how == "quotes":
            file.write_text(
                "".join(",".join(f'"{cell}"' for cell in row) + "\n" for row in rows), encoding="utf-8"
            )
        elif how == "blanks":
            file.write_text("".join(" , ".join(row) + " \n" for row in rows), encoding="utf-8")
        elif how == "parquet":
            pyarrow.parquet.write_table(pyarrow.csv.read_csv(file), file.with_suffix(".parquet"))
            file.unlink()
        else:
            file.rename(folder / f"real-{file.name}")
            file.symlink_to(f"real-{file.name}")
    return how


@kind("same")
def further_keys_columns_and_files(folder: Path, chance: random.Random) -> str:
    # A further column of the frames would be a joint.
    file = observed(folder)
    rows = read(file)
    write(
        file,
        [
            [*row, "" if chance.random() < 0.5 else "note"] if k else [*row, "operator"]
            for k, row in enumerate(rows)
        ],
    )
    (folder / "notes.txt").write_text("nothing", encoding="utf-8")
    text = (folder / "session.toml").read_text(encoding="utf-8")
    (folder / "session.toml").write_text('operator = "me"\n' + text, encoding="utf-8")
    return "operator"
