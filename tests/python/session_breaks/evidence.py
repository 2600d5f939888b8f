"""What was seen, and when."""

from __future__ import annotations

import random
from pathlib import Path

from .kinds import joints_of, kind, observed, read, write


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
