"""What changes nothing that counts."""

from __future__ import annotations

import random
from pathlib import Path

import pyarrow.csv
import pyarrow.parquet

from .kinds import kind, observed, read, tables, write


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
