"""Files: what they are, their bytes, encodings and sizes."""

from __future__ import annotations

import io
import os
import random
from pathlib import Path

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from .kinds import kind, tables


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
