import dataclasses
import re

import numpy as np
import pytest

from benchctl.calibration.result import JointFit
from benchctl.reports.calibration_page import calibration_page
from benchctl.reports.coefficient_tables import symbol
from benchctl.reports.path_figures import levels_figure
from benchctl.reports.setup_section import step_groups
from tests.benchctl.reports.example import K0, U0, C, G, S, example, meta
from tests.benchctl.reports.page import Page

DIGEST = "c0ffee" * 10 + "abcd"


@pytest.fixture(scope="module")
def campaign():
    return example()


@pytest.fixture(scope="module")
def html(campaign):
    return calibration_page(*campaign_arguments(campaign), digest=DIGEST)


@pytest.fixture(scope="module")
def page(html):
    return Page(html)


@pytest.fixture
def no_figures(monkeypatch):
    """For pages whose words are in question: drawing takes longer than everything else."""
    monkeypatch.setattr("benchctl.reports.calibration_page.drawings", lambda result: {})


def campaign_arguments(campaign, **describing):
    result, infos = campaign
    return result, meta(**describing), infos


def test_the_page_is_well_formed_and_needs_nothing_else(html, page):
    assert page.refers_elsewhere() == []
    assert "http://" not in html
    assert "https://" not in html
    assert "@import" not in html
    assert len(page.ids) == len(set(page.ids))


def test_the_page_is_small_enough_to_send(html):
    assert len(html.encode()) < 1_500_000


def test_the_page_holds_every_coefficient_to_the_last_digit(page, campaign):
    result, _ = campaign
    asked = [parameter.value for joint in result.joint for parameter in joint.parameters]
    for stage in result.stages:
        asked += [stage.K0_v_per_dps, stage.U0_v, *stage.u0_t, *stage.k_t.coefficients, *stage.k_omega.coefficients]
    asked += [result.stages[1].delay_s, result.raw.K0_v_per_dps, result.raw.U0_v]
    assert set(asked) <= set(page.numbers)
    assert {K0, S, U0, *G, *C} <= set(page.numbers)


def test_what_is_read_is_the_coefficient_to_within_its_uncertainty(html, campaign):
    result, _ = campaign
    stated = dict(reversed(re.findall(r'<data value="([^"]*)">([^<]*)</data>', html)))
    power = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹−", "-0123456789-")
    for parameter in result.best.parameters:
        found = re.match(r"\(([^ ]*) ± ([^)]*)\)(?:\s×\s10(\S+))?", stated[str(parameter.value)])
        assert found, stated[str(parameter.value)]
        scale = 10.0 ** int(found[3].translate(power)) if found[3] else 1.0
        assert float(found[1].translate(power)) * scale == pytest.approx(parameter.value, abs=0.1 * parameter.standard)
        assert float(found[2]) * scale == pytest.approx(parameter.expanded, rel=0.051)


def test_the_headline_says_the_path_of_the_error_and_on_what_it_was_measured(page):
    assert "On 10 runs that were held out at −29.5 to 54.7 °C and up to 165 °/s" in page.words
    assert "falls from 8.6 % with one straight line to 0.57 % after stage 1, 0.18 % after stage 2" in page.words
    assert "and 0.0067 % with the joint fit" in page.words


def test_the_page_says_who_where_with_what_and_how_to_do_it_again(page):
    for part in (
        "AC-1234",
        "470012345",
        "2027-01-31",
        "A. Engineer",
        "2026-03-04",
        DIGEST,
        "360 000".replace(" ", "\u202f"),
    ):
        assert part in "".join(page.text)
    assert "benchctl run two_stage --bench bench.toml -p points=20 -p room_c=20.0 -p sine_hz=0.25,0.5,1.0" in page.words
    assert "simulated: the numbers describe a model, not a device" in page.words


def test_every_figure_can_be_read_aloud_and_every_table_has_headers(page):
    assert len(page.figures) == 6
    assert all(len(attrs["aria-label"] or "") > 30 for attrs in page.figures)
    assert sum(tag == "table" for tag, _ in page.tags) == sum(tag == "caption" for tag, _ in page.tags)
    assert all(attrs.get("scope") in ("row", "col") for tag, attrs in page.tags if tag == "th")


@pytest.mark.slow
def test_the_same_input_gives_the_same_bytes(html, campaign):
    assert calibration_page(*campaign_arguments(campaign), digest=DIGEST) == html


def test_hostile_text_is_shown_not_run(campaign, no_figures):
    result, infos = campaign
    hostile = '<script>alert("1")</script>'
    described = meta(serial=hostile)
    infos = [dataclasses.replace(infos[0], name=hostile, whole=False), *infos[1:]]
    result = dataclasses.replace(result, unit=hostile, warnings=(hostile,))
    html = calibration_page(result, described, infos, digest=hostile)
    assert "<script" not in html
    assert Page(html).words.count(hostile) >= 4


def test_an_unfinished_campaign_is_said_before_the_first_number(campaign, no_figures):
    page = Page(calibration_page(*campaign_arguments(campaign, status="interrupted"), digest=DIGEST))
    assert page.words.index("The campaign is not complete") < page.words.index("8.6 %")


def test_cut_steps_and_gaps_are_said_at_the_top(campaign, no_figures):
    result, infos = campaign
    lossy = [dataclasses.replace(infos[0], whole=False), dataclasses.replace(infos[1], gaps=3), *infos[2:]]
    page = Page(calibration_page(result, meta(), lossy, digest=DIGEST))
    assert "step 1 (static 1) is not complete; step 2 (constant_rate 2): 3 gaps in the stream" in page.words


def test_without_runs_kept_aside_no_error_is_claimed(no_figures):
    page = Page(calibration_page(*campaign_arguments(example(verify=False)), digest=DIGEST))
    assert "No run was kept aside for verification, so no error is stated" in page.words
    assert "their errors flatter the calibration" in page.words
    assert "No fit has seen these runs" not in page.words


def test_runs_that_the_fit_itself_kept_aside_are_counted_so(campaign):
    _, infos = campaign
    uses = {info.index: "fitted" for info in infos[1:-1]} | {infos[-1].index: "kept aside"}
    groups = step_groups([dataclasses.replace(info, role="fit") for info in infos], uses)
    assert [group["steps"] for group in groups if group["use"] == "kept aside"] == [1]
    assert [group["steps"] for group in groups if group["use"] == "not used"] == [1]


@pytest.mark.slow
def test_one_temperature_is_a_limitation_not_an_empty_panel():
    page = Page(calibration_page(*campaign_arguments(example(temperatures=1)), digest=DIGEST))
    assert "20 °C: where it was measured" in page.words.replace("\u00a0", " ")
    assert len(page.figures) == 5


def test_without_a_joint_fit_the_stages_stand_alone(no_figures):
    page = Page(calibration_page(*campaign_arguments(example(joint=False)), digest=DIGEST))
    assert "6 Uncertainty budget" not in page.words
    assert "and 0.18 % after stage 2." in page.words


@pytest.mark.slow
def test_a_result_without_stages_or_runs_is_still_a_page(campaign):
    result, infos = campaign
    bare = dataclasses.replace(
        result, stages=(), joint=(), runs=(), temperatures=(), error_percent={}, rms_percent={}, smoother=None,
        latitude_deg=None,
    )  # fmt: skip
    page = Page(calibration_page(bare, dataclasses.replace(meta(), provenance={}), infos, digest=""))
    assert "No run was kept aside" in page.words
    assert not [attrs for _, attrs in page.tags if attrs.get("class") == "tiles"]


def test_no_steps_and_unreadable_provenance_are_survived(campaign, no_figures):
    result, _ = campaign
    told = {"instruments": "not json", "software": "[1]", "parameters": "{"}
    page = Page(calibration_page(result, dataclasses.replace(meta(), provenance=told), [], digest=DIGEST))
    assert "as recorded = {" in page.words


def test_the_polynomial_law_has_its_own_formula(campaign, no_figures):
    result, infos = campaign
    page = Page(calibration_page(with_polynomial(result), meta(), infos, digest=DIGEST))
    assert "x = (U − U0) / K0 ω = x·(1 + a1·ΔT)·(1 + b2·x² + b4·x⁴)" in page.words
    assert "For comparison: joint fit, law: sine" in page.words


def with_polynomial(result):
    values = {"K0_v_per_dps": K0, "b2": 3.3e-6, "b4": 5.9e-11, "a1": 1.3e-4, "U0_v": U0}
    parameters = tuple(
        dataclasses.replace(result.best.parameters[0], name=name, value=value, standard=1e-4 * abs(value))
        for name, value in values.items()
    )
    polynomial: JointFit = dataclasses.replace(
        result.best,
        law="polynomial",
        convention="correction",
        argument="indicated",
        parameters=parameters,
        covariance=np.diag([parameter.standard**2 for parameter in parameters]),
        bic=result.best.bic - 10,
    )
    return dataclasses.replace(result, joint=(polynomial, *result.joint))


def test_a_step_cut_into_fitted_and_kept_parts_is_said_so_and_its_parts_have_their_own_times(campaign, no_figures):
    result, infos = campaign
    step = next(run.step for run in result.runs if run.role == "verify")
    left = result.residuals
    mine = np.flatnonzero(left.step == step)
    verify = left.verify.copy()
    verify[mine[200:400]] = False
    whole = next(run for run in result.runs if run.step == step)
    parts = [whole, dataclasses.replace(whole, role="fit"), whole]
    cut = dataclasses.replace(result, residuals=dataclasses.replace(left, verify=verify), runs=tuple(parts))
    assert "fitted; parts kept aside" in Page(calibration_page(cut, meta(), infos, digest=DIGEST)).words
    times = np.asarray(levels_figure(cut).axes[-1].lines[0].get_xdata())
    np.testing.assert_allclose(times * 3600, [left.time_s[mine[:200]].mean(), left.time_s[mine[400:]].mean()])


def test_scatter_beyond_the_noise_is_a_remark(campaign, no_figures):
    result, infos = campaign
    noise = dataclasses.replace(result.best.noise, mean_excess=68.0)
    loud = dataclasses.replace(result, joint=(dataclasses.replace(result.best, noise=noise),))
    said = "The means of steps scatter 68 times as much as the noise within them"
    assert said in Page(calibration_page(loud, meta(), infos, digest=DIGEST)).words
    assert said[:30] not in Page(calibration_page(result, meta(), infos, digest=DIGEST)).words


def test_the_scale_of_a_gyro_that_gives_rates_has_no_unit(campaign, no_figures):
    result, infos = campaign
    digital = dataclasses.replace(result, output_unit="deg/s")
    page = Page(calibration_page(digital, meta(), infos, digest=DIGEST))
    assert "U: output (°/s)" in page.words
    assert "°/s/(°/s)" not in page.words


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("K0_v_per_dps", "K0"),
        ("encoder_cos1_arcsec", "encoder, cos θ"),
        ("encoder_sin2_arcsec", "encoder, sin 2θ"),
        ("g1", "g1"),
    ],
)
def test_symbols_are_those_of_the_formulas(name, expected):
    assert symbol(name) == expected
