import numpy as np
import numpy.typing as npt
import pytest

from benchctl.diagnosis.comparison.parting import ComparedStep, part

NOISE_V = 1e-3


def a_step(
    name: str, kind: str, off: npt.NDArray[np.float64], *, seed: int = 0, place: float = 0.0, interval_s: float = 0.01
) -> ComparedStep:
    """A step whose first simulation is off by `off`, whose second is right."""
    noise = NOISE_V * np.random.default_rng(seed).standard_normal(off.size)
    time_s = place + interval_s * np.arange(off.size)
    right = np.sin(time_s)
    return ComparedStep(
        name=name,
        kind=kind,
        time_s=time_s,
        measured_v=right + noise,
        simulated_v={"old": right - off, "new": right},
        coordinates={"time": time_s, "rate": np.linspace(-1.0, 1.0, off.size)},
    )


def test_rms_mean_and_noise_are_those_of_the_difference() -> None:
    found = part([a_step("a", "static", np.full(20000, 3e-3))])
    (step,) = found.steps
    assert found.simulations == ("old", "new")
    assert step.rms_v["old"] == pytest.approx(np.hypot(3e-3, NOISE_V), rel=0.02)
    assert step.mean_v["old"] == pytest.approx(3e-3, rel=0.01)
    assert step.rms_v["new"] == pytest.approx(NOISE_V, rel=0.02)
    assert found.rms_v["old"] == pytest.approx(step.rms_v["old"])


def test_a_fast_mismatch_is_not_taken_for_noise() -> None:
    off = 50e-3 * np.sin(2 * np.pi * 4.0 * np.arange(40000) / 500.0)
    one = a_step("a", "sine", off, interval_s=0.002)
    wrong_only = ComparedStep(
        name="a",
        kind="sine",
        time_s=one.time_s,
        measured_v=one.measured_v,
        simulated_v={"old": one.simulated_v["old"]},
        coordinates=one.coordinates,
    )
    assert part([wrong_only]).noise_v == pytest.approx(NOISE_V, rel=0.05)


def test_longer_steps_count_more() -> None:
    found = part([a_step("a", "static", np.full(3000, 4e-2)), a_step("b", "static", np.zeros(1000), place=50.0)])
    assert found.rms_v["old"] == pytest.approx(4e-2 * np.sqrt(0.75), rel=0.01)


def test_means_along_a_coordinate_have_their_error_and_empty_bins_are_not_known() -> None:
    ramp = np.linspace(-1.0, 1.0, 24000)
    found = part([a_step("a", "sine", 1e-2 * ramp), a_step("b", "static", np.zeros(2400), place=1000.0)])
    rate = next(one for one in found.coordinates if one.coordinate == "rate")
    assert rate.mean_v["old"][-1] == pytest.approx(1e-2 * (1 - 1 / 24) * 24000 / 26400, rel=0.05)
    assert rate.standard_error_v[0] == pytest.approx(NOISE_V / np.sqrt(1100), rel=0.05)
    time = next(one for one in found.coordinates if one.coordinate == "time")
    empty = time.count == 0
    assert empty.any()
    assert np.isnan(time.mean_v["old"][empty]).all()


def test_the_excerpts_show_each_kind_where_it_is_furthest_off() -> None:
    bump = np.zeros(6000)
    bump[4000:4200] = 0.1
    steps = [
        a_step("quiet", "static", np.zeros(6000)),
        a_step("bad", "sine", np.full(6000, 0.05), place=100.0),
        a_step("worse", "sine", np.full(6000, 0.06), place=200.0),
        a_step("sudden", "constant_rate", bump, place=300.0),
    ]
    found = part(steps).excerpts
    assert [one.step for one in found] == ["worse", "sudden", "quiet"]
    sudden = found[1]
    assert sudden.time_s[-1] - sudden.time_s[0] == pytest.approx(8.0, abs=0.1)
    assert sudden.time_s[0] < 340.0 < 342.0 < sudden.time_s[-1]


def test_a_coordinate_that_is_nowhere_known_or_never_changes_breaks_nothing() -> None:
    one = a_step("a", "static", np.zeros(500))
    blind = ComparedStep(
        name="a",
        kind="static",
        time_s=one.time_s,
        measured_v=one.measured_v,
        simulated_v=one.simulated_v,
        coordinates={"gyro_temp": np.full(500, np.nan), "rate": np.zeros(500)},
    )
    unknown, constant = part([blind]).coordinates
    assert unknown.count.sum() == 0
    assert constant.count.max() == 500


def test_of_a_fast_sine_a_few_periods_are_shown() -> None:
    one = a_step("a", "sine", np.zeros(4000))
    time_s = one.time_s
    fast = ComparedStep(
        name="a",
        kind="sine",
        time_s=time_s,
        measured_v=np.sin(2 * np.pi * 5.0 * time_s),
        simulated_v={"old": np.zeros(4000)},
        coordinates={},
    )
    (shown,) = part([fast]).excerpts
    assert shown.time_s[-1] - shown.time_s[0] == pytest.approx(6 / 5.0, rel=0.05)
