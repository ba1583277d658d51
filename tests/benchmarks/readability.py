"""How easily README and handbook are read, beside the documentation of PyMeasure and lmfit: Flesch and Kincaid.

    python -m tests.benchmarks.readability

The peers' pages come from their source distributions, which pip downloads. Only sentences count: no code, no tables, no
headings, no words in code type, no change logs. Source: Kincaid et al., Naval Technical Training Command report 8-75
(1975), as computed by textstat.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterator
from pathlib import Path

import textstat

ROOT = Path(__file__).parents[2]
PEERS = {"PyMeasure": ("pymeasure", r"/docs/(?!api/|about/).*\.rst$"), "lmfit": ("lmfit", r"/doc/(?!whatsnew).*\.rst$")}
_NOT_PROSE = re.compile(r"^(\s|\.\. |[|+=#:>!`~^\"-]{2}|[|:>#!]|\d+ )")
_MARKUP = (
    (re.compile(r"!\[[^]]*\]\([^)]*\)|<!--.*?-->", re.DOTALL), ""),
    (re.compile(r"\[([^]]+)\]\([^)]*\)"), r"\1"),  # links of Markdown
    (re.compile(r":(?:ref|doc):`([^`<]+?)(\s*<[^>]*>)?`"), r"\1"),  # links of reStructuredText
    (re.compile(r":[\w:]+:`[^`]+`"), "this"),  # its names of classes and functions
    (re.compile(r"`([^`<]+?)\s*<[^>]*>`_+"), r"\1"),  # its other links
    (re.compile(r"``[^`]+``|`[^`]+`_?"), "this"),
    (re.compile(r"[*_]{1,2}(\S[^*_]*)[*_]{1,2}"), r"\1"),
)


def sentences(page: str) -> Iterator[str]:
    """The paragraphs and list items of a Markdown or reStructuredText page, without markup."""
    page = re.sub(r"^```.*?^```", "", page, flags=re.DOTALL | re.MULTILINE)
    for block in re.split(r"\n\s*\n", page):
        for item in re.split(r"^\s*(?:[-*]|\d+\.)\s+", block.strip("\n"), flags=re.MULTILINE):
            lines = item.splitlines()
            if (
                not lines
                or _NOT_PROSE.match(lines[0])
                or (len(lines) > 1 and re.match(r"^([=~^\"*#-])\1{2,}", lines[1]))
            ):
                continue
            text = " ".join(line.strip() for line in lines)
            for pattern, instead in _MARKUP:
                text = pattern.sub(instead, text)
            if len(text.split()) > 3:
                yield text if text.endswith((".", "?", "!")) else f"{text}."


def peer(package: str, pages: str) -> list[str]:
    """The pages of a package's documentation, from its source distribution."""
    with tempfile.TemporaryDirectory() as folder:
        fetch = ["download", "--quiet", "--no-deps", "--no-binary", ":all:", "--dest", folder, package]
        subprocess.run([sys.executable, "-m", "pip", *fetch], check=True, stderr=subprocess.DEVNULL)
        (archive,) = Path(folder).iterdir()
        with tarfile.open(archive) as files:
            chosen = [one for one in files.getmembers() if re.search(pages, one.name)]
            return [files.extractfile(one).read().decode() for one in chosen]  # type: ignore[union-attr] # all are files


def main() -> None:
    """Print the table."""
    handbook = [file.read_text(encoding="utf-8") for file in sorted((ROOT / "benchctl/handbook").glob("*.md"))]
    texts = {
        "README": [(ROOT / "README.md").read_text(encoding="utf-8")],
        "handbook": handbook,
        **{f"{name}, documentation": peer(*where) for name, where in PEERS.items()},
    }
    print("| text | words | words a sentence | reading ease (Flesch) | school grade (Kincaid) |\n|---|---|---|---|---|")  # noqa: T201
    for name, pages in texts.items():
        text = "\n".join(one for page in pages for one in sentences(page))
        figures = (
            f"{textstat.lexicon_count(text):,}",
            f"{textstat.words_per_sentence(text):.1f}",
            f"{textstat.flesch_reading_ease(text):.0f}",
            f"{textstat.flesch_kincaid_grade(text):.1f}",
        )
        print(f"| {name} | {' | '.join(figures)} |")  # noqa: T201


if __name__ == "__main__":
    main()
