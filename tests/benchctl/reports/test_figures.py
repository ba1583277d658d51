import dataclasses
import re

import numpy as np
import pytest
from matplotlib.figure import Figure

from benchctl.reports.figures import LEVEL_COLOURS, inline_svg, new_figure, style
from benchctl.reports.law_figures import (
    factor_curve,
    final_residuals_figure,
    k_omega_figure,
    k_temperature_figure,
    output_figure,
)
from benchctl.reports.path_figures import levels_figure, residual_rows_figure
from tests.benchctl.reports.example import K0, S, example


@pytest.fixture(scope="module")
def result():
    return example()[0]


FIGURES = {
    "levels": levels_figure,
    "rows": residual_rows_figure,
    "final": lambda result: final_residuals_figure(result, "joint"),
    "output": output_figure,
    "k_omega": k_omega_figure,
    "k_temperature": k_temperature_figure,
}


def labelled(figure: Figure) -> None:
    """Every column has a label with its unit below, every row at its left."""
    for axes in figure.axes:
        x_labels = [other.get_xlabel() for other in axes.get_shared_x_axes().get_siblings(axes)]
        y_labels = [other.get_ylabel() for other in axes.get_shared_y_axes().get_siblings(axes)]
        assert any("(" in label or "per" in label for label in x_labels), x_labels
        assert any("(" in label for label in y_labels), y_labels
        assert axes.has_data()


@pytest.mark.parametrize("name", FIGURES)
def test_every_axis_of_every_figure_says_what_and_in_which_unit(name, result):
    labelled(FIGURES[name](result))


def test_the_levels_are_drawn_in_their_colours_on_a_logarithmic_axis(result):
    figure = levels_figure(result)
    assert {axes.get_yscale() for axes in figure.axes} == {"log"}
    assert [line.get_color() for line in figure.axes[0].lines] == list(LEVEL_COLOURS.values())


def test_the_largest_error_by_rate_is_the_stated_one(result):
    by_rate = levels_figure(result).axes[0]
    drawn = [float(np.max(line.get_ydata())) for line in by_rate.lines]
    np.testing.assert_allclose(drawn, list(result.error_percent.values()))


def test_with_one_temperature_no_axis_of_temperature_is_drawn():
    single, _ = example(temperatures=1)
    assert len(levels_figure(single).axes) == 2
    assert len(residual_rows_figure(single).axes) == 8
    assert k_temperature_figure(single) is None


def test_without_rates_at_the_reference_temperature_there_is_no_curve_of_rate(result):
    elsewhere = dataclasses.replace(result, T0_c=-75.0)
    assert output_figure(elsewhere) is None
    assert k_omega_figure(elsewhere) is None


def test_the_curve_of_the_joint_fit_is_the_inverse_of_the_sine(result):
    left = k_omega_figure(result).axes[0]
    curve = next(line for line in left.lines if "sine" in str(line.get_label()))
    x = np.asarray(curve.get_xdata())
    np.testing.assert_allclose(curve.get_ydata(), 100 * (np.arcsin(S * x) / (S * x) - 1), atol=1e-9)


def test_measured_points_of_k_lie_on_the_true_curve(result):
    left = k_omega_figure(result).axes[0]
    points = left.containers[0].lines[0]
    x, y = np.asarray(points.get_xdata()), np.asarray(points.get_ydata())
    assert x.size > 30
    np.testing.assert_allclose(y, 100 * (np.arcsin(S * x) / (S * x) - 1), atol=0.02)


def test_a_gyro_of_negative_scale_factor_is_drawn_too(result):
    points = dataclasses.replace(result.points, output_v=-result.points.output_v)
    raw = dataclasses.replace(result.raw, K0_v_per_dps=-K0, U0_v=-result.raw.U0_v)
    stages = tuple(dataclasses.replace(stage, K0_v_per_dps=-K0, U0_v=-stage.U0_v) for stage in result.stages)
    turned = dataclasses.replace(result, points=points, raw=raw, stages=stages, joint=())
    labelled(output_figure(turned))
    left = k_omega_figure(turned).axes[0]
    assert np.asarray(left.containers[0].lines[0].get_ydata()).max() > 8


def test_the_band_of_k_over_temperature_closes_at_the_reference(result):
    curve = factor_curve(result.stages[0].k_t, np.array([0.0, -60.0]))
    variance = 4e-14 * 60**2 + 2 * 6e-16 * 60**3 + 2.5e-17 * 60**4
    np.testing.assert_allclose(curve.half, [0.0, 1.959964 * np.sqrt(variance)], rtol=1e-6)
    np.testing.assert_allclose(curve.value, [1.0, 1 - 60 * 1.315e-4 - 3600 * 2.066e-6])


def draw(points: int) -> str:
    with style():
        figure = new_figure(2.0)
        figure.subplots().plot(np.arange(points), np.arange(points) ** 2, ".", rasterized=points > 100)
        return inline_svg(figure, "sketch")


def test_a_figure_is_the_same_bytes_twice_and_names_no_address():
    first = draw(5)
    assert first == draw(5)
    assert "http" not in first
    assert first.startswith("<svg ")


def test_the_ids_of_a_figure_bear_its_name_and_every_reference_has_its_target():
    svg = draw(500)
    ids = set(re.findall(r'\bid="([^"]*)"', svg))
    references = set(re.findall(r'href="#([^"]*)"|url\(#([^)]*)\)', svg))
    assert ids
    assert all(name.startswith("sketch-") for name in ids)
    assert {first or second for first, second in references} <= ids
    assert "data:image/png;base64" in svg
