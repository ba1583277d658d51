"""Explanations as they stand in a terminal."""

from __future__ import annotations

import re

import pytest

from benchctl.explain.book import entries, find, grouped
from benchctl.explain.terminal import listing, page


@pytest.mark.parametrize("columns", [64, 80, 100])
def test_no_line_is_wider_than_the_terminal(columns: int) -> None:
    longest = max((line for one in entries() for line in page(one, columns).splitlines()), key=len)
    assert len(longest) <= columns, longest
    assert max(map(len, listing(grouped(), columns).splitlines())) <= columns


def test_a_page_is_never_wider_than_a_hundred_columns_nor_narrower_than_sixty_four() -> None:
    (lag,) = find("thermal_lag")
    assert page(lag, 300) == page(lag, 100)
    assert page(lag, 10) == page(lag, 64)


def test_the_list_has_every_entry_in_a_line_under_its_heading() -> None:
    text = listing(grouped(), 100)
    for entry in entries():
        assert re.search(rf"^  {re.escape(entry.name)}  +\S", text, re.MULTILINE), entry.name
    headings = [line for line in text.splitlines() if line.endswith(":") and not line.startswith(" ")]
    assert headings[0] == "Effects of the gyro's chain:"
    assert len(headings) == len(grouped())


def test_at_a_hundred_columns_no_term_of_the_list_is_cut() -> None:
    terms = {group: some for group, some in grouped().items() if group not in ("gyro", "drive", "chamber")}
    assert "E_n" in listing(terms, 100)
    assert " …" not in listing(terms, 100)


def test_a_page_has_the_equation_its_letters_and_the_parameters_with_units() -> None:
    (lag,) = find("thermal_lag")
    text = " ".join(page(lag, 100).split())
    assert "Equation τ·dT_coil/dt = T − T_coil" in text
    assert "T_coil: temperature of its coil, °C" in text
    assert "tau_s: time constant of the coil behind its thermistor; 1 to 20000" in text
    assert "usual 200 to 900" in text
    assert "Shown by benchctl run thermal_ramps; benchctl run diagnostic" in text


def test_numbers_are_written_as_people_write_them() -> None:
    (curve,) = find("rate_nonlinearity")
    text = " ".join(page(curve, 100).split())
    assert "−10⁻⁸ to 10⁻⁸ (°/s)⁻⁴" in text
    assert "ω: true rate, °/s" in text
    assert "none at 0" in text
    assert not re.search(r"\de[-+]?\d", text)
    (fold,) = find("fringe_ambiguity")
    assert "none at ∞" in page(fold, 100)
