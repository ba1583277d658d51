import math

import pytest

from benchctl.metrology.rerun import Compared, compared
from benchctl.metrology.result import Bound, Judged, Limit, Measured, Uncertainty, Verdict, message

PPM = Limit(low=None, high=100.0, unit="ppm")


def _judged(
    value: float | None,
    expanded: float | None = None,
    *,
    verdict: Verdict | None = None,
    bound: Bound = "",
    name: str = "asymmetry",
    unit: str = "ppm",
) -> Judged:
    uncertainty = None
    if expanded is not None:
        agrees = message("gum_agrees", difference_percent=0.0)
        uncertainty = Uncertainty(
            standard=expanded / 2, expanded=expanded, monte_carlo=expanded, contributors=(), says=agrees
        )
    measured = Measured(name=name, unit=unit, value=value, uncertainty=uncertainty, bound=bound)
    return Judged(measured=measured, limit=PPM if verdict else None, verdict=verdict)


def _one(first: Judged, again: Judged) -> Compared:
    (found,) = compared([first], [again])
    return found


def test_a_difference_has_the_uncertainty_of_both_and_e_n_is_over_it() -> None:
    found = _one(_judged(10.0, 3.0), _judged(14.0, 4.0))
    assert found.difference == 4.0
    assert found.uncertainty == 5.0
    assert found.e_n == pytest.approx(0.8)
    assert not found.differs


@pytest.mark.parametrize(("again", "differs"), [(15.0, False), (15.1, True), (4.9, True)])
def test_it_differs_beyond_one_in_either_direction(again: float, differs: bool) -> None:
    found = _one(_judged(10.0, 3.0), _judged(again, 4.0))
    assert found.differs is differs
    assert found.e_n is not None
    assert math.copysign(1.0, found.e_n) == math.copysign(1.0, again - 10.0)


def test_without_an_uncertainty_there_is_a_difference_and_no_e_n() -> None:
    found = _one(_judged(10.0), _judged(14.0, 4.0))
    assert (found.difference, found.uncertainty, found.e_n, found.differs) == (4.0, None, None, False)
    assert _one(_judged(10.0, 0.0), _judged(14.0, 0.0)).e_n is None


def test_a_value_that_only_one_run_has_differs() -> None:
    found = _one(_judged(None), _judged(14.0, 4.0))
    assert found.differs
    assert found.is_told
    assert found.difference is None


def test_bounds_are_not_subtracted_and_differ_from_values_only() -> None:
    assert _one(_judged(10.0, 1.0, bound="at least"), _judged(99.0, 1.0, bound="at least")).difference is None
    assert not _one(_judged(10.0, 1.0, bound="at least"), _judged(99.0, 1.0, bound="at least")).differs
    assert _one(_judged(10.0, 1.0, bound="at least"), _judged(10.0, 1.0)).differs


def test_a_changed_verdict_is_seen_and_none_is_no_change() -> None:
    assert _one(_judged(10.0, 1.0, verdict="PASS"), _judged(120.0, 1.0, verdict="FAIL")).verdict_changed
    assert not _one(_judged(10.0, 1.0), _judged(120.0, 1.0)).verdict_changed


def test_nothing_is_said_of_what_neither_holds_unless_it_has_a_limit() -> None:
    assert not _one(_judged(None), _judged(None)).is_told
    assert _one(_judged(None, verdict="INCONCLUSIVE"), _judged(None, verdict="INCONCLUSIVE")).is_told


def test_other_tests_and_other_units_are_not_compared() -> None:
    with pytest.raises(ValueError, match="asymmetry in ppm is not bias in ppm"):
        compared([_judged(1.0)], [_judged(1.0, name="bias")])
    with pytest.raises(ValueError, match="is not asymmetry in %"):
        compared([_judged(1.0)], [_judged(1.0, unit="%")])
    with pytest.raises(ValueError, match="shorter"):
        compared([_judged(1.0), _judged(1.0)], [_judged(1.0)])
