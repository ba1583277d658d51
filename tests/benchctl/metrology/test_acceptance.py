"""All tests of one recording: known values found, what is lacking said, strange recordings survived."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from benchctl.metrology.acceptance import accepted, measured_in
from benchctl.metrology.limit_file import limits_of_text, limits_template
from benchctl.metrology.names import PROCEDURES, UNITS
from benchctl.metrology.observations import Settings
from benchctl.metrology.result import Measured
from benchctl.plan import Soak, Step, set_points
from benchctl.plan.find import procedure_names
from benchctl.recordings.model import Step as Recorded
from benchctl.recordings.reader import Recording
from benchctl_instruments.errors import UsageError
from tests.benchctl.metrology.altered import Change, altered, nan_in, results, stating, without
from tests.benchctl.metrology.known_values import LINEARITY_PERCENT, known_values
from tests.benchctl.metrology.made_unit import Made, MadeUnit, recorded
from tests.benchctl.metrology.short_plans import IDEAL, QUIET, procedure, sines, soak, sweep
from tests.benchmarks.metric_coverage import FREQUENCIES_HZ, PARAMETERS, RATES, REST_S, SET_POINTS

SETTINGS = Settings(linearity_percent=LINEARITY_PERCENT)
PLAN = procedure("acceptance", **PARAMETERS)
EXACTLY = {
    "scale_factor": 1e-9,
    "nonlinearity": 1e-6,
    "nonlinearity_reading": 1e-6,
    "asymmetry": 1e-5,
    "input_range": 1e-6,
    "scale_factor_repeatability": 1e-5,
    "scale_factor_temperature": 1e-5,
    "hysteresis_rate": 1e-5,
    "hysteresis_temperature_scale": 2e-4,  # of a scale factor that changes with temperature, too
    "hysteresis_temperature_bias": 1e-4,
    "bias": 1e-5,
    "bias_repeatability": 1e-4,
    "bias_temperature": 1e-5,
    "bias_temperature_rate": 2e-4,
    "delay": 1e-7,
    "warm_up_time": 1e-5,
    "warm_up_bias": 1e-5,
    "bandwidth": 5e-4,  # by a spline between 1.9 and 2.1 Hz
    "threshold": 5e-3,  # between rates of 0.03 and 0.045 deg/s
    "dead_zone": 0.07,  # a bin
}
"""How near to the true values, relatively, the results of a unit without noise on a bench without errors come."""


@cache
def quiet() -> tuple[Recording, Made]:
    return recorded(PLAN, QUIET, 3, errors=False)


@cache
def of_quiet() -> Mapping[str, Measured]:
    return {one.name: one for one in measured_in(quiet()[0], SETTINGS)}


@cache
def of_ideal() -> Mapping[str, Measured]:
    return results(PLAN, IDEAL, settings=Settings())


@pytest.mark.parametrize("name", EXACTLY)
def test_without_noise_and_errors_every_test_finds_the_true_value(name: str) -> None:
    upward = set_points(-20.0, 60.0, SET_POINTS)
    known = known_values(quiet()[1], RATES, (*upward, *upward[-2:0:-1]), FREQUENCIES_HZ[0], REST_S)
    assert of_quiet()[name].value == pytest.approx(known[name], rel=EXACTLY[name])
    assert of_quiet()[name].bound == ""


def test_what_is_left_are_bounds_noises_and_an_angle_that_the_dead_zone_shortens() -> None:
    left = UNITS.keys() - EXACTLY.keys()
    noises = {
        "quantisation",
        "angle_random_walk",
        "bias_instability",
        "rate_random_walk",
        "rate_ramp",
        "bias_stability",
    }
    assert left == noises | {"resolution", "misalignment"}
    assert of_quiet()["resolution"].bound == "at most"
    unit = replace(QUIET, dead_dps=0.0, cubic_per_dps2=0.0, hysteresis=0.0)
    assert results(procedure("misalignment"), unit)["misalignment"].value == pytest.approx(3.0, rel=1e-5)


def test_the_results_come_in_the_order_of_the_report_each_in_its_unit() -> None:
    assert list(of_quiet()) == list(UNITS)
    for name, one in of_quiet().items():
        assert (one.name, one.unit) == (name, UNITS[name])
        assert (one.value is None) == (one.refused is not None)
        assert (one.value is None) == (one.uncertainty is None)


@pytest.mark.slow
def test_an_ideal_unit_has_bounds_and_sizes_that_cannot_be_told_from_zero() -> None:
    sizes = {
        "nonlinearity",
        "nonlinearity_reading",
        "asymmetry",
        "scale_factor_repeatability",
        "scale_factor_temperature",
        "hysteresis_rate",
        "hysteresis_temperature_scale",
        "hysteresis_temperature_bias",
        "bias_repeatability",
        "bias_temperature",
        "warm_up_bias",
    }
    for name in sizes:
        one = of_ideal()[name]
        assert one.uncertainty is not None, name
        assert one.value is not None
        assert one.uncertainty.says.key == "not_told_from_zero", name
        assert one.uncertainty.expanded >= one.value >= 0.0
    bounds = {name: one.bound for name, one in of_ideal().items() if one.bound}
    assert bounds == {
        "input_range": "at least",
        "threshold": "at most",
        "resolution": "at most",
        "dead_zone": "at most",
        "warm_up_time": "at most",
    }
    for name in ("misalignment", "bias_temperature_rate"):  # they have a sign, and zero inside their interval
        one = of_ideal()[name]
        assert one.uncertainty is not None
        assert one.value is not None
        assert abs(one.value) < 1.5 * one.uncertainty.expanded


def negated(step: Recorded) -> Recorded:
    """The gyro wired the other way round."""
    return Recorded(step.info, {name: -held if name == "gyro_v" else held for name, held in step.channels.items()})


@pytest.mark.slow
def test_a_gyro_wired_the_other_way_round_has_the_same_figures_and_a_negative_scale_factor() -> None:
    turned = {one.name: one for one in measured_in(altered(quiet()[0], negated), SETTINGS)}
    for name, one in of_quiet().items():
        sign = -1.0 if name == "scale_factor" else 1.0
        if one.value is None:
            assert turned[name].refused is not None
            continue
        assert turned[name].value == pytest.approx(sign * one.value, rel=1e-9), name
        assert turned[name].bound == one.bound
        assert one.uncertainty is not None
        assert turned[name].uncertainty is not None
        assert turned[name].uncertainty.expanded == pytest.approx(one.uncertainty.expanded, rel=0.03), name  # type: ignore[union-attr]


@pytest.mark.slow
def test_steps_of_a_converter_that_noise_does_not_blur_are_in_the_budgets() -> None:
    step_v = 20.0 / 2**12

    def rounded(step: Recorded) -> Recorded:
        held = {
            name: np.round(one / step_v) * step_v if name == "gyro_v" else one for name, one in step.channels.items()
        }
        return Recorded(step.info, held)

    recording, made = recorded(PLAN, MadeUnit(adc_bits=12), 3, errors=False)
    found = {one.name: one for one in measured_in(altered(recording, rounded), SETTINGS)}
    upward = set_points(-20.0, 60.0, SET_POINTS)
    known = known_values(made, RATES, (*upward, *upward[-2:0:-1]), FREQUENCIES_HZ[0], REST_S)
    for name in ("scale_factor", "nonlinearity", "asymmetry", "bias", "hysteresis_rate"):
        one = found[name]
        assert one.value is not None
        assert one.uncertainty is not None
        assert abs(one.value - known[name]) <= one.uncertainty.expanded, name
        assert "converter's steps" in {part.source for part in one.uncertainty.contributors[:2]}, name


ENOUGH: Mapping[str, tuple[Step, ...]] = {
    "rate_sweep": procedure("rate_sweep", top_rate_dps=100, rates=5),
    "temperature_sweep": procedure("temperature_sweep", points=3),
    "hysteresis": procedure("hysteresis", top_rate_dps=100, rates=5),
    "repeatability": procedure("repeatability", cycles=4),
    "small_rates": procedure("small_rates"),
    "thermal_hysteresis": procedure("thermal_hysteresis", points=3),
    "thermal_ramps": procedure("thermal_ramps"),
    "misalignment": procedure("misalignment"),
    "warm_up": procedure("warm_up"),
    "stability": procedure("stability", rest_s=900),
    "frequency_response": procedure("frequency_response", frequencies_hz="0.5,1,2,4"),
}
"""The procedures that tests name, of small size."""


def test_every_procedure_that_a_test_names_is_there() -> None:
    assert set(PROCEDURES.values()) == ENOUGH.keys()
    assert ENOUGH.keys() <= set(procedure_names())


@pytest.mark.parametrize("name", ENOUGH)
def test_a_recording_of_the_procedure_that_a_test_names_holds_what_it_needs(name: str) -> None:
    found = results(ENOUGH[name], MadeUnit())
    for test, procedure_name in PROCEDURES.items():
        if procedure_name != name:
            continue
        lacking = found[test].refused
        assert lacking is None or lacking.key == "term_refused", test  # a noise that does not show
        assert lacking is not None or found[test].value is not None


def test_the_acceptance_holds_what_every_test_needs() -> None:
    found = results(PLAN, MadeUnit())
    assert {one.refused.key for one in found.values() if one.refused is not None} <= {"term_refused"}


def test_a_calibration_campaign_is_accepted_by_what_it_holds() -> None:
    found = results(procedure("two_stage", points=3), MadeUnit())
    measured = {name for name, one in found.items() if one.value is not None}
    assert measured >= {"scale_factor", "nonlinearity", "asymmetry", "bias", "delay", "scale_factor_temperature"}
    assert found["bandwidth"].bound == "at least"
    assert {one.refused.key for one in found.values() if one.refused is not None} == {
        "needs_power_cycles",
        "needs_up_and_down",
        "needs_both_legs",
        "needs_small_rates",
        "needs_rate_steps",
        "needs_slow_swing",
        "needs_long_rest",
        "needs_ramps",
        "needs_across",
        "needs_power_on",
    }


SMALL = [soak(), *sweep(), *sines((0.5, 1.0, 2.0))]


@cache
def of_small() -> Measured:
    """Its scale factor, where nothing is lacking."""
    return results(SMALL, MadeUnit())["scale_factor"]


@pytest.mark.parametrize(
    "change",
    [
        stating(chamber_setpoint_c=float("nan")),
        without("gyro_temp_c"),
        stating(rate_dps=None),
        stating(frequency_hz=None, amplitude_dps=None),
        nan_in("gyro_temp_c", "constant_rate"),
        nan_in("gyro_v", "static"),
    ],
    ids=["no-set-points", "no-thermistor", "no-rates-stated", "no-frequencies", "thermistor-lost", "rest-lost"],
)
def test_a_foreign_recording_that_states_less_still_has_a_scale_factor(change: object) -> None:
    found = results(SMALL, MadeUnit(), change=change)["scale_factor"]  # type: ignore[arg-type]
    assert found.value == pytest.approx(of_small().value, rel=1e-5)


@pytest.mark.slow
def test_what_no_thermometer_measured_has_no_temperature() -> None:
    def neither(step: Recorded) -> Recorded:
        bare = without("gyro_temp_c")(step)
        return Recorded(replace(bare.info, chamber_setpoint_c=float("nan")), bare.channels)

    found = results([*SMALL[:-3], *procedure("acceptance", **PARAMETERS)], QUIET, change=neither)
    assert {one.temperature_c for one in found.values()} == {None}
    assert found["scale_factor"].value is not None


@pytest.mark.parametrize(
    ("recording", "says"),
    [
        (lambda: altered(recorded(SMALL, QUIET, 1)[0], stating(kind="static_points")), "no complete step at rest"),
        (lambda: altered(recorded(SMALL, QUIET, 1)[0], stating(whole=False)), "no complete step at rest"),
        (lambda: altered(recorded(SMALL, QUIET, 1)[0], without("gyro_v")), "gyro_v"),
        (lambda: recorded([Soak(setpoint_c=20.0, hold_s=9.0)], QUIET, 1)[0], "no complete step at rest"),
        (lambda: recorded(sines((0.5, 1.0, 2.0)), QUIET, 1)[0], "`benchctl run acceptance` records"),
    ],
    ids=["static-points", "cut", "no-output", "soak", "swings"],
)
def test_a_recording_without_a_reading_is_refused_in_one_line(recording: object, says: str) -> None:
    with pytest.raises(UsageError) as caught:
        measured_in(recording(), Settings())  # type: ignore[operator]
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def outputs(change: Callable[[np.ndarray], np.ndarray]) -> Change:
    """Every step with another output."""
    return lambda step: Recorded(
        step.info, {name: change(held) if name == "gyro_v" else held for name, held in step.channels.items()}
    )


@pytest.mark.parametrize("volts", [0.0, 5.1])
def test_an_output_that_never_changes_is_no_gyros(volts: float) -> None:
    with pytest.raises(UsageError, match="at every rate; check that the unit is connected and on"):
        results(PLAN, QUIET, change=outputs(lambda held: np.full_like(held, volts)))


@pytest.mark.slow
def test_a_dead_unit_that_only_makes_noise_fails_and_nothing_breaks() -> None:
    dead, _ = recorded(PLAN, replace(IDEAL, K_v_per_dps=0.0), 3, errors=False)
    found = accepted(dead, LIMITS)
    assert found.verdict == "FAIL"
    assert next(one for one in found.judged if one.measured.name == "scale_factor").verdict == "FAIL"


@pytest.mark.parametrize("unit", [replace(IDEAL, white_v_per_sqrt_hz=0.0, walk_v_per_sqrt_s=0.0), IDEAL])
@pytest.mark.parametrize("step_v", [1e-12, 20.0 / 2**12])
@pytest.mark.slow
def test_noise_that_a_converters_step_hides_is_no_reason_to_stop(unit: MadeUnit, step_v: float) -> None:
    found = results(PLAN, unit, change=outputs(lambda held: step_v * np.round(held / step_v)))
    assert found["scale_factor"].value == pytest.approx(50.0, rel=1e-3)


def test_the_scale_factor_of_an_output_that_is_a_rate_is_a_number() -> None:
    made = recorded(SMALL, QUIET, 1)[0]
    digital = altered(made, lambda step: step, replace(made.meta, extra={"gyro_output_unit": "deg/s"}))
    volts, rates = measured_in(made, Settings())[0], measured_in(digital, Settings())[0]
    assert volts.value is not None
    assert (volts.unit, rates.unit, rates.value) == ("mV/(deg/s)", "1", pytest.approx(1e-3 * volts.value))
    assert [column.unit for column in rates.table] == ["deg/s", "deg/s"]
    assert rates.picture is not None
    assert (rates.picture.x_unit, rates.picture.y_unit) == ("deg/s", "deg/s")
    own = limits_of_text('[limits.scale_factor]\nlow = 0.049\nhigh = 0.051\nunit = "1"', Path("digital.toml"))
    assert accepted(digital, own).verdict == "PASS"
    with pytest.raises(UsageError, match='the output of this unit is a rate; state the limit with unit = "1"'):
        accepted(digital, LIMITS)
    with pytest.raises(UsageError, match='in volts; state the limit with unit = "mV/'):
        accepted(made, own)


LIMITS = limits_of_text(limits_template(), Path("lab/limits.toml"))


def test_an_acceptance_judges_every_test_and_keeps_what_it_judged_by() -> None:
    found = accepted(quiet()[0], LIMITS)
    assert [one.measured.name for one in found.judged] == list(UNITS)
    assert {one.measured.name for one in found.judged if one.verdict is None} == UNITS.keys() - LIMITS.limits.keys()
    assert (found.limits_name, found.limits_sha256, found.limits_text) == (
        "limits.toml",
        LIMITS.sha256,
        LIMITS.text,
    )
    assert found.verdict == "FAIL"  # 49.9 mV/(deg/s) is none of the simulated gyro
    assert next(one for one in found.judged if one.measured.name == "scale_factor").verdict == "FAIL"
    assert found.anomalies == ()


def test_what_is_amiss_with_a_recording_is_said() -> None:
    made = recorded(SMALL, QUIET, 1)[0]
    meta = replace(made.meta, status="interrupted")

    def spoilt(step: Recorded) -> Recorded:
        return Recorded(
            replace(step.info, whole=step.info.index != 3, gaps=2 * (step.info.index == 4), digest="abc"), step.channels
        )

    odd = altered(made, spoilt, meta)
    odd.digest = ""
    found = accepted(odd, LIMITS)
    assert [one.key for one in found.anomalies] == ["not_complete", "no_digest", "not_whole", "gaps"]
    assert found.anomalies[2].values == {"step": odd.infos[2].name}
    assert found.anomalies[3].values == {"step": odd.infos[3].name, "count": 2}
    assert found.step_digests == {info.index: "abc" for info in odd.infos}
    foreign = accepted(altered(made, lambda step: step, replace(made.meta, status="imported")), LIMITS)
    assert [one.key for one in foreign.anomalies] == ["foreign"]


def test_steps_that_a_result_names_are_steps_of_the_recording() -> None:
    indices = {info.index for info in quiet()[0].infos}
    for one in of_quiet().values():
        assert set(one.steps) <= indices
        assert one.steps or one.value is None
        assert list(one.steps) == sorted(set(one.steps))
        for trace in one.picture.traces if one.picture else ():
            assert np.isfinite(trace.x).all()
            assert np.isfinite(trace.y).all()
            assert trace.standard is None or (trace.standard >= 0.0).all()


def test_points_have_the_scatter_of_their_readings_and_the_stated_errors_as_bars() -> None:
    recording = recorded(SMALL, IDEAL, 1)[0]
    picture = next(one.picture for one in measured_in(recording, Settings()) if one.name == "nonlinearity")
    assert picture is not None
    (trace,) = picture.traces
    assert trace.standard is not None
    assert trace.standard.shape == trace.y.shape
    assert picture.limited == "y"
    assert np.max(np.abs(trace.y)) == next(
        one.value for one in measured_in(recording, Settings()) if one.name == "nonlinearity"
    )
