"""The law of propagation and Monte Carlo, against results that others have published.

JCGM 101:2008, 9.2 (additive model) and 9.4 (comparison loss); JCGM 100:2008 (GUM), 5.2.2 (resistors) and H.1 (gauge).
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import chi2

from benchctl.calibration.uncertainty import K, coverage_factor
from benchctl.metrology import propagation
from benchctl.metrology.propagation import (
    Offsets,
    Quantity,
    as_read,
    deviation_of,
    independent,
    largest_of,
    nothing,
    propagated,
    scattered,
    single,
)
from benchctl_instruments.arrays import FloatArray


def four(*standards: float, uniform: bool) -> list[Quantity]:
    return [single(f"x{k}", standard, "published", uniform=uniform) for k, standard in enumerate(standards)]


def total(offsets: Offsets) -> FloatArray:
    return np.sum([offset[:, 0] for offset in offsets.values()], axis=0)


@pytest.fixture
def published(monkeypatch: pytest.MonkeyPatch) -> None:
    """Intervals of 95 % by a million draws, as the guide has them."""
    monkeypatch.setattr(propagation, "LEVEL", 0.95)
    monkeypatch.setattr(propagation, "_DRAWS", 1_000_000)


@pytest.mark.usefixtures("published")
@pytest.mark.parametrize(
    ("standards", "uniform", "deviation", "half_width"),
    [
        ((1.0, 1.0, 1.0, 1.0), False, 2.0, 3.92),
        ((1.0, 1.0, 1.0, 1.0), True, 2.0, 3.88),
        ((1.0, 1.0, 1.0, 10.0), True, 10.1, 17.0),
    ],
)
def test_the_additive_model_has_the_published_deviations_and_intervals(
    standards: tuple[float, ...], uniform: bool, deviation: float, half_width: float
) -> None:
    found = propagated(total, four(*standards, uniform=uniform))
    assert found.standard == pytest.approx(deviation, rel=0.005)  # the guide has three digits
    assert found.monte_carlo == pytest.approx(half_width, rel=0.003)


def test_the_interval_stated_is_twice_the_standard_uncertainty_where_the_two_ways_agree() -> None:
    found = propagated(total, four(1.0, 1.0, 1.0, 1.0, uniform=False))
    assert found.expanded == K * found.standard == pytest.approx(4.0)
    assert found.says.key == "gum_agrees"
    assert found.says.values["difference_percent"] == pytest.approx(100 * abs(4.0 / found.monte_carlo - 1.0))


def test_a_wide_rectangle_is_stated_by_monte_carlo_which_knows_its_ends() -> None:
    found = propagated(total, four(1.0, 1.0, 1.0, 10.0, uniform=True))
    assert found.expanded < 0.9 * K * found.standard
    assert found.expanded == pytest.approx(found.monte_carlo, rel=0.02)


def test_the_end_gauge_of_the_gum_is_known_to_32_nm_and_by_its_second_order_to_34_nm() -> None:
    length_nm, expansion = 50_000_623.0, 11.5e-6
    quantities = [
        single("standard", 25.0, "certificate"),
        single("difference", 9.7, "comparator", kind="A"),
        single("expansion", 1.2e-6, "rectangle"),
        single("temperature", 0.41, "bed"),
        single("difference of expansion", 0.58e-6, "rectangle"),
        single("difference of temperature", 0.029, "rectangle"),
    ]

    def deviation_nm(offsets: Offsets) -> FloatArray:
        standard, difference, alpha, theta, d_alpha, d_theta = (offset[:, 0] for offset in offsets.values())
        warmth = d_alpha * (theta - 0.1) + (expansion + alpha) * d_theta
        return np.asarray(standard + difference - (length_nm + standard) * warmth)

    found = propagated(deviation_nm, quantities)
    assert found.standard == pytest.approx(math.sqrt(1002.0), rel=0.002)
    assert [(one.source, round(one.standard, 1)) for one in found.contributors] == [
        ("standard", 25.0),
        ("difference of temperature", 16.7),  # 16.6 in the guide, which rounds in between
        ("difference", 9.7),
        ("difference of expansion", 2.9),
        ("expansion", 0.0),
        ("temperature", 0.0),
    ]
    assert found.monte_carlo / K == pytest.approx(34.0, rel=0.02)
    assert found.says.key == "not_linear"
    assert found.expanded >= found.monte_carlo


def test_ten_resistors_by_one_standard_err_together() -> None:
    alike = scattered("resistors", np.full((10, 10), 0.1**2), "one standard")
    apart = scattered("resistors", 0.1**2 * np.eye(10), "ten standards")

    def ohms(offsets: Offsets) -> FloatArray:
        return 1000.0 + offsets["resistors"].sum(axis=1)

    assert propagated(ohms, [alike]).standard == pytest.approx(1.0)
    assert propagated(ohms, [apart]).standard == pytest.approx(0.32, abs=0.005)
    assert propagated(ohms, [alike]).monte_carlo == pytest.approx(2.0, rel=0.03)


def test_numbers_that_err_together_cancel_in_their_difference() -> None:
    covariance = np.array([[4.0, 3.0], [3.0, 9.0]])
    quantity = scattered("both", covariance, "made")

    def difference(offsets: Offsets) -> FloatArray:
        return np.asarray(offsets["both"] @ [1.0, -1.0])

    found = propagated(difference, [quantity])
    assert found.standard == pytest.approx(math.sqrt(4.0 + 9.0 - 2 * 3.0))
    assert found.contributors[0].kind == "A"
    assert np.cov(quantity.drawn(np.random.default_rng(1), 200_000).T) == pytest.approx(covariance, rel=0.02)


def test_a_covariance_of_too_low_a_rank_is_taken_as_it_is() -> None:
    root = np.array([[1.0, 2.0, 3.0]])
    quantity = scattered("three", root.T @ root, "one cause")
    assert quantity.root @ quantity.root.T == pytest.approx(root.T @ root)


def test_the_loss_of_a_comparison_is_no_straight_function_and_says_so() -> None:
    """At x1 = x2 = 0 the law of propagation finds nothing at all, JCGM 101, 9.4.2.2."""
    pair = independent("x", np.full(2, 0.005), "published")

    def loss(offsets: Offsets) -> FloatArray:
        return np.asarray((offsets["x"] ** 2).sum(axis=1))

    found = propagated(loss, [pair])
    assert found.standard == 0.0
    assert found.says.key == "not_linear"
    high = 0.005**2 * chi2.ppf(0.5 * (1.0 + propagation.LEVEL), 2)
    assert found.expanded == pytest.approx(high, rel=0.05)


def test_contributors_come_sorted_and_make_the_combined_uncertainty() -> None:
    quantities = [single("small", 1.0, "a"), single("large", 4.0, "b", kind="A"), single("middle", 2.0, "c")]
    found = propagated(total, quantities)
    assert [(one.source, one.kind, one.says) for one in found.contributors] == [
        ("large", "A", "b"),
        ("middle", "B", "c"),
        ("small", "B", "a"),
    ]
    assert [one.standard for one in found.contributors] == pytest.approx([4.0, 2.0, 1.0])
    assert found.standard == pytest.approx(math.sqrt(21.0))


def test_it_is_the_same_every_time() -> None:
    quantities = four(1.0, 2.0, 3.0, 4.0, uniform=True)
    assert propagated(total, quantities) == propagated(total, quantities)


def test_a_rectangle_ends_at_the_root_of_three_deviations() -> None:
    drawn = single("x", 2.0, "a", uniform=True).drawn(np.random.default_rng(1), 100_000)
    assert np.std(drawn) == pytest.approx(2.0, rel=0.01)
    assert np.max(np.abs(drawn)) == pytest.approx(2.0 * math.sqrt(3.0), rel=0.001)


def test_a_function_is_read_without_offsets() -> None:
    quantity = independent("x", np.array([1.0, 1.0]), "a")
    assert as_read(lambda offsets: 3.0 + offsets["x"], [quantity]) == pytest.approx([3.0, 3.0])


def noisy(values: list[float], standard: float) -> tuple[propagation.Function, list[Quantity]]:
    quantity = independent("scatter", np.full(len(values), standard), "made")
    return (lambda offsets: np.array(values) + offsets["scatter"]), [quantity]


def test_the_largest_of_changes_that_stand_out_is_known_like_one_of_them() -> None:
    value, found = largest_of(*noisy([1.0, -50.0, 3.0], 1.0))
    assert value == 50.0
    assert found.expanded == pytest.approx(2.0)
    assert found.says.key == "gum_agrees"


def test_the_largest_of_changes_that_noise_makes_as_well_is_not_told_from_zero() -> None:
    value, found = largest_of(*noisy([1.5, -2.0, 0.3, 0.0, 1.0], 1.0))
    assert value == 2.0
    assert found.says.key == "not_told_from_zero"
    assert found.expanded >= value


@pytest.mark.parametrize("changes", [5, 40])
@pytest.mark.slow
def test_of_nothing_something_is_told_from_zero_in_one_try_of_twenty_and_not_more(changes: int) -> None:
    """The largest of 40 changes of pure noise is 2.5 deviations: that is no finding."""
    random = np.random.default_rng(7)
    told = 0
    for _ in range(150):
        value, found = largest_of(*noisy(random.standard_normal(changes).tolist(), 1.0))
        told += value > found.expanded
        assert (found.says.key == "not_told_from_zero") == (found.expanded >= value)
    assert told <= 14  # 4.55 % of 150 are 7; more than 14 happen once in 150


def test_the_deviation_of_values_that_scatter_more_than_their_noise_is_told() -> None:
    values = [10.0, -20.0, 30.0, 0.0, -25.0]
    value, found = deviation_of(*noisy(values, 0.1))
    assert value == pytest.approx(np.std(values, ddof=1))
    slopes = (np.array(values) - np.mean(values)) / (len(values) - 1) / value
    assert found.standard == pytest.approx(0.1 * np.linalg.norm(slopes), rel=1e-4)
    assert found.says.key == "gum_agrees"


def test_the_deviation_of_values_that_scatter_as_their_noise_does_is_not_told_from_zero() -> None:
    value, found = deviation_of(*noisy([0.5, -1.0, 1.2, 0.1, -0.3], 1.0))
    assert found.says.key == "not_told_from_zero"
    assert found.expanded >= value


def test_values_without_any_deviation_are_zero_and_known_to_their_noise() -> None:
    value, found = deviation_of(*noisy([3.0, 3.0, 3.0], 1.0))
    assert value == 0.0
    assert found.expanded > 1.0
    assert found.says.key == "not_told_from_zero"


def test_a_size_that_is_not_straight_over_its_noise_says_that_it_is_a_size() -> None:
    """Two changes of one size: whichever noise makes larger counts."""
    _, found = largest_of(*noisy([4.0] * 30, 1.0))
    assert found.says.key == "size_of_changes"
    assert found.expanded > found.monte_carlo


def test_what_was_tried_is_no_measurement() -> None:
    found = nothing()
    assert (found.standard, found.expanded, found.monte_carlo, found.contributors) == (0.0, 0.0, 0.0, ())
    assert found.says.key == "as_tried"


def test_few_degrees_of_freedom_widen_u_by_both_ways() -> None:
    """GUM, table G.2: k = 2.65 for 5 degrees of freedom at 95.45 %."""
    found = propagated(total, [scattered("scatter", np.array([[4.0]]), "five differences", dof=5.0)])
    assert (found.standard, found.dof) == (pytest.approx(2.0), pytest.approx(5.0))
    assert found.expanded == pytest.approx(2.65 * 2.0, abs=0.01)
    assert found.monte_carlo == pytest.approx(found.expanded, rel=0.05)
    assert found.contributors[0].dof == 5.0


@pytest.mark.parametrize("other", [0.0, 0.1, 1.0, 30.0])
def test_u_is_never_less_than_type_a_alone_and_its_k_approaches_2_as_type_b_prevails(other: float) -> None:
    scatter = scattered("scatter", np.array([[1.0]]), "four readings", dof=3.0)
    found = propagated(total, [scatter, single("certificate", other, "stated")])
    assert found.expanded >= coverage_factor(3.0) * 0.999
    assert found.k is not None
    assert found.k >= coverage_factor(found.dof) * 0.999
    if other == 30.0:
        assert found.k == pytest.approx(K, abs=0.01)
