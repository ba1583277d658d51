"""The runner of the benchmarks, on small ones that are made here."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image

from tests.benchmarks.__main__ import NAMES, main
from tests.benchmarks.comparison import Comparison
from tests.benchmarks.machine import Conditions
from tests.benchmarks.picture import drawn, times_better
from tests.benchmarks.table import table

KEYS = ["name", "value", "unit", "against", "against_value", "ratio", "goal", "reached"]
QUICK = """
from tests.benchmarks.comparison import Comparison
def measured():
    return [
        Comparison("quick thing", 0.02, "s", "a peer", 1.0, "<=", 0.05),
        Comparison("slow thing", 30.0, "MB/s", "another | peer", 60.0, ">=", 0.8),
    ]
"""
LATE = """
from tests.benchmarks.comparison import Comparison
def measured():
    return [Comparison("late thing", 4.0, "µs", "5 µs", 5.0, "<=", 1.0)]
"""
ABSENT = """
from benchctl_instruments.errors import UsageError
def measured():
    raise UsageError("peer is not installed:\\n pip install 'benchctl[benchmarks]'")
"""
BROKEN = "def measured():\n    return {}['figure']\n"
SOURCES = {"quick": QUICK, "absent": ABSENT, "broken": BROKEN, "late": LATE}
CONDITIONS = Conditions(
    processor="a CPU", cores=2, load=(0.5, 1.25), date="2026-11-22 07:00", versions="Python 3.11.7, numpy 2.4.6"
)
FOUND = [
    Comparison("quick thing", 0.02, "s", "a peer", 1.0, "<=", 0.05),
    Comparison("slow thing", 30.0, "MB/s", "another | peer", 60.0, ">=", 0.8),
]

Run = Callable[..., int]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """The command, with a package of made benchmarks in place of the real ones."""
    package = tmp_path / "made_benchmarks"
    package.mkdir()
    (package / "__init__.py").touch()
    for name, source in SOURCES.items():
        (package / f"{name}.py").write_text(source, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    for name in ["made_benchmarks", *(f"made_benchmarks.{each}" for each in SOURCES)]:
        monkeypatch.delitem(sys.modules, name, raising=False)
    return lambda *arguments: main(arguments, names=tuple(SOURCES), package="made_benchmarks")


def test_the_table_says_figures_goals_and_what_they_were_measured_on(
    run: Run, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("--only", "quick") == 0
    said = capsys.readouterr()
    lines = said.out.splitlines()
    assert lines[0] == "| what | ours | theirs | ratio | goal | reached |"
    assert lines[2] == "| quick thing | 0.0200 s | 1.00 s (a peer) | 0.0200 | ≤ 0.05 | yes |"
    assert lines[3] == r"| slow thing | 30.0 MB/s | 60.0 MB/s (another \| peer) | 0.500 | ≥ 0.8 | no |"
    assert "core" in lines[-1]
    assert "Python 3." in lines[-1]
    assert "numpy" in lines[-1]
    assert "allantools" in lines[-1]
    assert said.err.startswith("quick: measuring\nquick: 2 figures after ")


def test_the_json_is_a_list_of_figures_with_the_stated_keys(run: Run, tmp_path: Path) -> None:
    file = tmp_path / "figures.json"
    assert run("--only", "quick", "--only", "late", "--json", str(file)) == 0
    figures = json.loads(file.read_text(encoding="utf-8"))
    assert [list(each) for each in figures] == [KEYS] * 3
    assert figures[0] == {
        "name": "quick thing",
        "value": 0.02,
        "unit": "s",
        "against": "a peer",
        "against_value": 1.0,
        "ratio": 0.02,
        "goal": "<= 0.05",
        "reached": True,
    }
    assert figures[1]["reached"] is False


def test_json_on_stdout_stands_there_alone(run: Run, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--only", "late", "--json", "-") == 0
    said = capsys.readouterr()
    assert [each["name"] for each in json.loads(said.out)] == ["late thing"]
    assert "| late thing |" in said.err


def test_what_fails_is_a_line_and_the_rest_is_measured_and_written(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    file = tmp_path / "figures.json"
    assert run("--json", str(file)) == 1
    said = capsys.readouterr()
    assert "absent: failed: peer is not installed: pip install 'benchctl[benchmarks]'\n" in said.err
    assert "broken: failed: KeyError: 'figure'\n" in said.err
    assert "Traceback" not in said.err
    names = [each["name"] for each in json.loads(file.read_text(encoding="utf-8"))]
    assert names == ["quick thing", "slow thing", "late thing"]
    assert "late thing" in said.out


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--only", "quikc"), "benchmarks: --only quikc: there is no such benchmark: did you mean quick?\n"),
        (("--only", "quick", "--only", "zzz"), "there is no such benchmark: there are quick, absent, broken, late\n"),
        (("--json", "nowhere/figures.json"), "there is no folder nowhere; make it first\n"),
        (("--picture", "figures.jpg"), "--picture figures.jpg: expected a name that ends in .png\n"),
    ],
)
def test_options_that_cannot_be_used_are_one_line_before_anything_is_measured(
    run: Run, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], says: str
) -> None:
    assert run(*arguments) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.endswith(says)
    assert said.err.count("\n") == 1


def test_the_picture_is_a_png_of_some_size(run: Run, tmp_path: Path) -> None:
    file = tmp_path / "figures.png"
    assert run("--only", "quick", "--picture", str(file)) == 0
    with Image.open(file) as image:
        assert image.format == "PNG"
        assert image.width > 1000
        colours = {colour for _, colour in image.convert("RGB").getcolors(1 << 24) or []}
    assert {(0x00, 0x72, 0xB2), (0xD5, 0x5E, 0x00)} <= colours


def test_bars_begin_at_the_goal_and_point_to_the_better_side() -> None:
    axes = drawn(FOUND, CONDITIONS).axes[0]
    better, worse = axes.patches
    assert better.get_x() == worse.get_x() == 1.0
    assert better.get_width() == pytest.approx(2.5 - 1.0)
    assert worse.get_width() == pytest.approx(0.5 / 0.8 - 1.0)
    assert axes.get_xscale() == "log"
    assert [text.get_text() for text in axes.texts] == ["0.0200 (goal ≤ 0.05)", "0.500 (goal ≥ 0.8, missed)"]
    low, high = axes.get_xlim()
    assert low < 0.5 / 0.8
    assert high > 2.5


def test_a_figure_that_is_nothing_is_drawn_to_the_edge() -> None:
    nothing = Comparison("lost", 0.0, "samples", "1 sample", 1.0, "<=", 1.0)
    assert times_better(nothing) == 1000.0
    assert drawn([nothing], CONDITIONS).axes[0].get_xlim()[1] > 1000.0


def test_a_table_without_figures_still_says_what_it_was_measured_on() -> None:
    assert table([], CONDITIONS).splitlines()[-1] == (
        "a CPU, 2 cores, load 0.5 to 1.2; 2026-11-22 07:00; Python 3.11.7, numpy 2.4.6."
    )


def test_help_names_every_benchmark() -> None:
    command = [sys.executable, "-m", "tests.benchmarks", "--help"]
    said = subprocess.run(command, check=True, capture_output=True, text=True, cwd=Path(__file__).parents[1]).stdout
    assert all(name in "".join(said.split()) for name in NAMES)
