"""Pictures of tests."""

from __future__ import annotations

from base64 import b64encode
from dataclasses import replace

import numpy as np
import pytest

from benchctl.metrology.result import Limit, Picture, Trace
from benchctl.reports.acceptance.catalogue import Catalogue, catalogue
from benchctl.reports.acceptance.sections import drawn, picture_figure
from tests.benchctl.reports.acceptance.example import acceptance, angle_random_walk, scale_factor

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
    above, below = picture_figure(picture_of_scale(), None, RUSSIAN).axes
    assert above.get_title(loc="left") == "выход, В"
    assert below.get_xlabel() == "угловая скорость, °/с"
    assert below.get_title(loc="left") == "отклонение, млн⁻¹"
    assert above.get_xlim() == below.get_xlim()
    legend = above.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["показания", "аппроксимация"]


def test_axes_are_logarithmic_where_asked_and_linear_where_something_is_not_positive() -> None:
    (axes,) = picture_figure(picture_of_walk(), None, ENGLISH).axes
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    x = np.array([1.0, 10.0])
    phase = Picture(x="frequency", x_unit="Hz", y="phase", y_unit="deg", traces=(), logarithmic=True)
    (axes,) = picture_figure(replace(phase, traces=(Trace(label="readings", x=x, y=-x),)), None, ENGLISH).axes
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "linear")
    assert axes.get_legend() is None


@pytest.mark.parametrize(("words", "sign"), [(ENGLISH, "0.5"), (RUSSIAN, "0,5")])
def test_numbers_at_the_axes_have_the_decimal_sign_of_the_language(words: Catalogue, sign: str) -> None:
    half = np.linspace(0.0, 1.0, 5)
    one = Picture(x="rate", x_unit="deg/s", y="gain", y_unit="1", traces=(Trace(label="readings", x=half, y=half),))
    figure = picture_figure(one, None, words)
    figure.draw_without_rendering()
    labels = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert any(sign in label for label in labels), labels


def test_the_same_picture_has_the_same_bytes_for_page_and_pdf() -> None:
    some = acceptance().judged[0]
    first, second = (drawn(some, picture_of_scale(), ENGLISH) for _ in range(2))
    assert first == second
    assert first.png.startswith(b"\x89PNG")
    assert b64encode(first.png).decode() in first.drawing.svg


def test_a_limit_of_magnitudes_is_drawn_on_both_sides_of_zero_and_every_point_with_its_bar() -> None:
    x = np.array([-1.0, 0.0, 2.0])
    trace = Trace(label="misfit", x=x, y=-x, standard=np.array([0.1, 0.2, 0.3]))
    limited = Picture(x="rate", x_unit="deg/s", y="misfit", y_unit="ppm", traces=(trace,), limited="y")
    (axes,) = picture_figure(limited, Limit(low=None, high=5.0, unit="ppm"), ENGLISH).axes
    dashed = [line.get_ydata()[0] for line in axes.lines if line.get_linestyle() == "--"]
    assert sorted(dashed) == [-5.0, 5.0]
    (bars,) = axes.collections
    assert bars.get_segments()[2][:, 1] == pytest.approx([-2.0 - 0.6, -2.0 + 0.6])


def test_the_caption_states_the_finding_the_point_that_made_it_and_what_is_drawn() -> None:
    x = np.array([-1.0, 0.0, 2.0])
    trace = Trace(label="misfit", x=x, y=-x, standard=np.ones(3))
    picture = Picture(x="rate", x_unit="deg/s", y="misfit", y_unit="%", traces=(trace,), limited="y")
    failed = acceptance().judged[1]
    assert drawn(failed, picture, ENGLISH).caption.replace("\u00a0", " ") == (
        "Nonlinearity of reading: (1.310 ± 0.040) %, limit ≤ 1 %: FAIL. Largest magnitude at 2 °/s. "
        "Bars: ±U of a point (k = 2). Dashed: limit."
    )
    assert "Dashed" not in drawn(failed, replace(picture, y_unit="ppm"), ENGLISH).caption


def test_many_dots_are_small() -> None:
    x = np.arange(1000.0)
    many = Picture(x="time_since_on", x_unit="s", y="bias", y_unit="deg/h", traces=(Trace(label="readings", x=x, y=x),))
    (axes,) = picture_figure(many, None, ENGLISH).axes
    assert axes.lines[0].get_markersize() < 4.0
