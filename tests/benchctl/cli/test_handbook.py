"""`benchctl help`, and that the handbook and the README name files and commands that exist."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest

from benchctl.cli.app import run_verb
from benchctl.cli.help import topics
from benchctl.cli.verbs import VERBS
from tests.benchctl.cli.processes import benchctl

ROOT = Path(__file__).parents[3]
PAGES = [ROOT / "README.md", ROOT / "benchctl" / "README.md", *sorted((ROOT / "benchctl" / "handbook").glob("*.md"))]
RESULTS = sorted((ROOT / "results").glob("*.md"))


def named(page: Path) -> str:
    return str(page.relative_to(ROOT))


def commands(page: Path) -> list[tuple[str, str]]:
    """The verb and the rest of each benchctl command in the fenced blocks of a page."""
    found: list[tuple[str, str]] = []
    for block in re.findall(r"^```\w*\n(.*?)^```", page.read_text(encoding="utf-8"), re.M | re.S):
        found += re.findall(r"(?:^|&& |/)benchctl ([a-z]+)\b(.*)$", block, re.M)
    return found


def test_without_a_topic_all_pages_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_verb(["help"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == len(topics()) >= 9
    assert "first_campaign  A first campaign" in lines


@pytest.mark.parametrize("words", [["first_campaign"], ["first", "campaign"], ["First-Campaign"]])
def test_a_page_is_shown_however_its_topic_is_written(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run_verb(["help", *words]) == 0
    assert capsys.readouterr().out.rstrip("\n") == topics()["first_campaign"].rstrip("\n")


def test_an_unknown_topic_is_one_line_and_exit_2() -> None:
    ran = benchctl("help", "calibratoin")
    assert (ran.returncode, ran.stdout) == (2, "")
    assert ran.stderr == "benchctl: help calibratoin: there is no such topic: did you mean calibration?\n"


def test_the_json_has_the_page(tmp_path: Path) -> None:
    assert run_verb(["help", "ci", "--json", str(tmp_path / "h.json"), "--quiet"]) == 0
    told = json.loads((tmp_path / "h.json").read_text())
    assert (told["ok"], told["topic"], told["page"]) == (True, "ci", topics()["ci"])


@pytest.mark.parametrize("page", [*PAGES, *RESULTS], ids=named)
def test_links_lead_to_files_and_headings_that_exist(page: Path) -> None:
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
        if "://" in target:
            continue
        path, _, anchor = target.partition("#")
        there = (page.parent / path).resolve() if path else page
        assert there.exists(), f"{page.name}: {target}"
        headings = re.findall(r"^#+ (.*)$", there.read_text(encoding="utf-8"), re.M) if anchor else []
        anchors = {re.sub(r"[^\w\- ]", "", one.lower()).replace(" ", "-") for one in headings}
        assert not anchor or anchor in anchors, f"{page.name}: {target}"


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_commands_name_verbs_and_options_that_exist(page: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for verb, rest in commands(page):
        assert verb in VERBS, f"{page.name}: benchctl {verb}"
        run_verb([verb, "--help"])
        known = capsys.readouterr().out
        for word in shlex.split(rest, comments=True):
            if word.startswith("--"):
                assert word.partition("=")[0] in known, f"{page.name}: benchctl {verb} {word}"
