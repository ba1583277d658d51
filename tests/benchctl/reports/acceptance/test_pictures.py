"""Pictures of tests."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchctl.metrology.result import Picture, Trace
from benchctl.reports.acceptance.catalogue import Catalogue, catalogue
from benchctl.reports.acceptance.sections import drawn, picture_figure
from tests.benchctl.reports.acceptance.example import angle_random_walk, scale_factor

ENGLISH, RUSSIAN = catalogue("en"), catalogue("ru")


def picture_of_scale() -> Picture:
    found = scale_factor().picture
    assert found is not None
    return found


def picture_of_walk() -> Picture:
    found = angle_random_walk().picture
    assert found is not None
    return found


def test_what_the_law_leaves_is_below_over_the_same_axis() -> None:
    above, below = picture_figure(picture_of_scale(), RUSSIAN).axes
    assert above.get_ylabel() == "выход, В"
    assert below.get_xlabel() == "угловая скорость, °/с"
    assert below.get_ylabel() == "отклонение,\nмлн⁻¹"
    assert above.get_xlim() == below.get_xlim()
    legend = above.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["показания", "подобранный закон"]


def test_axes_are_logarithmic_where_asked_and_linear_where_something_is_not_positive() -> None:
    (axes,) = picture_figure(picture_of_walk(), ENGLISH).axes
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    x = np.array([1.0, 10.0])
    phase = Picture(x="frequency", x_unit="Hz", y="phase", y_unit="deg", traces=(), logarithmic=True)
    (axes,) = picture_figure(replace(phase, traces=(Trace(label="readings", x=x, y=-x),)), ENGLISH).axes
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "linear")
    assert axes.get_legend() is None


@pytest.mark.parametrize(("words", "sign"), [(ENGLISH, "0.2"), (RUSSIAN, "0{,}2")])
def test_numbers_at_the_axes_have_the_decimal_sign_of_the_language(words: Catalogue, sign: str) -> None:
    half = np.linspace(0.0, 1.0, 5)
    one = Picture(x="rate", x_unit="deg/s", y="gain", y_unit="1", traces=(Trace(label="readings", x=half, y=half),))
    figure = picture_figure(one, words)
    figure.draw_without_rendering()
    labels = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert any(sign in label for label in labels), labels


def test_the_same_picture_has_the_same_bytes_for_page_and_pdf() -> None:
    first, second = (drawn(picture_of_scale(), "a", ENGLISH) for _ in range(2))
    assert first == second
    assert first.png.startswith(b"\x89PNG")
    assert 'id="a-' in first.drawing.svg


def test_many_dots_are_small() -> None:
    x = np.arange(1000.0)
    many = Picture(x="time_since_on", x_unit="s", y="bias", y_unit="deg/h", traces=(Trace(label="readings", x=x, y=x),))
    (axes,) = picture_figure(many, ENGLISH).axes
    assert axes.lines[0].get_markersize() < 2.0
