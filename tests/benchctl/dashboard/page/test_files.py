"""The files of the page, looked at without a browser."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

import pytest

import benchctl.dashboard

PAGE = Path(benchctl.dashboard.__file__).parent / "page"
OURS = sorted(path for path in PAGE.iterdir() if path.suffix in (".js", ".css", ".html"))
MARKUP = re.compile(r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\(|new Function|DOMParser|srcdoc")
INLINE = re.compile(r"<script(?![^>]*\bsrc=)|<style|\bstyle=|\son[a-z]+=", re.IGNORECASE)
ELSEWHERE = re.compile(r"""(?:src|href)="(?!/page/)|url\(|@import|https?://(?!www\.w3\.org/2000/svg)""")


@pytest.mark.parametrize("path", OURS, ids=lambda path: path.name)
def test_no_file_makes_markup_of_data_nor_names_another_server(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert MARKUP.findall(text) == []
    assert ELSEWHERE.findall(text) == []
    assert len(text.splitlines()) <= 400


def test_the_document_has_no_script_and_no_style_of_its_own() -> None:
    assert INLINE.findall((PAGE / "index.html").read_text(encoding="utf-8")) == []


def test_every_file_that_is_named_is_there_and_every_module_is_used() -> None:
    texts = {path.name: path.read_text(encoding="utf-8") for path in OURS}
    named = set(re.findall(r'(?:src|href)="/page/([^"]+)"', texts["index.html"]))
    named |= {name for text in texts.values() for name in re.findall(r'from "\./([^"]+)"', text)}
    assert [name for name in named if not (PAGE / name).is_file()] == []
    assert {path.name for path in OURS} - named == {"index.html"}


def test_what_comes_from_others_is_as_they_made_it() -> None:
    stated = re.findall(r"SHA-256 of (\S+) +([0-9a-f]{64})", (PAGE / "vendor" / "README.txt").read_text())
    assert len(stated) == 2
    for name, digest in stated:
        assert hashlib.sha256((PAGE / "vendor" / name).read_bytes()).hexdigest() == digest
    assert "MIT" in (PAGE / "vendor" / "LICENSE").read_text()
