"""The page on a history: charts of whatever numbers there are."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from benchctl.history.history import Charted
from benchctl.reports.history_charts import time_chart, units_chart
from benchctl.reports.history_page import write_page_of
from tests.benchctl.history.made_history import accepted, campaign, digest_in, figure, one_test, read
from tests.benchctl.reports.page import Page


def _charted(folder: Path, values: list[float], **more: Any) -> Charted:
    for number, value in enumerate(values):
        place = campaign(folder, number=number, K0=None)
        (place / "acceptance.json").write_text(accepted([one_test(value=value, **more)], digest_in(place)))
    return figure(read(folder), "bias")


def _heights(svg: str) -> list[float]:
    """Where the dots are, from above."""
    return [float(place) for place in re.findall(r'cy="([-\d.]+)" r="8"', svg)]


@pytest.mark.parametrize(
    "values",
    [
        [1.0],
        [0.0, 0.0],
        [5e-324, 0.0],
        [-1e100, 1e100],
        [1e-300, 2e-300],
        [1e-99, 3e-99],
        [0.05, 0.05 + 1e-12],
        [1e9, 1e9 + 1.0],
        [-3e-7, 4e-7, 2e-7],
    ],
)
@pytest.mark.parametrize("uncertainty", [None, 0.0])
def test_any_values_are_inside_their_chart(tmp_path: Path, values: list[float], uncertainty: float | None) -> None:
    charted = _charted(tmp_path, values, uncertainty=uncertainty)
    svg = str(time_chart(charted))
    Page(svg)
    heights = _heights(svg)
    assert len(heights) == len(values)
    assert all(10.0 < height < 125.0 for height in heights)
    assert "nan" not in svg
    assert "inf" not in svg
    Page(str(units_chart([charted.series], None)))


def test_larger_values_are_higher_and_limits_near_by_are_drawn(tmp_path: Path) -> None:
    limit = {"low": -1e6, "high": 2.5, "unit": "deg/h"}
    svg = str(time_chart(_charted(tmp_path, [1.0, 2.0], limit=limit)))
    first, second = _heights(svg)
    assert first > second
    assert svg.count('stroke="#B3261E"') == 1  # the lower limit is far away and told in words
    assert "<title>2026-01-01 08:00 · (1.00 ± 0.10)" in svg


def test_a_limit_that_a_value_fails_is_drawn_however_far_it_is(tmp_path: Path) -> None:
    limit = {"low": -1e12, "high": 2.5, "unit": "deg/h"}
    svg = str(time_chart(_charted(tmp_path, [1e6], limit=limit, verdict="FAIL")))
    assert svg.count('stroke="#B3261E" stroke-width="1.2"') == 1


def test_a_value_too_large_to_reckon_with_is_a_problem(tmp_path: Path) -> None:
    place = campaign(tmp_path)
    (place / "acceptance.json").write_text(accepted([one_test(value=1e101)], digest_in(place)))
    (problem,) = read(tmp_path).problems
    assert "expected at most 1e+100" in problem.message


def test_the_page_is_the_same_for_the_same_history(tmp_path: Path) -> None:
    for number in range(9):
        campaign(tmp_path / "all", number=number, K0=0.05 + 1e-4 * number)
    history = read(tmp_path / "all")
    pages = [write_page_of(history, history.units, tmp_path / name, "all").read_bytes() for name in "ab"]
    assert pages[0] == pages[1]
    page = Page(pages[0].decode())
    assert "Outside the control limits on 2026-01-09" in page.words
    assert "Drifted since the first calibration, 2026-01-01 (Eₙ = 57)" in page.words
