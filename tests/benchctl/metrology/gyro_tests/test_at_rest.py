"""Bias, its stability, and the noises of the longest rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchctl.metrology.acceptance import measured_in
from benchctl.metrology.observations import Settings
from benchctl.plan import Mount, PowerCycle, Static
from tests.benchctl.metrology.altered import altered, nan_in, results, stating, with_line
from tests.benchctl.metrology.made_unit import MadeUnit, recorded
from tests.benchctl.metrology.short_plans import IDEAL, QUIET, soak, sweep

NOISES = ("quantisation", "angle_random_walk", "bias_instability", "rate_random_walk", "rate_ramp")
LONG = [soak(), *sweep(), Static(duration_s=900.0)]


def test_the_bias_is_that_of_the_output_less_the_earths_rate() -> None:
    unit = replace(IDEAL, white_v_per_sqrt_hz=1e-9, U0_v=0.012)
    found = results(LONG, unit)["bias"]
    assert found.value == pytest.approx(3600.0 * 0.012 / 0.05, rel=1e-6)
    assert [note.key for note in found.notes] == ["earth_taken_off"]
    assert found.notes[0].values["rate_deg_per_h"] == pytest.approx(15.041 * np.sin(np.deg2rad(58.5)), rel=1e-4)
    assert found.steps == (2, 13, 14)  # all the rest


def test_where_the_latitude_is_not_known_all_of_the_earths_rate_is_in_doubt() -> None:
    recording, _ = recorded(LONG, IDEAL, 3, errors=False)
    lost = replace(recording.meta, bench=replace(recording.meta.bench, latitude_deg=None))
    found = {one.name: one for one in measured_in(altered(recording, lambda step: step, lost), Settings())}["bias"]
    assert [note.key for note in found.notes] == ["latitude_unknown"]
    assert found.value == pytest.approx(3600.0 * 0.012 / 0.05 + 15.041 * np.sin(np.deg2rad(58.5)), abs=0.5)
    assert found.uncertainty is not None
    earth = {one.source: one.standard for one in found.uncertainty.contributors}["Earth's rate"]
    assert earth == pytest.approx(15.041 / np.sqrt(3.0), rel=1e-3)


def test_the_bias_is_that_of_the_longest_rest_at_the_references_set_point() -> None:
    steps = [soak(), *sweep(), soak(60.0), Static(duration_s=3000.0), soak(20.0), Static(duration_s=900.0)]
    found = results(steps, QUIET)["bias"]
    assert found.steps == (len(steps),)
    assert found.temperature_c == pytest.approx(20.0, abs=0.01)


def test_the_bias_of_a_recording_that_states_no_set_point_is_measured() -> None:
    found = results(LONG, QUIET, change=stating(chamber_setpoint_c=float("nan")))["bias"]
    assert found.value is not None


def test_without_any_rest_there_is_no_bias() -> None:
    found = results([soak(), *sweep()[1:-1]], QUIET)["bias"]
    assert found.refused is not None
    assert found.refused.key == "needs_rest"


def test_white_noise_is_the_angle_random_walk_and_makes_the_means_scatter() -> None:
    found = results([soak(), *sweep(), Static(duration_s=3600.0)], IDEAL)
    walk, stability = found["angle_random_walk"], found["bias_stability"]
    assert walk.value == pytest.approx(60.0 * 2.5e-5 / 0.05, rel=0.02)
    assert stability.value == pytest.approx(3600.0 * 2.5e-5 / 0.05 / np.sqrt(10.0), rel=0.1)
    assert stability.notes[0].values == {"seconds": 10.0, "count": pytest.approx(360, abs=1)}
    assert stability.uncertainty is not None
    of_white_noise = 2.0 * stability.value / np.sqrt(2 * 359)  # type: ignore[operator]
    assert of_white_noise <= stability.uncertainty.expanded < 2.0 * of_white_noise  # a faint walk is possible
    for name in ("quantisation", "bias_instability", "rate_random_walk", "rate_ramp"):
        assert found[name].refused is not None
        assert found[name].refused.key == "term_refused"  # type: ignore[union-attr]


def test_a_line_in_the_spectrum_is_told_beside_every_term_that_it_spoils_and_the_stability() -> None:
    steps = [soak(), *sweep(), Static(duration_s=900.0)]
    lined = results(steps, IDEAL, change=with_line(0.05 * 0.05, 1.3, "static"))
    spoilt = [name for name in ("bias_stability", *NOISES) if lined[name].value is not None]
    assert "bias_stability" in spoilt
    assert len(spoilt) > 1
    for name in spoilt:
        (told,) = [note for note in lined[name].notes if note.key == "terms_misfit"]
        assert told.values["value"] != pytest.approx(told.values["modelled"], rel=0.05)
    plain = results(steps, IDEAL)
    assert not [note for one in plain.values() for note in one.notes if note.key == "terms_misfit"]


def test_the_stability_is_of_means_as_long_as_was_asked() -> None:
    found = results([soak(), *sweep(), Static(duration_s=3600.0)], IDEAL, settings=Settings(mean_s=100.0))
    value = found["bias_stability"].value
    assert value == pytest.approx(3600.0 * 2.5e-5 / 0.05 / np.sqrt(100.0), rel=0.3)


@pytest.mark.parametrize(
    ("steps", "settings", "why"),
    [
        ([soak(), *sweep()], Settings(), "needs_long_rest"),
        (LONG, Settings(rest_s=1000.0), "needs_long_rest"),
        ([soak(), Static(duration_s=900.0)], Settings(), "needs_scale_factor"),
        ([soak(), *sweep(), PowerCycle(off_s=9.0), Static(duration_s=900.0)], Settings(), "needs_long_rest"),
        ([soak(), *sweep(), Mount(position="across"), Static(duration_s=900.0)], Settings(), "needs_long_rest"),
        ([soak(), *sweep(), Static(duration_s=3.0)], Settings(rest_s=1.0, mean_s=0.1), ""),
        ([soak(), *sweep(zero_s=2.0)], Settings(rest_s=1.0, mean_s=0.1), "term_refused"),  # too few samples
    ],
    ids=["short", "longer-asked", "no-scale-factor", "warms-up", "across", "short-asked", "few-samples"],
)
def test_what_a_rest_is_too_short_for_is_refused(steps: list, settings: Settings, why: str) -> None:
    unit = replace(QUIET, sample_rate_hz=40.0 if why == "term_refused" else 50.0)
    found = results(steps, unit, settings=settings)
    refused = {found[name].refused.key for name in ("bias_stability", *NOISES) if found[name].refused is not None}  # type: ignore[union-attr]
    if why:
        assert refused == {why}
    else:
        assert found["bias_stability"].value is not None


def test_a_rest_of_fewer_than_ten_means_says_nothing_of_stability() -> None:
    found = results(LONG, QUIET, settings=Settings(mean_s=400.0))["bias_stability"]
    assert found.refused is not None
    assert found.refused.key == "needs_long_rest"
    assert found.refused.values["needed_s"] == pytest.approx(4000.0)


def test_rest_without_a_finite_sample_is_refused_in_words() -> None:
    found = results(LONG, QUIET, change=nan_in("gyro_v", "static"))
    for name in ("bias_stability", *NOISES):
        assert found[name].refused is not None
        assert found[name].refused.key == "term_refused"  # type: ignore[union-attr]


def test_a_walk_that_one_rest_hardly_shows_is_in_the_stabilitys_uncertainty() -> None:
    steps = [soak(), *sweep(), Static(duration_s=900.0)]
    noisy = MadeUnit(white_v_per_sqrt_hz=2.5e-5, walk_v_per_sqrt_s=4e-6)
    still = results(steps, IDEAL)["bias_stability"]
    walks = results(steps, noisy)["bias_stability"]
    for one in (still, walks):
        assert one.uncertainty is not None
        assert one.value is not None
    relative = [one.uncertainty.expanded / one.value for one in (still, walks)]  # type: ignore[union-attr,operator]
    assert relative[1] > 2.0 * relative[0]
