"""Text packed with gzip: members, headers, checks, and streams that blow up."""

from __future__ import annotations

import gzip

from benchctl.recordings.text_file import read_bytes
from tests.fuzz.harness import Harness, refusals, workplace


def one_input(data: bytes) -> None:
    path = workplace() / "log.csv.gz"
    path.write_bytes(data)
    with refusals():
        assert read_bytes(path).endswith(b"\n")


def seeds() -> list[bytes]:
    text = b"".join(b"%d,%.3f\n" % (k, 0.1 * k) for k in range(50))
    return [
        gzip.compress(text, mtime=0),
        gzip.compress(text[:100], mtime=0) + gzip.compress(text[100:], mtime=0),
        gzip.compress(bytes(1 << 20), mtime=0),
        gzip.compress(b"0,0\n" * (1 << 19), mtime=0),
    ]


HARNESS = Harness(
    name="gzip_files", weight=40, one_input=one_input, seeds=seeds, tokens=(b"\x1f\x8b\x08",), longest=32768
)
