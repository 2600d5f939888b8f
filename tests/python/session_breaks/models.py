"""The robot's and the camera's files."""

from __future__ import annotations

import random
import re
from pathlib import Path

from .kinds import NotHere, edit, kind


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


@kind("same")
def a_robot_of_entities(folder: Path, chance: random.Random) -> str:
    """Two to the thirtieth laughs, in a place where text has no meaning: nobody has to laugh."""
    file = folder / "robot.urdf"
    text = file.read_text(encoding="utf-8")
    laughs = "".join(f"<!ENTITY l{k} '" + f"&l{k - 1};" * 10 + "'>" for k in range(1, 10))
    before = chance.choice(["</robot>", "</link>"])
    text = f'<!DOCTYPE r [<!ENTITY l0 "ha">{laughs}]>' + text.replace(before, "&l9;" + before, 1)
    file.write_text(text, encoding="utf-8")
    return f"before {before}"


@kind("refused")
def a_number_of_the_robot_is_an_entity(folder: Path, chance: random.Random) -> str:
    """What is not unfolded is no number either."""
    file = folder / "robot.urdf"
    edit(file, r'<origin xyz="[^"]+"', '<origin xyz="&far; 0 0"', count=1)
    kind = chance.choice(['"9"', 'SYSTEM "/etc/hostname"'])
    file.write_text(
        f"<!DOCTYPE r [<!ENTITY far {kind}>]>" + file.read_text(encoding="utf-8"), encoding="utf-8"
    )
    return kind


@kind("refused")
def a_robot_that_unfolds(folder: Path, chance: random.Random) -> str:
    file = folder / "robot.urdf"
    text = file.read_text(encoding="utf-8")
    how = chance.choice(["deep", "attributes", "chain of mimics", "links", "cut"])
    if how == "deep":
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
