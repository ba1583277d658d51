"""The report on an Allan analysis."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchctl.metrology.allan import Allan, analysed
from benchctl.metrology.series import Series
from benchctl.reports import text
from benchctl.reports.allan_report import allan_figure, cautions, lines, term_rows, values, write_report
from benchctl_instruments.errors import UsageError
from tests.benchctl.metrology.noises import record


@pytest.fixture(scope="module")
def found() -> Allan:
    rates = record(np.random.default_rng(3), 1 << 15, 0.02, q=0.03, n=0.1, k=0.1)
    return analysed(Series(values=rates, interval_s=0.02, unit="deg/s", source="<made>"))


def test_every_term_is_stated_with_its_unit_or_refused_with_a_reason(found: Allan) -> None:
    told = values(found)
    assert {term for term, one in told["coefficients"].items() if one is None} == set(told["refused"]) == {"B", "R"}
    assert told["coefficients"]["K"]["value"] == pytest.approx(0.1 * 216_000.0, rel=0.3)
    assert told["coefficients"]["K"]["unit"] == "deg/h/sqrt(h)"
    assert told["coefficients"]["Q"]["value"] == pytest.approx(0.03 * 3600.0, rel=0.05)
    stated = {row.term: row.stated for row in term_rows(found)}
    assert stated["B"] == f"none: {told['refused']['B']}"
    assert "arcsec, 95 % interval" in stated["Q"]
    assert all(row.stated in lines(found) for row in term_rows(found))


def test_a_series_that_is_no_rate_has_coefficients_in_its_own_unit(found: Allan) -> None:
    volts = Allan(
        series=Series(values=found.series.values, interval_s=0.02, unit="V", source="volts"),
        tau_s=found.tau_s,
        deviation=found.deviation,
        ci95=found.ci95,
        freedom=found.freedom,
        terms=found.terms,
        misfit=found.misfit,
    )
    assert values(volts)["coefficients"]["N"] == pytest.approx(
        {
            "value": found.terms.found["N"].value,
            "ci95": pytest.approx(list(found.terms.found["N"].ci95)),
            "unit": "V/sqrt(Hz)",
        }
    )


def test_a_record_that_the_terms_describe_has_no_caution(found: Allan, tmp_path: Path) -> None:
    assert cautions(found) == []
    assert values(found)["misfit"] is None
    page = write_report(found, tmp_path / "a", "made")[0].read_text(encoding="utf-8")
    assert 'class="banner"' not in page


def test_a_line_in_the_spectrum_is_told_at_the_terminal_in_the_json_and_on_the_page(tmp_path: Path) -> None:
    rates = np.random.default_rng(1).standard_normal(3000) + 5.0 * np.sin(0.2 * np.arange(3000))
    found = analysed(Series(values=rates, interval_s=0.1, unit="deg/s", source="lined"))
    (says,) = cautions(found)
    misfit = values(found)["misfit"]
    assert misfit["deviation"] in found.deviation
    for key in ("tau_s", "deviation", "modelled"):
        assert text.number(misfit[key], 3) in says
    assert lines(found).endswith(says)
    assert says in write_report(found, tmp_path / "a", "made")[0].read_text(encoding="utf-8")


@pytest.mark.parametrize("step", [1.0, 0.1 + 0.2])
def test_an_output_that_toggles_is_drawn_over_the_averaging_times_where_it_has_a_deviation(step: float) -> None:
    toggling = Series(values=step * (np.arange(3000) % 2.0), interval_s=0.1, unit="deg/s", source="toggling")
    (axes,) = allan_figure(analysed(toggling)).axes
    low, high = axes.get_ylim()
    assert 1e-4 * step < low < 1e-2 * step
    assert 0.5 * step < high < 2.0 * step


def test_the_picture_has_the_deviation_the_terms_and_their_sum_on_logarithmic_axes(found: Allan) -> None:
    (axes,) = allan_figure(found).axes
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    labels = [line.get_label() for line in axes.lines]
    assert labels == [
        "overlapping Allan deviation",
        "Q, quantisation",
        "N, angle random walk",
        "K, rate random walk",
        "their sum",
    ]
    drawn, total = axes.lines[0], axes.lines[-1]
    at_shortest = float(np.asarray(total.get_ydata())[0])
    assert at_shortest == pytest.approx(float(np.asarray(drawn.get_ydata())[0]), rel=0.02)


def test_the_page_is_the_same_for_the_same_series_and_escapes_what_it_is_told(found: Allan, tmp_path: Path) -> None:
    pages = [write_report(found, tmp_path / name, "<script>")[0].read_text(encoding="utf-8") for name in ("a", "b")]
    assert pages[0] == pages[1]
    assert "<script>" not in pages[0]
    assert "&lt;made&gt;" in pages[0]


def test_a_folder_that_is_a_file_is_refused(found: Allan, tmp_path: Path) -> None:
    (tmp_path / "a").write_text("")
    with pytest.raises(UsageError, match="cannot be made"):
        write_report(found, tmp_path / "a", "made")
