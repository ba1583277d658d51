"""JSON and TOML texts as such: nesting, numbers, keys, whatever they mean."""

from __future__ import annotations

import json

from benchctl.documents import json_document, toml_document
from benchctl.toml_file import line_of
from tests.fuzz.harness import Harness, refusals


def one_input(data: bytes) -> None:
    with refusals():
        json.dumps(json_document(data, "text"))
    text = data.decode("utf-8", "replace")
    line_of(text, ("a", "b"))
    with refusals():
        json.dumps(toml_document(text, "text"), default=str)


def seeds() -> list[bytes]:
    return [
        b'{"a": [1, 2.5e3, null, true, "x\\u00e9"], "b": {"c": {}}}',
        b'[a]\nb = 1\nc = "x"\n[[d]]\ne = 2026-11-21\nf.g.h = [1, 0x10, inf]\n"i j" = """\nk"""\n',
    ]


HARNESS = Harness(
    name="documents",
    weight=300,
    one_input=one_input,
    seeds=seeds,
    tokens=(b"[[", b"{" * 50, b"[" * 50, b'"""', b"'''", b"9" * 60, b"1e999", b"\\ud800", b".a" * 30, b"= {"),
    longest=16384,
)
