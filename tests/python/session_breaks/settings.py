"""The settings in session.toml."""

from __future__ import annotations

import random
import re
from pathlib import Path

from .kinds import edit, kind


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
