"""The page on a fleet."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchctl.reports.fleet_facts import Fleet
from benchctl.reports.fleet_page import write_fleet_page
from benchctl.reports.fleet_stated import FleetVerb
from tests.benchctl.reports.made_fleet import ODD, fleet
from tests.benchctl.reports.page import Page


def page_of(made: Fleet, folder: Path) -> Page:
    return Page(write_fleet_page(made, folder).read_text(encoding="utf-8"))


def test_it_tells_failures_figures_physics_and_verdicts_and_leads_to_the_single_reports(tmp_path: Path) -> None:
    page = page_of(fleet(24, failed=("broken",), left=2), tmp_path)
    for words in (
        "Fleet: fit of 27 recordings",
        "23 done, 1 unchanged since they were done, 1 failed, 2 left",
        "Stopped before its end: 2 recordings are left",
        "1 recording failed, and is in no figure below",
        "/lab/broken.h5: is no <HDF5> file",
        "Calibration, VG910Q",
        "Physics that recurs",
        "13 missing-physics 11 consistent",
        f"SN-{ODD:02d}: percent = −0.7000 %",
        "23 PASS 1 FAIL",
    ):
        assert words in page.words, words
    links = [attrs["href"] for tag, attrs in page.tags if tag == "a"]
    assert len(links) == 24
    assert (tmp_path / str(links[7])).resolve() == Path("/lab/SN-07.fit/report.html")


def test_it_is_one_file_that_needs_nothing_else(tmp_path: Path) -> None:
    page = page_of(fleet(24), tmp_path)
    assert {str(link).rpartition(".fit/")[2] for link in page.refers_elsewhere()} == {"report.html"}
    assert [path.name for path in tmp_path.iterdir()] == ["fleet.html"]
    assert len(page.figures) == 6  # four figures, the map of effects, the bars of tests
    assert all(figure["aria-label"] for figure in page.figures)


@pytest.mark.parametrize("count", [0, 1, 4, 300])
def test_few_and_many_are_drawn(tmp_path: Path, count: int) -> None:
    page = page_of(fleet(count, failed=("broken",)) if count else Fleet(verb="fit", members=(), left=3), tmp_path)
    assert ("Physics that recurs" in page.words) == (count > 0)
    shown = [tag for tag, attrs in page.tags if tag == "circle" and attrs["fill"] == "#222"]
    assert len(shown) in (0, 4 * count)


@pytest.mark.parametrize(("verb", "physics_first"), [("fit", False), ("accept", False), ("diagnose", True)])
def test_a_fleet_that_was_diagnosed_has_its_physics_first(tmp_path: Path, verb: FleetVerb, physics_first: bool) -> None:
    words = page_of(fleet(6, verb=verb), tmp_path).words
    assert (words.index("Physics that recurs") < words.index("How to read the charts")) == physics_first


def test_names_and_reasons_are_escaped(tmp_path: Path) -> None:
    made = fleet(2, failed=("<script>alert(1)</script>",))
    assert "<script>" not in write_fleet_page(made, tmp_path).read_text(encoding="utf-8")
