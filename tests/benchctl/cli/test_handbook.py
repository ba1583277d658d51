"""`benchctl help`, and that the handbook and the README name files and commands that exist."""

from __future__ import annotations

import json
import re
import shlex
import shutil
import subprocess
import tomllib
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
import yaml

from benchctl.app.handbook import anchor_of, topics
from benchctl.bench import Bench, load_bench, template
from benchctl.cli.app import run_verb
from benchctl.cli.command import named_command
from benchctl.cli.verbs import VERBS
from benchctl_instruments.errors import UsageError
from tests.benchctl.cli.processes import benchctl
from tests.documented import blocks

ROOT = Path(__file__).parents[3]
PAGES = [ROOT / "README.md", ROOT / "benchctl" / "README.md", *sorted((ROOT / "benchctl" / "handbook").glob("*.md"))]
RESULTS = sorted((ROOT / "results").glob("*.md"))


def load_bench_text(part: str) -> Bench:
    """The bench that `init` writes, with a part's tables added or in the place of its own; refused if not by schema."""
    own = re.split(r"^(?=\[)", template(), flags=re.MULTILINE)
    stated = {*re.findall(r"^\[.*?\]", part, re.MULTILINE)}
    kept = "".join(table for table in own if table.partition("\n")[0] not in stated)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "bench.toml"
        path.write_text(f"{kept}\n{part}", encoding="utf-8")
        path.with_name("logo.png").write_bytes(b"\x89PNG\r\n\x1a\n")
        return load_bench(str(path))


def named(page: Path) -> str:
    return str(page.relative_to(ROOT))


def commands(page: Path) -> list[tuple[str, list[str]]]:
    """The verb and the arguments of each benchctl command: in the blocks of a page, and with arguments in its text."""
    text = page.read_text(encoding="utf-8")
    found = [rest for block in blocks(page) for rest in re.findall(r"(?:^|&& |/|\$ )benchctl (.*)$", block.text, re.M)]
    found += re.findall(r"`benchctl ([a-z]+ [^`…]*)`", text)
    words = [shlex.split(rest.partition("| ")[0], comments=True) for rest in found]
    return [(one[0], one[1:]) for one in words]


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
        anchors = set(map(anchor_of, headings))
        assert not anchor or anchor in anchors, f"{page.name}: {target}"


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_commands_have_verbs_options_and_values_that_the_command_line_takes(page: Path) -> None:
    for verb, arguments in commands(page):
        assert verb in VERBS, f"{page.name}: benchctl {verb}"
        if arguments[0:1] == ["--help"]:
            continue
        command, rest = named_command(verb, arguments)
        try:
            command.make_context(verb, rest)
        except UsageError as err:
            pytest.fail(f"{page.name}: benchctl {verb} {shlex.join(arguments)}: {err}")


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_what_pip_is_asked_for_is_an_extra_of_the_package(page: Path) -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    named = re.findall(r"pip install [^`\n]*?(?:\.|benchctl)\[(\w+)\]", page.read_text(encoding="utf-8"))
    assert set(named) <= set(extras)


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_every_block_says_in_what_language_it_is_and_is_in_it(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert len(blocks(page)) == text.count("```") / 2  # no fence is overlooked
    for block in blocks(page):
        match block.language:
            case "python":
                compile(block.text, str(block), "exec")
            case "toml":
                load_bench_text(block.text)
            case "yaml":
                assert yaml.safe_load(block.text), block
            case "sh" if shutil.which("bash"):
                assert subprocess.run(["bash", "-n", "-c", block.text], check=False).returncode == 0, block
            case other:
                assert other in ("console", "sh", "text") or block.mark in ("main job", "tests"), block
