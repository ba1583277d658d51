"""The thermistor through streams of seconds, soaks that are only polled, and pauses of which nothing is known."""

import numpy as np
import pytest

from benchctl.signals.temperature import Readings, thermistor_of

NOISE_C = 0.01


def truth(time_s):
    """23 °C, then a lag of 200 s towards 53 °C from the first minute on."""
    since = np.maximum(time_s - 60.0, 0.0)
    return 53.0 - 30.0 * np.exp(-since / 200.0), 30.0 / 200.0 * np.exp(-since / 200.0) * (time_s > 60.0)


def streams(starts, length_s=4.0, rate_hz=100.0, seed=0):
    chance = np.random.default_rng(seed)
    for start in starts:
        time_s = start + np.arange(0.0, length_s, 1.0 / rate_hz)
        yield Readings(time_s, truth(time_s)[0] + NOISE_C * chance.standard_normal(time_s.size))


def test_the_slope_of_short_streams_comes_from_their_neighbours_too():
    parts = list(streams(np.arange(100.0, 400.0, 6.0)))
    found = thermistor_of(parts)
    for time_s, *_ in parts[3:-3]:
        temp, rate = found.at(time_s)
        np.testing.assert_allclose(temp, truth(time_s)[0], atol=0.01)
        np.testing.assert_allclose(rate, truth(time_s)[1], atol=1e-3)
    alone = np.polyfit(parts[20].time_s, parts[20].temp_c, 1)[0]
    error = abs(np.mean(found.at(parts[20][0])[1]) - np.mean(truth(parts[20][0])[1]))
    assert error < 5e-4 < abs(alone - np.mean(truth(parts[20][0])[1]))


def test_a_long_stream_keeps_its_ramps_and_loses_its_noise():
    (stream,) = streams([0.0], length_s=600.0)
    temp, rate = thermistor_of([stream]).at(stream[0])
    expected = truth(stream[0])
    away = np.abs(stream[0] - 60.0) > 10.0  # the slope of a corner is that of some seconds
    assert np.std((temp - expected[0])[away]) < 0.2 * NOISE_C
    assert np.std((rate - expected[1])[away]) < 5e-4


def test_polls_of_a_soak_say_what_happened_in_it():
    polls = np.arange(20.0, 400.0, 6.0)
    first, last = streams([0.0, 420.0], length_s=20.0)
    found = thermistor_of([first, Readings(polls, truth(polls)[0]), last])
    pause = found.pause(20.0, 420.0)
    assert pause is not None
    error = pause.temp_c - truth(pause.time_s)[0]
    inside = (pause.time_s > 140.0) & (pause.time_s < 400.0)
    assert np.abs(error[inside]).max() < 0.3
    straight = np.interp(pause.time_s, [20.0, 420.0], truth(np.array([20.0, 420.0]))[0])
    assert np.abs(error).max() < 0.2 * np.abs(pause.temp_c - straight).max()
    assert np.ptp(np.diff(pause.time_s)) < 1e-9


@pytest.mark.parametrize("until_s", [30.0, 420.0])
def test_of_a_pause_without_polls_or_a_short_one_nothing_is_known(until_s):
    found = thermistor_of(list(streams([0.0, 420.0], length_s=20.0)))
    assert found.pause(20.0, until_s) is None


def test_means_of_some_samples_say_what_the_samples_say():
    (stream,) = streams([0.0], length_s=600.0)
    means = Readings(*(one.reshape(-1, 10).mean(axis=1) for one in stream[:2]), np.full(6000, 10.0))
    whole, brief = (thermistor_of([one]).at(means.time_s) for one in (stream, means))
    np.testing.assert_allclose(brief[0], whole[0], atol=0.3 * NOISE_C)
    np.testing.assert_allclose(brief[1], whole[1], atol=1e-3)


def test_two_samples_are_a_temperature_without_a_slope():
    found = thermistor_of([Readings(np.array([5.0, 5.01]), np.array([23.0, 23.2]))])
    temp, rate = found.at(np.array([5.0]))
    assert temp == pytest.approx([23.1])
    assert rate == pytest.approx([0.0])
