import pytest

from benchctl.bench import load_bench
from benchctl.campaign.soak import SoakWatch
from benchctl.plan import Soak
from benchctl_instruments.errors import SafetyError

LIMITS = load_bench("simulated").limits
STEP = Soak(setpoint_c=20.0, hold_s=600.0, tolerance_c=0.3, drift_c_per_min=0.02, timeout_s=1800.0)


def _watch() -> SoakWatch:
    return SoakWatch(STEP, from_c=0.0, begin_s=0.0, limits=LIMITS)


def test_a_soak_is_over_when_the_air_has_held_and_the_gyro_no_longer_drifts() -> None:
    watch = _watch()
    ends_s = None
    for now_s in range(0, 3000, 30):
        watch.see(float(now_s), 20.1 if now_s >= 900 else 10.0, 20.0)
        if watch.done:
            ends_s = now_s
            break
    assert ends_s == 1500


def test_an_excursion_of_the_air_starts_the_hold_again() -> None:
    watch = _watch()
    for now_s in range(0, 600, 30):
        watch.see(float(now_s), 20.0 if now_s != 300 else 20.5, 20.0)
    assert not watch.done
    for now_s in range(600, 960, 30):
        watch.see(float(now_s), 20.0, 20.0)
    assert watch.done


def test_a_gyro_that_still_drifts_keeps_the_soak_going() -> None:
    watch = _watch()
    for now_s in range(0, 1200, 30):
        watch.see(float(now_s), 20.0, 15.0 + 0.05 * now_s / 60.0)
    assert not watch.done


def test_a_chamber_that_never_arrives_ends_the_run_with_what_was_measured() -> None:
    watch = _watch()

    def wait_for_ever() -> None:
        for now_s in range(0, 20000, 30):
            watch.see(float(now_s), 12.0, 12.0)

    with pytest.raises(SafetyError, match=r"soak at \+20 °C not over after .* air at \+12.0 °C"):
        wait_for_ever()
