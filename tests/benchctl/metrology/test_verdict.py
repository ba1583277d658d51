"""Values against limits: guard bands by hand, bounds, remedies, and the risk that is promised."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from benchctl.calibration.result import Contribution
from benchctl.calibration.uncertainty import K
from benchctl.metrology.result import (
    Bound,
    Column,
    Judged,
    Limit,
    Measured,
    Picture,
    Trace,
    Uncertainty,
    Verdict,
    message,
)
from benchctl.metrology.verdict import in_unit, judged, overall, rule_of

GUARDED, SIMPLE = rule_of(1.0), rule_of(0.0)


def uncertainty(scatter: float, other: float = 0.0, *, expanded: float | None = None) -> Uncertainty:
    standard = float(np.hypot(scatter, other))
    return Uncertainty(
        standard=standard,
        expanded=K * standard if expanded is None else expanded,
        monte_carlo=K * standard,
        contributors=(
            Contribution(source="scatter", standard=scatter, kind="A", says="made"),
            Contribution(source="thermometer", standard=0.6 * other, kind="B", says="made"),
            Contribution(source="clock", standard=0.8 * other, kind="B", says="made"),
        ),
        says=message("gum_agrees", difference_percent=0.0),
    )


def bias(value: float, *, U: float = 1.0, bound: Bound = "") -> Measured:
    return Measured(name="bias", unit="deg/h", value=value, uncertainty=uncertainty(U / K), bound=bound)


def limit(low: float | None = None, high: float | None = None, unit: str = "deg/h") -> Limit:
    return Limit(low=low, high=high, unit=unit)


def verdict(value: float, low: float | None, high: float | None, *, bound: Bound = "", guard: float = 1.0) -> Verdict:
    found = judged(bias(value, bound=bound), limit(low, high), rule_of(guard)).verdict
    assert found is not None
    return found


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (-6.01, "FAIL"),
        (-6.0, "INCONCLUSIVE"),  # an expanded uncertainty below the limit it may still lie on it
        (-5.0, "INCONCLUSIVE"),
        (-4.01, "INCONCLUSIVE"),
        (-4.0, "PASS"),
        (0.0, "PASS"),
        (4.0, "PASS"),
        (4.01, "INCONCLUSIVE"),
        (5.0, "INCONCLUSIVE"),
        (6.0, "INCONCLUSIVE"),
        (6.01, "FAIL"),
    ],
)
def test_the_guard_band_is_inside_the_limits_for_acceptance_and_outside_for_rejection(
    value: float, expected: Verdict
) -> None:
    assert verdict(value, -5.0, 5.0) == expected
    if value >= 0.0:
        assert verdict(value, None, 5.0) == expected
    if value <= 0.0:
        assert verdict(value, -5.0, None) == expected


@pytest.mark.parametrize(("value", "expected"), [(4.5, "PASS"), (4.51, "INCONCLUSIVE"), (5.5, "INCONCLUSIVE")])
def test_the_band_is_as_wide_as_the_rule_says(value: float, expected: Verdict) -> None:
    assert verdict(value, -5.0, 5.0, guard=0.5) == expected
    assert verdict(5.51, -5.0, 5.0, guard=0.5) == "FAIL"


def test_limits_nearer_than_the_band_never_pass() -> None:
    assert verdict(0.0, -0.9, 0.9) == "INCONCLUSIVE"


@pytest.mark.parametrize(("value", "expected"), [(5.0, "PASS"), (5.0001, "FAIL"), (-5.0, "PASS"), (-5.0001, "FAIL")])
def test_without_a_band_the_value_alone_counts_and_the_ends_are_inside(value: float, expected: Verdict) -> None:
    assert verdict(value, -5.0, 5.0, guard=0.0) == expected


@pytest.mark.parametrize(
    ("value", "bound", "low", "high", "expected"),
    [
        # at least 10: more than a minimum of 8 for sure, perhaps more than one of 20, and no word on a maximum of 20
        (10.0, "at least", 8.0, None, "PASS"),
        (10.0, "at least", 20.0, None, "INCONCLUSIVE"),
        (10.0, "at least", None, 20.0, "INCONCLUSIVE"),
        (10.0, "at least", 8.0, 20.0, "INCONCLUSIVE"),
        (10.0, "at least", None, 8.0, "FAIL"),  # at least 10 is more than 8, however much it is
        (10.0, "at most", None, 20.0, "PASS"),
        (10.0, "at most", None, 8.0, "INCONCLUSIVE"),
        (10.0, "at most", 8.0, None, "INCONCLUSIVE"),
        (10.0, "at most", 8.0, 20.0, "INCONCLUSIVE"),
        (10.0, "at most", 20.0, None, "FAIL"),
    ],
)
def test_a_bound_decides_only_what_lies_on_its_side(
    value: float, bound: Bound, low: float | None, high: float | None, expected: Verdict
) -> None:
    assert verdict(value, low, high, bound=bound) == expected
    assert verdict(value, low, high, bound=bound, guard=0.0) == expected


@given(value=st.floats(-1e3, 1e3), high=st.floats(-1e3, 1e3), guard=st.floats(0.0, 3.0))
def test_at_least_never_passes_a_maximum_and_at_most_never_a_minimum(value: float, high: float, guard: float) -> None:
    assert verdict(value, None, high, bound="at least", guard=guard) != "PASS"
    assert verdict(value, high, None, bound="at most", guard=guard) != "PASS"
    assert verdict(value, high, None, bound="at least", guard=guard) != "FAIL"
    assert verdict(value, None, high, bound="at most", guard=guard) != "FAIL"


def test_a_bound_that_decides_nothing_asks_for_the_procedure_that_goes_further() -> None:
    found = judged(bias(10.0, bound="at least"), limit(high=20.0), GUARDED)
    assert found.remedy == message("run_procedure", procedure="stability")


def test_a_test_that_was_refused_is_open_and_names_the_procedure_that_measures_it() -> None:
    measured = Measured(name="hysteresis_rate", unit="ppm", refused=message("needs_up_and_down"))
    found = judged(measured, limit(high=1.0, unit="%"), GUARDED)
    assert (found.verdict, found.remedy) == ("INCONCLUSIVE", message("run_procedure", procedure="hysteresis"))
    assert (found.measured.value, found.measured.unit) == (None, "%")


def test_without_a_limit_there_is_no_verdict_and_the_unit_stays() -> None:
    found = judged(bias(1.0), None, GUARDED)
    assert (found.verdict, found.limit, found.remedy, found.measured.unit) == (None, None, None, "deg/h")


def test_a_result_is_judged_and_stated_in_the_limits_unit() -> None:
    found = judged(bias(3600.0, U=360.0), limit(high=1.2, unit="deg/s"), GUARDED)
    assert found.verdict == "PASS"
    assert found.measured.value == pytest.approx(1.0)
    told = found.measured.uncertainty
    assert told is not None
    assert (told.expanded, told.standard, told.monte_carlo) == pytest.approx((0.1, 0.05, 0.1))
    assert told.contributors[0].standard == pytest.approx(0.05)
    assert found.measured.unit == "deg/s"
    assert in_unit(found.measured, "deg/h").value == pytest.approx(3600.0)


def test_points_and_plot_of_a_result_are_in_the_limits_unit_too() -> None:
    ppm = np.array([100.0, -300.0])
    columns = (
        Column(name="rate", unit="deg/s", values=(1.0, 2.0)),
        Column(name="misfit", unit="ppm", values=(100.0, -300.0)),
    )
    trace = Trace(label="misfit", x=np.array([1.0, 2.0]), y=ppm, standard=np.array([10.0, 20.0]))
    picture = Picture(x="rate", x_unit="deg/s", y="misfit", y_unit="ppm", traces=(trace,), limited="y")
    measured = Measured(name="nonlinearity", unit="ppm", value=300.0, table=columns, picture=picture)
    found = in_unit(measured, "%")
    assert [one.unit for one in found.table] == ["deg/s", "%"]
    assert found.table[1].values == pytest.approx((0.01, -0.03))
    assert found.picture is not None
    assert (found.picture.x_unit, found.picture.y_unit) == ("deg/s", "%")
    assert found.picture.traces[0].x == pytest.approx([1.0, 2.0])
    assert found.picture.traces[0].y == pytest.approx([0.01, -0.03])
    assert found.picture.traces[0].standard == pytest.approx([0.001, 0.002])


def test_the_worst_of_all_verdicts_is_that_of_the_unit() -> None:
    def made(*verdicts: Verdict | None) -> tuple[Judged, ...]:
        return tuple(Judged(measured=bias(0.0), limit=None, verdict=one) for one in verdicts)

    assert overall(made("PASS", None, "PASS")) == "PASS"
    assert overall(made("PASS", "INCONCLUSIVE", None)) == "INCONCLUSIVE"
    assert overall(made("INCONCLUSIVE", "FAIL", "PASS")) == "FAIL"
    assert overall(made(None)) == "PASS"


def test_the_rule_states_its_band_and_its_risk() -> None:
    assert SIMPLE.says.key == "rule_simple"
    assert GUARDED.says.values["guard"] == 1.0
    assert GUARDED.says.values["risk_percent"] == pytest.approx(2.275, abs=0.001)
    assert rule_of(0.5).says.values["risk_percent"] == pytest.approx(15.87, abs=0.01)


@pytest.mark.parametrize("true", [5.0, -5.0])
@pytest.mark.slow
def test_a_unit_at_its_limit_is_accepted_and_rejected_as_often_as_is_promised(true: float) -> None:
    values = true + 0.5 * np.random.default_rng(11).standard_normal(20_000)
    found = [judged(bias(float(value)), limit(-5.0, 5.0), GUARDED).verdict for value in values]
    for wrong in ("PASS", "FAIL"):
        assert found.count(wrong) / len(found) == pytest.approx(0.02275, abs=0.004)


@pytest.mark.slow
def test_a_bad_unit_is_never_more_often_accepted_than_one_at_the_limit() -> None:
    values = 5.5 + 0.5 * np.random.default_rng(12).standard_normal(20_000)
    found = [judged(bias(float(value)), limit(-5.0, 5.0), GUARDED).verdict for value in values]
    assert found.count("PASS") / len(found) < 0.0035  # three deviations beyond: 0.13 %


def longer(measured: Measured, times: float) -> Measured:
    """The same value with its scatter averaged over so many times the length."""
    told = measured.uncertainty
    assert told is not None
    stated = told.expanded / (K * told.standard)
    parts = tuple(
        replace(one, standard=one.standard / np.sqrt(times)) if one.kind == "A" else one for one in told.contributors
    )
    standard = float(np.sqrt(sum(one.standard**2 for one in parts)))
    return replace(
        measured,
        uncertainty=replace(told, contributors=parts, standard=standard, expanded=stated * K * standard),
    )


@given(
    value=st.floats(-20.0, 20.0),
    scatter=st.floats(0.01, 5.0),
    other=st.floats(0.0, 2.0),
    guard=st.floats(0.1, 2.0),
    stated=st.sampled_from([1.0, 1.4, 0.8]),
    sides=st.sampled_from([(-5.0, 5.0), (None, 5.0), (-5.0, None)]),
)
def test_measuring_so_many_times_as_long_makes_it_conclusive_and_one_time_less_does_not(
    value: float,
    scatter: float,
    other: float,
    guard: float,
    stated: float,
    sides: tuple[float | None, float | None],
) -> None:
    """`stated`: by Monte Carlo an interval may be wider or narrower than twice the combined uncertainty."""
    told = uncertainty(scatter, other)
    measured = replace(bias(value), uncertainty=replace(told, expanded=stated * told.expanded))
    rule, limits = rule_of(guard), limit(*sides)
    found = judged(measured, limits, rule)
    assume(found.verdict == "INCONCLUSIVE")
    assert found.remedy is not None
    if found.remedy.key == "longer":
        times = float(found.remedy.values["times"])
        assert times >= 2
        assert judged(longer(measured, times * (1 + 1e-9)), limits, rule).verdict != "INCONCLUSIVE"
        if times > 2:
            assert judged(longer(measured, (times - 1) * (1 - 1e-9)), limits, rule).verdict == "INCONCLUSIVE"
    elif found.remedy.key == "better_instrument":
        assert found.remedy.values["source"] == "clock"  # the larger of the two
        assert judged(longer(measured, 1e12), limits, rule).verdict == "INCONCLUSIVE"
    else:
        assert found.remedy.key == "too_near"
        assert judged(longer(measured, 9_999), limits, rule).verdict == "INCONCLUSIVE"  # nobody measures longer


def test_a_value_on_its_limit_cannot_be_told_from_it_by_any_measurement() -> None:
    assert judged(bias(5.0), limit(high=5.0), GUARDED).remedy == message("too_near")


def test_a_guard_band_that_would_end_on_the_limit_is_not_narrow_enough_to_reject() -> None:
    """Four times as long the band would end on the limit, which an accepted unit may lie on."""
    found = judged(bias(5.5), limit(high=5.0), GUARDED)
    assert found.remedy == message("longer", times=5, source="scatter")


def test_an_interval_that_no_contribution_explains_asks_for_the_procedure() -> None:
    told = replace(uncertainty(0.0), expanded=2.0)
    found = judged(replace(bias(4.0), uncertainty=told), limit(high=5.0), GUARDED)
    assert (found.verdict, found.remedy) == ("INCONCLUSIVE", message("run_procedure", procedure="stability"))
