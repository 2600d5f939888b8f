"""The sizes in a Parquet file's footer: the same as pyarrow tells, damaged footers refused."""

from __future__ import annotations

import io
import random

import pyarrow as pa
import pyarrow.parquet
import pytest

from mirror_posture.session.parquet_sizes import LARGEST_FOOTER, chunk_sizes


def written(**how: object) -> bytes:
    table = pa.table(
        {
            "whole": list(range(1000)),
            "real": [0.1 * k for k in range(1000)],
            "text": [f"name {k % 7}" for k in range(1000)],
            "list": [[1.0, 2.0]] * 1000,
            "truth": [None, True] * 500,
        }
    )
    stream = io.BytesIO()
    pyarrow.parquet.write_table(table, stream, **how)
    return stream.getvalue()


@pytest.mark.parametrize("version", ["1.0", "2.6"])
@pytest.mark.parametrize("compression", ["snappy", "zstd", "none"])
def test_they_are_those_of_pyarrow(version: str, compression: str) -> None:
    data = written(
        row_group_size=300, version=version, compression=compression, write_page_index=True, store_schema=True
    )
    told = pyarrow.parquet.read_metadata(io.BytesIO(data))
    assert told.num_row_groups == 4
    groups = [told.row_group(k) for k in range(4)]
    chunks = [[group.column(k) for k in range(told.num_columns)] for group in groups]
    sizes = chunk_sizes(data, told.num_columns)
    assert sizes == [[(c.num_values, c.total_uncompressed_size) for c in group] for group in chunks]
    assert sizes[0][3][0] == 600


def test_damaged_footers_are_refused() -> None:
    data = written(row_group_size=300)
    for columns in (4, 6):
        with pytest.raises(ValueError, match="footer is damaged"):
            chunk_sizes(data, columns)
    length = int.from_bytes(data[-8:-4], "little")
    random_ = random.Random(5)
    refused = 0
    for _ in range(3000):
        spoilt = bytearray(data)
        for _ in range(random_.randint(1, 3)):
            spoilt[-8 - random_.randint(1, length)] = random_.randint(0, 255)
        try:
            chunk_sizes(bytes(spoilt), 5)
        except ValueError:
            refused += 1
    assert refused > 300
    for beginning in (b"", b"PAR1", data[:-8] + (LARGEST_FOOTER + 1).to_bytes(4, "little") + b"PAR1"):
        with pytest.raises(ValueError, match="footer"):
            chunk_sizes(beginning, 5)
