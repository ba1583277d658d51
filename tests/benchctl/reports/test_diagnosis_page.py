"""The page on a diagnosis says what the diagnosis says, to somebody who was not there."""

import dataclasses
import math
import time
from dataclasses import replace

import numpy as np
import pytest

from benchctl.diagnosis.result import Curve, Estimate, NotFound, Slice, StructureModel
from benchctl.recordings.model import BenchFacts, Meta, StepInfo, Unit
from benchctl.reports import diagnosis_words as words
from benchctl.reports.diagnosis_page import diagnosis_page
from benchctl.reports.diagnosis_tables import lines
from benchctl.reports.diagnosis_words import chip, headline
from benchctl.reports.figures import style
from benchctl.reports.mismatch_figures import curve_figure, map_figure, significance, steps_figure, traces_figure
from tests.benchctl.diagnosis.example import NOISE_V, nothing_missing, pair, unknown_structure
from tests.benchctl.reports.page import Page
from tests.slowness import slowness

INFO = StepInfo(index=1, name="static +23", kind="static", t_start=0.0, t_end=40.0, chamber_setpoint_c=23.0, samples=9)


def meta_of(status="imported", serial="DUT-1"):
    return Meta(status=status, unit=Unit(serial=serial, range_dps=145.0), bench=BenchFacts(sample_rate_hz=125.0))


def test_of_a_parameter_that_is_not_observable_the_page_says_so():
    one = Estimate(value=0.05, low=-math.inf, high=math.inf, unit="V·s/degree", was=0.051)
    assert words.interval(one) == words.change(one) == words.NOT_OBSERVABLE


def page_of(diagnosis, meta=None, unit="V"):
    return diagnosis_page(diagnosis, meta or meta_of(), [INFO], digest="beef", unit=unit)


def undrawn(diagnosis):
    """Without what takes time to draw."""
    return replace(diagnosis, slices=(), steps=(), traces=())


@pytest.fixture(scope="module")
def pair_html():
    return page_of(pair())


@pytest.fixture(scope="module")
def pair_page(pair_html):
    return Page(pair_html)


def test_the_head_has_the_verdict_every_finding_and_what_is_to_be_run_next(pair_page):
    head = pair_page.words[: pair_page.words.index("1 Where model and recording differ")]
    assert "Physics is missing" in head
    assert "The data demand physics that the model does not have: thermal lag and encoder eccentricity." in head
    for finding in pair().findings:
        assert finding.says in head
    assert pair().next_experiment.says in head
    assert "1.94 mV 3.80 × the noise" in head
    assert "516 µV 1.01 × the noise" in head
    assert "12 held-out steps" in head


def test_a_finding_has_words_equation_values_place_evidence_and_alternatives(pair_page):
    told = pair_page.words
    assert "The fibre coil is not at the temperature of its thermistor" in told
    assert "τ·dT_coil/dt = T − T_coil" in told
    assert {590.8, 80.17, 331.5} <= set(pair_page.numbers)
    assert "(591 ± 16) s" in told
    assert "change of the gyro's temperature, 0.021 to 0.058 °C/s; 93 % of what the noise does not" in told
    assert "Largest in: ramp to +55, rate +145.0 at +55." in told
    assert "4 322 in twice the log likelihood; chance alone may reach 21.7" in told
    assert "811.2, on data that chose and fitted nothing" in told
    assert "thermal hysteresis 1 % 9.2" in told


def test_what_was_looked_for_stands_with_the_size_that_was_found_again(pair_page):
    told = pair_page.words
    assert "dead zone half_width_dps = 0.012 °/s" in told
    assert "scale warm up fraction = 2.1 × 10⁻⁵ tau_s = 600" in told
    unseen = told[told.index("7 What could not be seen") : told.index("8 The model's own parameters")]
    assert pair().notes[0] in unseen
    assert "dead zone " not in unseen.replace(pair().notes[0], "")


def test_the_next_experiment_is_a_command(pair_page):
    assert "benchctl run temperature_sweep --bench bench.toml -p points=3" in pair_page.words
    assert "separates thermal lag from thermal hysteresis, by about 58" in pair_page.words


def test_the_models_own_parameters_say_what_they_were_and_how_far_they_moved(pair_page):
    own = pair_page.words[pair_page.words.index("8 The model's own parameters") :]
    assert "K0_v_per_dps 16.00000 × 10⁻³ V/(°/s)" in own
    assert "21 standard errors, 0.020 %" in own
    assert "delay_s – (21 ± 25) × 10⁻⁶ s was not in the model" in own
    assert "[effects.thermal_lag]" in own


def test_where_nothing_is_missing_the_page_says_so_and_how_sure_that_is():
    told = Page(page_of(undrawn(nothing_missing()))).words
    assert "Consistent The model agrees with the recording to within the noise." in told
    assert "none gains more than 21.7" in told
    assert "Nothing is open." in told
    assert "The residual is not distinguishable from noise." in told


def test_unknown_structure_names_its_coordinates_and_forces_no_name():
    told = Page(page_of(unknown_structure())).words
    assert "Unknown structure" in told
    assert "Unexplained: What is left repeats 17 times a turn" in told
    assert "angle of the table; angle of the table together with gyro's temperature" in told
    assert "62 % of the initial mismatch" in told
    assert "beyond chance: angle of the table." in told


def step_model():
    """A step of the scale factor at 34.6 °C, as it was found, with its curve beside held-out steps."""
    place, along = np.linspace(-20.0, 50.0, 40), np.linspace(-20.0, 50.0, 200)
    chance = 1e-4 * np.random.default_rng(3).standard_normal(40)
    step = -9.7e-3 * (along > 34.6)
    return StructureModel(
        identifier="step_of_scale_over_gyro_temp",
        stage="scale",
        coordinates=("gyro_temp",),
        shape="step",
        formula="K = K0·(1 + change·clip((gyro_temp − at)/width + ½, 0, 1))",
        parameters={"at": Estimate(value=34.6, low=34.4, high=34.8, unit="degC")},
        explains=0.98,
        says="Where the coil's temperature is above 34.6 °C the scale factor is 0.97 % lower.",
        curve=Curve(
            place=place,
            required=chance - 9.7e-3 * (place > 34.6),
            left=chance,
            error=np.full(40, 1e-4),
            along=along,
            fitted=step,
            low=step - 2e-4,
            high=step + 2e-4,
        ),
    )


def test_a_modelled_structure_is_drawn_beside_what_held_out_steps_ask_of_it():
    diagnosis = undrawn(unknown_structure())
    modelled = replace(diagnosis, unexplained=replace(diagnosis.unexplained, models=(step_model(),)))
    page = page_of(modelled)
    assert 'id="structure-1-' in page
    assert "Below: what the structure leaves." in page
    bare = replace(step_model(), curve=None)
    assert "structure-1-" not in page_of(replace(diagnosis, unexplained=replace(diagnosis.unexplained, models=(bare,))))


def test_the_curve_of_a_structure_is_drawn_in_the_unit_of_what_it_changes():
    with style():
        upper, lower = curve_figure(step_model(), "V").axes
    assert (upper.get_ylabel(), lower.get_ylabel()) == ("before (%)", "after (%)")
    assert lower.get_xlabel() == "gyro's temperature (°C)"
    assert np.min(upper.lines[0].get_ydata()) == pytest.approx(-0.97)


def test_an_engineer_reads_what_to_do_where_parameters_moved_or_a_structure_has_no_name():
    def bench(diagnosis):
        told = Page(page_of(undrawn(diagnosis))).words
        return told[told.index("For the bench") : told.index("1 Where model and recording differ")]

    moved = bench(replace(nothing_missing(), verdict="recalibrate"))
    assert "Fit anew and use the new coefficients: benchctl fit" in moved
    strange = unknown_structure()
    assert "unexplained structure" in bench(strange)
    assert strange.next_experiment.says in bench(strange)


def test_an_effect_that_is_not_in_the_vocabulary_is_told_from_the_finding_alone():
    strange = replace(pair().findings[0], effect="coil_ringing")
    told = Page(page_of(undrawn(replace(pair(), findings=(strange,))))).words
    assert "1. Coil ringing" in told
    assert strange.says in told


@pytest.mark.slow
def test_the_page_needs_nothing_else_has_each_id_once_and_is_the_same_twice(pair_html):
    assert page_of(pair()) == pair_html
    page = Page(pair_html)
    assert page.refers_elsewhere() == []
    assert len(page.ids) == len(set(page.ids))
    assert "http" not in pair_html
    assert len(page.figures) == 3
    assert all(figure["aria-label"] for figure in page.figures)


def test_names_from_outside_cannot_run():
    wicked = "<script>x</script>"
    odd = replace(undrawn(pair()), recording=wicked, says=wicked, notes=(wicked,))
    html = page_of(odd, meta_of(serial=wicked))
    assert "<script" not in html
    assert wicked in Page(html).words


def test_a_diagnosis_with_nothing_to_draw_and_nothing_known_is_a_page_all_the_same():
    bare = replace(
        undrawn(pair()),
        findings=(),
        not_found=(),
        notes=(),
        baseline={},
        model={},
        fit=replace(pair().fit, noise=0.0, heldout_before=math.nan, heldout_after=math.nan),
    )
    page = Page(page_of(bare))
    assert page.figures == []
    assert "nan" not in page.words.split()
    assert "No effect that was added to the recording was found again" in page.words
    assert "Every effect that was looked for would have shown" in page.words


def test_slices_without_samples_are_drawn_empty():
    empty = Slice(
        coordinate="chamber_temp",
        edges=np.linspace(0, 1, 5),
        count=np.zeros(4),
        before=np.full(4, np.nan),
        after=np.full(4, np.nan),
        standard_error=np.full(4, np.nan),
        threshold=4.0,
    )
    assert significance(empty, empty.after) == 0.0
    assert (
        "chamber's temperature" not in Page(page_of(replace(undrawn(pair()), slices=(empty,)))).words.split("After:")[0]
    )


def test_the_figures_name_coordinates_units_and_times():
    one = pair()
    with style():
        panels = map_figure(one.slices, "V").axes
        assert [axes.get_xlabel() for axes in panels][:3] == ["time (s)", "rate (°/s)", "|rate| (°/s)"]
        assert {axes.get_ylabel() for axes in panels} == {"µV", "mV"}
        titles = [axes.get_title(loc="right") for axes in panels]
        assert all("→" in title for title in titles)
        (strip,) = steps_figure(one.steps, NOISE_V, "V").axes
        assert strip.get_yscale() == "log"
        assert strip.get_xticklabels()[-1].get_text() == "60\n54 min"
        left = traces_figure(one.traces, "V").axes[1]
        assert left.get_title(loc="left").startswith("rms ")


def test_significance_is_the_largest_mean_over_its_error():
    angle = next(one for one in pair().slices if one.coordinate == "angle")
    expected = np.nanmax(np.abs(angle.before) / angle.standard_error)
    assert significance(angle, angle.before) == pytest.approx(expected)
    assert significance(angle, angle.before) > angle.threshold > significance(angle, angle.after)


def test_sizes_are_told_in_the_multiple_that_reads_well():
    assert words.size(1.94e-3, "V") == "1.94\u00a0mV"
    assert words.size(-5.1e-4, "V") == "−510\u00a0µV"
    assert words.size(0.0421, "°/s") == "0.0421\u00a0°/s"
    assert words.size(2.5, "V") == "2.50\u00a0V"
    assert words.size(math.nan, "V") == "–\u00a0V"


def test_certainty_is_not_claimed():
    assert words.probability(1.0) == "> 99.9\u00a0%"
    assert words.probability(0.0) == "< 0.1\u00a0%"
    assert words.probability(0.985) == "98.5\u00a0%"


def test_ranges_without_an_end_read_as_below_and_above():
    where = dataclasses.replace(pair().findings[0].where, coordinate="acceleration", ranges=((300.0, math.inf),))
    assert "acceleration, above 300\u00a0°/s²;" in words.place(where, "V")
    below = dataclasses.replace(where, ranges=((-math.inf, -300.0),))
    assert "acceleration, below −300\u00a0°/s²;" in words.place(below, "V")


def test_lines_for_the_terminal_are_short_and_complete():
    told = list(lines(pair(), "V"))
    assert told[0].startswith("missing-physics: The data demand physics that the model does not have: thermal lag and")
    assert told[2].startswith("1. thermal_lag (99\u00a0%): The fibre coil is colder")
    assert "     tau_s = (591 ± 16)\u00a0s  [575, 606]" in told
    assert "     or else: thermal_hysteresis (1\u00a0%)" in told
    assert told[-1] == "  benchctl run temperature_sweep --bench bench.toml -p points=3"
    assert all(len(line) <= 100 for line in told)
    assert any(line.startswith("unexplained: What is left repeats") for line in lines(unknown_structure(), "V"))


def test_a_moved_model_is_told_by_its_parameters_as_they_were_and_are():
    moved = replace(nothing_missing(), verdict="recalibrate", says="The parameters have moved.")
    told = "\n".join(lines(moved, "V"))
    assert "K0_v_per_dps: 16.00000 × 10⁻³ V/(°/s) → (16.00320 ± 0.00030)" in told.replace("\u00a0", " ")
    page = Page(page_of(undrawn(moved))).words
    assert "K0_v_per_dps : 16.00000 × 10⁻³ V/(°/s) →" in page[: page.index("1 Where model")]


@pytest.mark.parametrize(
    ("effects", "word", "says"),
    [
        (("dropouts",), "Faulty data", "The data have faults, which are left out of all figures: dropouts."),
        (("flicker_noise",), "Noise not as modelled", "The noise differs from the model: flicker noise."),
        (
            ("thermal_lag", "outliers", "bias_drift"),
            "Physics is missing",
            "that the model does not have: thermal lag and bias drift. The data have faults,",
        ),
    ],
)
def test_faults_of_the_data_and_noise_are_not_called_missing_physics(effects, word, says):
    findings = tuple(replace(pair().findings[0], effect=name, alternatives=()) for name in effects)
    told = replace(pair(), findings=findings)
    assert chip(told) == word
    assert says in headline(told)


def test_a_fault_of_the_data_is_told_by_the_samples_that_it_spoils_and_has_no_before_and_after():
    lost = replace(pair().findings[0], effect="dropouts", explains=0.0039, gain_heldout=0.0, alternatives=())
    told = Page(page_of(undrawn(replace(pair(), findings=(lost,))))).words
    assert "Samples it spoils 0.39 % of all, left out before and after" in told
    assert "93 % of the samples that it spoils lies there" in told
    assert "Gain on held-out steps" not in told
    assert "Nothing else that is known" not in told
    assert "3 How well the model fits" in told
    assert "before → after" not in told


def test_spoilt_samples_are_marked_and_do_not_count():
    clean = pair().traces[0]
    spoilt = np.arange(clean.time_s.size) < 100
    broken = replace(clean, spoilt=spoilt, measured=np.where(spoilt, 7.0, clean.measured))
    with style():
        for trace in (clean, broken):
            output, left = traces_figure([trace], "V", changed=False).axes
            assert output.get_title(loc="left") == "ramp to +55 (held out)"
        assert max(np.nanmax(np.abs(line.get_ydata())) for line in left.lines) < 5.0
        assert [line.get_marker() for line in output.lines].count("x") == 1


@pytest.mark.parametrize(
    ("told", "printed"),
    [
        ("Run `diagnostic`: it moves gyro_temp*rate.", "Run diagnostic: it moves the gyro's temperature together"),
        ("it depends on time, most at -6.3 to 3.5 °C", "it depends on time, most at −6.3 to 3.5 °C"),
        ("along chamber_temp_rate it is 5e-08", "along the warming of the chamber it is 5\u00a0×\u00a010⁻⁸"),
        ("Run two_stage with rates_dps = 3", "Run two_stage with rates_dps = 3"),
        ("a file of 2026-11-20", "a file of 2026-11-20"),
    ],
)
def test_sentences_of_the_engine_read_as_prose(told, printed):
    assert words.prose(told).startswith(printed)


@pytest.mark.parametrize(
    ("unit", "printed"),
    [("1e-6", "ppm"), ("V s-0.5", "V/√s"), ("V s2 degree-1", "V/(°/s²)"), ("N m", "N\u00a0m"), ("degC-1", "°C⁻¹")],
)
def test_units_of_parameters_are_printed_as_they_are_said(unit, printed):
    assert words.unit(unit) == printed


def test_ranges_have_as_many_decimals_as_the_shortest_needs_and_the_unit_of_the_part():
    where = replace(pair().findings[0].where, coordinate="output", ranges=((-0.025, -0.012), (1.0, 1.3333)))
    assert "output, −0.025 to −0.012 and 1 to 1.333\u00a0N m;" in words.place(where, "N m")


@pytest.mark.slow
def test_a_long_diagnosis_becomes_a_page_without_a_hang():
    one = pair()
    many = tuple(replace(step, t_start=step.t_start + 3600.0 * k) for k in range(6) for step in one.steps)
    long = replace(one, steps=many, not_found=tuple(_absent(k) for k in range(40)))
    began = time.process_time()
    page = diagnosis_page(long, meta_of(), [INFO], digest="beef")
    assert time.process_time() - began < 10.0 * slowness()
    assert len(page.encode()) < 2_000_000


def test_an_estimate_that_was_chosen_has_no_interval():
    chosen = Estimate(value=2.0, low=2.0, high=2.0, unit="1")
    assert (words.estimate(chosen), words.interval(chosen)) == ("2", "–")
    open_ended = Estimate(value=80.0, low=60.0, high=math.inf, unit="Hz")
    assert words.estimate(open_ended) == "80.00\u00a0Hz"


def _absent(number):
    return NotFound(effect=f"effect_{number}", parameter="size", smallest=10.0**-number, unit="V")
