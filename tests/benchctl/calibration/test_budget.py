import math

import pytest

from benchctl.calibration.calibrate import calibrate
from benchctl.calibration.laws_fit import contributions
from benchctl.calibration.result import CalibrationOptions
from benchctl.recordings.model import BenchFacts
from benchctl.recordings.stated import StatedUncertainties, stated_of
from benchctl_instruments.physics.gyro import EARTH_DPS
from tests.benchctl.calibration.campaigns import TRUTH, recorded
from tests.benchctl.calibration.synthetic import meta_of
from tests.benchctl.recordings import made
from tests.benchctl.recordings.test_stated import CERTIFIED

FACTS = BenchFacts(sample_rate_hz=500.0, adc_bits=16, adc_range_v=10.0, latitude_deg=60.0)
VALUES = {"K0_v_per_dps": 0.05, "U0_v": 0.01, "g1": -1e-4, "g2": 2e-6, "c1": 1e-3}


def _budget(name: str, known: StatedUncertainties) -> dict[str, tuple[float, str]]:
    parts = contributions(name, VALUES, 1e-6, math.inf, [], FACTS, 0.0036, known)
    return {part.source: (part.standard, part.says) for part in parts}


def test_a_certificate_takes_the_place_of_what_was_assumed() -> None:
    certified = stated_of(made.meta(provenance={"bench_toml": CERTIFIED}))
    scale = _budget("K0_v_per_dps", certified)
    assert scale["ADC gain"] == (pytest.approx(0.05 * 20e-6), "volts known to 20 ppm (certificate D-7, k = 2)")
    assert "time base" not in scale  # stated as none
    assert scale["thermometer"] == (pytest.approx(0.05 * 1e-4 * 0.1), "thermistor known to 0.1 °C (assumed)")
    assert scale["encoder"][1] == "1″ (certificate LNE 2026-123, k = 2) over all turns"
    rest = _budget("U0_v", certified)
    assert rest["ADC offset"] == (1e-5, "certificate D-7, k = 2")
    off_rad = 3.141592653589793 / 180.0 * (0.025**2 + 0.01**2) ** 0.5
    assert rest["Earth's rate"][0] == pytest.approx(0.05 * EARTH_DPS * 0.5 * off_rad)
    assert rest["Earth's rate"][1] == (
        "0.0036 °/s taken off; latitude to 0.025° (stated for the site, k = 2), tilt to 0.01° (certificate LNE "
        "2026-123, k = 2)"
    )


def test_without_a_certificate_every_figure_says_where_it_comes_from() -> None:
    assumed = stated_of(made.meta(bench=FACTS))
    scale = _budget("K0_v_per_dps", assumed)
    assert scale["time base"] == (pytest.approx(0.05 * 20e-6), "clock known to 20 ppm (assumed)")
    assert scale["ADC gain"] == (pytest.approx(0.05 * 50e-6), "volts known to 50 ppm (assumed)")
    assert "encoder" not in scale
    assert _budget("U0_v", assumed)["ADC offset"][1] == "one step of the converter, uniform"


def test_a_calibration_takes_the_certificates_that_its_recording_keeps() -> None:
    meta = meta_of(TRUTH)
    options = CalibrationOptions(law="sine")
    steps = list(recorded())
    plain = calibrate(steps, meta, options).best
    better = calibrate(steps, made.meta(bench=meta.bench, provenance={"bench_toml": CERTIFIED}), options).best
    before, after = (next(p for p in fit.parameters if p.name == "K0_v_per_dps") for fit in (plain, better))
    assert [part.says for part in before.budget if part.source == "ADC gain"] == ["volts known to 50 ppm (assumed)"]
    assert "volts known to 20 ppm (certificate D-7, k = 2)" in [part.says for part in after.budget]
    assert after.expanded < before.expanded
    assert after.ci95 == before.ci95
