import csv
import dataclasses
import math

import numpy as np
import pytest

from benchctl.calibration.static_points_fit import fit_static_points
from benchctl.recordings.model import BenchFacts, Meta, Unit
from benchctl.recordings.static_points import StaticPoints
from benchctl.reports.points_page import points_figure, static_points_page
from tests.benchctl.reports.page import Page
from tests.shared import SHARED, needs_shared

RATES = np.array([-200.0, -150, -100, -50, -20, 0, 20, 50, 100, 150, 200])
TABLE = "data/vg910/unit1_static_points.csv"


def some_points(**more):
    noise = 1e-3 * np.random.default_rng(3).standard_normal(RATES.size)
    return StaticPoints(rate_dps=RATES, mean_v=0.1 - 0.057 / 0.0043 * np.sin(0.0043 * RATES) + noise, **more)


def meta_of(serial="1"):
    return Meta(status="imported", unit=Unit(serial=serial, range_dps=200.0), bench=BenchFacts(sample_rate_hz=0.0))


def page_of(points, meta=None):
    result = fit_static_points(points.rate_dps, points.mean_v, points.std_v)
    return result, static_points_page(result, points, meta or meta_of(), digest="beef")


def test_the_page_holds_the_laws_their_misfits_and_what_rest_does():
    points = some_points(std_v=np.full(RATES.size, 0.02), run=np.ones(RATES.size), duration_s=np.full(RATES.size, 10.0))
    result, html = page_of(points)
    page = Page(html)
    fit = result.rotating
    assert {fit.K0_v_per_dps, fit.U0_v, fit.S_rad_per_dps, fit.line_K0_v_per_dps, fit.line_U0_v} <= set(page.numbers)
    assert "The 1 points at rest" in page.words or "point at rest" in page.words
    assert "scatter by 0.020 V at rest and by 0.020 V in rotation" in page.words
    assert "Each mean over 10 s" in page.words
    assert "this is a misfit, not an error on runs that no fit has seen" in page.words


def test_the_page_needs_nothing_else_and_is_the_same_twice():
    _, html = page_of(some_points())
    assert html == page_of(some_points())[1]
    page = Page(html)
    assert page.refers_elsewhere() == []
    assert "http" not in html
    assert len(page.figures) == 1


def test_a_serial_cannot_run():
    _, html = page_of(some_points(), meta_of(serial="<script>x</script>"))
    assert "<script" not in html
    assert "<script>x</script>" in Page(html).words


def test_without_points_at_rest_one_fit_is_listed():
    points = some_points()
    moving = dataclasses.replace(points, rate_dps=RATES[RATES != 0], mean_v=points.mean_v[RATES != 0])
    result, html = page_of(moving)
    assert math.isnan(result.rest_offset_dps)
    assert "all, with rest" not in Page(html).words
    assert "nan" not in Page(html).words.split()


def test_the_figure_names_its_axes():
    points = some_points()
    result = fit_static_points(points.rate_dps, points.mean_v)
    figure = points_figure(result, points, "V")
    assert [axes.get_xlabel() for axes in figure.axes] == ["commanded rate (°/s)"] * 2
    assert [axes.get_ylabel() for axes in figure.axes] == ["output (V)", "indicated less commanded rate (°/s)"]


@needs_shared(TABLE)
def test_the_real_gyro_s_line_misses_by_percents_and_its_sine_by_tenths():
    rows = list(csv.DictReader((SHARED / TABLE).read_text().splitlines()))
    columns = {name: np.array([float(row[name]) for row in rows]) for name in ("rate_dps", "gyro_v_mean", "gyro_v_std")}
    points = StaticPoints(rate_dps=columns["rate_dps"], mean_v=columns["gyro_v_mean"], std_v=columns["gyro_v_std"])
    result = fit_static_points(points.rate_dps, points.mean_v, points.std_v)
    page = Page(static_points_page(result, points, meta_of(), digest="beef"))
    tile = page.text.index("straight line")
    assert float(page.text[tile + 1].split()[0]) == pytest.approx(result.rotating.line.rms_percent_fs, rel=0.06)
    assert result.rotating.line.rms_dps > 10 * result.rotating.sine.rms_dps
