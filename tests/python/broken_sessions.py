"""Sessions broken by a script: each must end in a clear error or a right answer.

`python tests/python/broken_sessions.py SESSION... --count 1000` breaks sound sessions, whose diagnosis names a cause, in one of
many ways each, and diagnoses them, each in a process of its own. Wrong are: the verdict `none` or no gap (the cause is still
there), exit code 4, a traceback, an error of several lines, more than 5 s of computing or 1 GB of memory. A short run is a test.
"""

from __future__ import annotations

import argparse
import csv
import io
import json
import os
import random
import re
import resource
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

MOST_SECONDS, MOST_KB = 5.0, 1_000_000
ENDLESS_SECONDS = 120.0
"""Wall time: a machine may be busy with other work."""

Rows = list[list[str]]
Break = Callable[[Path, random.Random], str]


def read(file: Path) -> Rows:
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


def number_columns(rows: Rows) -> list[int]:
    return [i for i, name in enumerate(rows[0]) if name not in ("target", "marker", "via", "image")]


def cell(folder: Path, chance: random.Random) -> str:
    """One to three cells hold something else."""
    file = chance.choice(tables(folder))
    rows = read(file)
    odd = [
        "",
        "nan",
        "inf",
        "-inf",
        "1e308",
        "-1e308",
        "1e999",
        "x",
        "0x10",
        "1,5",
        "1_0",
        "9" * 40,
        "-1",
        "1e15",
        "é",
        "\t",
        '"',
    ]
    for _ in range(chance.choice([1, 1, 2, 3])):
        rows[chance.randrange(1, len(rows))][chance.randrange(len(rows[0]))] = chance.choice(odd)
    write(file, rows)
    return f"cells of {file.name}"


def column(folder: Path, chance: random.Random) -> str:
    """A whole column in another unit, shifted, emptied, doubled, renamed or gone."""
    file = chance.choice(tables(folder))
    rows = read(file)
    c = chance.choice(number_columns(rows))
    name = rows[0][c]
    how = chance.choice(["scaled", "shifted", "gone", "doubled", "renamed", "emptied", "constant", "rolled"])
    if how == "scaled":
        factor = chance.choice([1000.0, 57.29577951, 1e-3, -1000.0, 1e6, 1e200])
        for row in rows[1:]:
            row[c] = repr(float(row[c]) * factor)
        how += f" by {factor:g}"
    elif how == "shifted":
        for row in rows[1:]:
            row[c] = repr(float(row[c]) + 1e7)
    elif how == "gone":
        rows = [row[:c] + row[c + 1 :] for row in rows]
    elif how == "doubled":
        rows = [[*row, row[c]] for row in rows]
        rows[0][-1] = name + chance.choice(["", " ", "\t"])
    elif how == "renamed":
        rows[0][c] = chance.choice(
            [name.upper(), " ", "no_such_joint", "measured:" + name, "accelerometer:base_link:x", "é"]
        )
    elif how == "emptied":
        for row in rows[1:]:
            row[c] = ""
    elif how == "constant":
        for row in rows[1:]:
            row[c] = rows[1][c]
    else:
        values = [row[c] for row in rows[1:]]
        by = chance.choice([1, 2, 7])
        for row, value in zip(rows[1:], values[by:] + values[:by], strict=True):
            row[c] = value
    write(file, rows)
    return f"{file.name}: {name} {how}"


def rows_changed(folder: Path, chance: random.Random) -> str:
    """Rows gone, doubled, cut off or in another order."""
    file = chance.choice(tables(folder))
    rows = read(file)
    head, body = rows[0], rows[1:]
    how = chance.choice(
        ["all gone", "most gone", "doubled", "cut", "shuffled", "reversed", "longer", "one left"]
    )
    if how == "all gone":
        body = []
    elif how == "most gone":
        body = body[: max(1, len(body) // 30)]
    elif how == "doubled":
        body += [list(body[chance.randrange(len(body))])]
    elif how == "cut":
        k = chance.randrange(len(body))
        body[k] = body[k][: chance.randrange(len(head))]
    elif how == "shuffled":
        chance.shuffle(body)
    elif how == "reversed":
        body.reverse()
    elif how == "longer":
        body[chance.randrange(len(body))].append("1")
    else:
        body = body[:1]
    write(file, [head, *body])
    return f"{file.name}: rows {how}"


def target_gone(folder: Path, chance: random.Random) -> str:
    """Every row of one target or marker gone, or called by another's name."""
    file = folder / ("detections.csv" if (folder / "detections.csv").exists() else "points.csv")
    rows = read(file)
    c = next(i for i, name in enumerate(rows[0]) if name in ("target", "marker"))
    names = sorted({row[c] for row in rows[1:]})
    one = chance.choice([*names, *[name for name in names if name == "board"] * 3])
    if chance.random() < 0.6:
        write(file, [rows[0], *[row for row in rows[1:] if row[c] != one]])
        return f"{file.name}: no row of {one}"
    other = chance.choice([name for name in names if name != one] or ["x"])
    for row in rows[1:]:
        row[c] = {one: other, other: one}.get(row[c], row[c])
    write(file, rows)
    return f"{file.name}: {one} and {other} exchanged"


def metadata(folder: Path, chance: random.Random) -> str:
    """A number, a name or a line of session.toml is another."""
    file = folder / "session.toml"
    lines = file.read_text(encoding="utf-8").splitlines()
    keys = [i for i, line in enumerate(lines) if "=" in line]
    k = chance.choice(keys)
    key, _, value = lines[k].partition("=")
    odd = ["1e308", "-1", "0", "nan", "inf", '""', '"x"', "[]", "{}", "true", "1000.0", "[0.0, 0.0, -1.0]", "[0, 0, -9810]",
           "[1, 1]", "[100, 100]", '"../../etc/passwd"', '"/etc/passwd"', "[0.0, 0.0, 9.81]", "2026-01-01", "'''"]  # fmt: skip
    how = chance.randrange(4)
    if how == 0:
        del lines[k]
    elif how == 1 and re.search(r"\d", value):
        lines[k] = key + "=" + re.sub(r"[-+.\de]+", lambda m: repr(_float(m[0]) * 1000.0), value)
    else:
        lines[k] = f"{key}= {chance.choice(odd)}"
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return f"session.toml: {lines[k] if k < len(lines) else key}"


def _float(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return 1.0


def robot(folder: Path, chance: random.Random) -> str:
    """The URDF in another unit, or with names, types and numbers that cannot be."""
    file = folder / "robot.urdf"
    text = file.read_text(encoding="utf-8")
    how = chance.choice(
        ["mm", "degrees", "one origin", "type", "axis", "cut", "mass", "link", "limit", "entity"]
    )
    if how == "mm":
        text = re.sub(r'xyz="([^"]+)"', lambda m: f'xyz="{_times(m[1], 1000.0)}"', text)
    elif how == "degrees":
        text = re.sub(r'rpy="([^"]+)"', lambda m: f'rpy="{_times(m[1], 57.29577951)}"', text)
    elif how == "one origin":
        text = _one(text, r'xyz="([^"]+)"', lambda m: f'xyz="{_times(m[1], 1e6)} "', chance)
    elif how == "type":
        text = _one(text, r'type="(\w+)"', lambda m: 'type="floating"', chance)
    elif how == "axis":
        text = re.sub(r'<axis xyz="[^"]+"', '<axis xyz="0 0 0"', text)
    elif how == "cut":
        text = text[: chance.randrange(len(text))]
    elif how == "mass":
        text = _one(
            text,
            r'<mass value="[^"]+"',
            lambda m: f'<mass value="{chance.choice(["-1", "1e300", "nan", "x"])}"',
            chance,
        )
    elif how == "link":
        text = _one(text, r'link="(\w+)"', lambda m: 'link="nowhere"', chance)
    elif how == "limit":
        text = _one(text, r'upper="[^"]+"', lambda m: 'upper="nan"', chance)
    else:
        text = '<!DOCTYPE r [<!ENTITY a "b"><!ENTITY c "&a;&a;&a;&a;">]>' + text.replace(
            "<link", "&c;<link", 1
        )
    file.write_text(text, encoding="utf-8")
    return f"robot.urdf: {how}"


def _times(numbers: str, factor: float) -> str:
    return " ".join(repr(float(x) * factor) for x in numbers.split())


def _one(text: str, pattern: str, by: Callable[[re.Match[str]], str], chance: random.Random) -> str:
    found = list(re.finditer(pattern, text))
    if not found:
        return text[:-1]
    match = chance.choice(found)
    return text[: match.start()] + by(match) + text[match.end() :]


def camera(folder: Path, chance: random.Random) -> str:
    """The camera's file with another number, cut, or as a bomb."""
    file = folder / "camera.yaml"
    if not file.exists():
        return robot(folder, chance)
    text = file.read_text(encoding="utf-8")
    how = chance.choice(["number", "number", "number", "cut", "aliases", "deep", "binary", "size"])
    if how == "number":
        new = chance.choice(["0", "-1", "3.5", ".nan", ".inf", "1e308", "x", "[]"])
        text = _one(text, r"(?<=[\[, ])-?\d+\.?\d*(?:e-?\d+)?(?=[,\]\n])", lambda m: new, chance)
        how = f"a number is {new}"
    elif how == "cut":
        text = text[: chance.randrange(len(text))]
    elif how == "aliases":
        text = (
            "a: &a [x]\n"
            + "".join(
                f"{chr(98 + i)}: &{chr(98 + i)} [{', '.join(['*' + chr(97 + i)] * 9)}]\n" for i in range(9)
            )
            + text
        )
    elif how == "deep":
        text = "a: " + "[" * 5000 + "]" * 5000 + "\n" + text
    elif how == "binary":
        text = "\0\1\2" + text
    else:
        text = re.sub(
            r"image_(width|height): *\d+",
            lambda m: f"image_{m[1]}: {chance.choice([1, 10, 99, 10**9])}",
            text,
        )
    file.write_text(text, encoding="utf-8")
    return f"camera.yaml: {how}"


def file_broken(folder: Path, chance: random.Random) -> str:
    """A file is missing, empty, a pipe, a folder, a link that leaves, or noise."""
    file = chance.choice([path for path in folder.iterdir() if path.is_file() and path.name != "answer.json"])
    how = chance.choice(
        ["missing", "empty", "pipe", "folder", "link", "noise", "cut", "utf-16", "bom", "parquet too"]
    )
    data = file.read_bytes()
    if how in ("missing", "pipe", "folder", "link"):
        file.unlink()
    if how == "pipe":
        os.mkfifo(file)
    elif how == "folder":
        file.mkdir()
    elif how == "link":
        outside = folder.parent / f"outside-{file.name}"
        outside.write_bytes(data)
        file.symlink_to(outside)
    elif how == "empty":
        file.write_bytes(b"")
    elif how == "noise":
        start = chance.randrange(len(data))
        file.write_bytes(data[:start] + chance.randbytes(20) + data[start + 20 :])
    elif how == "cut":
        file.write_bytes(data[: chance.randrange(len(data))])
    elif how == "utf-16":
        file.write_bytes(data.decode("utf-8").encode("utf-16"))
    elif how == "bom":
        file.write_bytes(b"\xef\xbb\xbf" + data)
    elif how == "parquet too":
        (folder / "frames.parquet").write_bytes(chance.randbytes(1000))
    return f"{file.name}: {how}"


BREAKS: tuple[Break, ...] = (
    cell, column, column, rows_changed, target_gone, metadata, metadata, robot, camera, file_broken,
)  # fmt: skip


@dataclass
class End:
    """How a broken session ended."""

    what: str
    code: int
    verdict: str | None
    text: str
    cpu_s: float
    memory_kb: int
    faults: list[str]


def diagnose(folder: Path, what: str) -> End:
    """Diagnoses in a forked process, whose time and memory are its own."""
    out, err = folder.parent / "stdout", folder.parent / "stderr"
    begun, child = time.monotonic(), os.fork()
    if child == 0:
        try:
            for number, file in ((1, out), (2, err)):
                handle = os.open(file, os.O_CREAT | os.O_WRONLY | os.O_TRUNC)
                os.dup2(handle, number)
            # Whatever stands in their place: a test runner catches what is written to them.
            sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
            resource.setrlimit(resource.RLIMIT_CPU, (60, 60))
            sys.argv = ["mirror-posture", "diagnose", str(folder), "--json"]
            from mirror_posture.cli.app import main

            main()
        except SystemExit as end:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(int(end.code or 0))
        except BaseException:
            import traceback

            traceback.print_exc()
            sys.stderr.flush()
        os._exit(99)
    while True:
        done, status, usage = os.wait4(child, os.WNOHANG)
        if done:
            break
        if time.monotonic() - begun > ENDLESS_SECONDS:
            os.kill(child, 9)
        time.sleep(0.005)
    code = os.waitstatus_to_exitcode(status)
    said, text = out.read_text(errors="replace"), err.read_text(errors="replace")
    tree = json.loads(said) if said.strip() and code != 99 else {}
    verdict = tree.get("verdict")
    seconds, memory = usage.ru_utime + usage.ru_stime, usage.ru_maxrss
    errors = [line for line in text.splitlines() if line.startswith("error:")]
    faults = []
    if code not in (0, 1, 3):
        faults.append(f"exit code {code}")
    if "Traceback" in text or "fault of this program" in text or "panicked" in text:
        faults.append("a traceback or a panic")
    if code == 1 and (len(errors) != 1 or len(errors[0]) < 25):
        faults.append("no single clear error")
    gap = tree.get("gap", {})
    if code == 0 and verdict == "none":
        faults.append("nothing is wrong, it says")
    if (
        code == 0
        and verdict not in (None, "insufficient")
        and not (gap.get("before_m") or gap.get("before_px"))
    ):
        faults.append("a verdict without a gap")
    if seconds > MOST_SECONDS or memory > MOST_KB:
        faults.append(f"{seconds:.1f} s, {memory / 1000:.0f} MB")
    return End(what, code, verdict, text, seconds, memory, faults)


def run(
    sessions: Sequence[Path], count: int, seed: int, below: Path, told: bool = False, seconds: float = 1e9
) -> list[End]:
    """Breaks the sessions in turn, each in a copy below a folder; `told`: wrong ends are printed at once."""
    until = time.monotonic() + seconds
    # Imported once: a child's time is that of its own work.
    import matplotlib.figure  # noqa: F401

    import mirror_posture.cli.app
    import mirror_posture.detect
    import mirror_posture.diagnosis  # noqa: F401

    ends = []
    for number in range(count):
        if time.monotonic() > until:
            break
        chance = random.Random(f"{seed}-{number}")
        place = below / "broken"
        shutil.rmtree(place, ignore_errors=True)
        folder = place / "session"
        shutil.copytree(sessions[number % len(sessions)], folder)
        what = chance.choice(BREAKS)(folder, chance)
        end = diagnose(folder, f"{seed}-{number} {sessions[number % len(sessions)].name}, {what}")
        ends.append(end)
        if told and end.faults:
            print(f"{end.what}: {'; '.join(end.faults)}\n    {end.text.strip()[:300]}", flush=True)
    return ends


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sessions", type=Path, nargs="+")
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=1e9, help="No longer than this.")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        ends = run(options.sessions, options.count, options.seed, Path(name), True, options.seconds)
    print(dict(Counter(f"exit {end.code} {end.verdict or ''}".strip() for end in ends)))
    print(f"{sum(bool(end.faults) for end in ends)} of {len(ends)} ended wrongly; at most "
          f"{max(end.cpu_s for end in ends):.1f} s, {max(end.memory_kb for end in ends) / 1000:.0f} MB")  # fmt: skip
