"""Diagnoses of made tables of static points: what may be named, and what may be the table's own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from benchctl.diagnosis import diagnose
from benchctl.diagnosis.result import Diagnosis
from benchctl.recordings.importing import import_recording
from benchctl.recordings.reader import open_recording

FloatArray = npt.NDArray[np.float64]

RATES = np.array([-200, -160, -120, -80, -40, 0, 40, 80, 120, 160, 200, -100, -60, -20, 0, 20, 60, 100] * 2, np.float64)
K0, U0, SCATTER_V = -0.02, 2.65, 2e-4


def diagnosed(volts: FloatArray, folder: Path) -> Diagnosis:
    scattered = volts + SCATTER_V * np.random.default_rng(4).standard_normal(volts.size)
    table = folder / "points.csv"
    rows = [f"{rate:g},{value:.6f}" for rate, value in zip(RATES, scattered, strict=True)]
    table.write_text("rate_dps,gyro_v_mean\n" + "\n".join(rows) + "\n", encoding="utf-8")
    import_recording(table, None, folder / "points.h5")
    with open_recording(folder / "points.h5") as recording:
        return diagnose(recording)


def asymmetric(fraction: float) -> FloatArray:
    return np.asarray(U0 + K0 * RATES * (1.0 + 0.5 * fraction * np.sign(RATES)))


def test_what_commanded_rates_may_be_wrong_by_is_noted_and_not_named(tmp_path: Path) -> None:
    found = diagnosed(asymmetric(1.2e-3), tmp_path)
    assert found.findings == ()
    assert not found.unexplained.significant
    (noted,) = [note for note in found.notes if "may be the table's own" in note]
    assert "scale asymmetry" in noted
    assert "scale_asymmetry" not in [one.effect for one in found.not_found]


def test_a_larger_asymmetry_is_named(tmp_path: Path) -> None:
    found = diagnosed(asymmetric(1.2e-2), tmp_path)
    assert [one.effect for one in found.findings] == ["scale_asymmetry"]


def test_an_interferometers_sine_states_its_one_number(tmp_path: Path) -> None:
    (found,) = diagnosed(U0 + K0 / 0.0045 * np.sin(0.0045 * RATES), tmp_path).findings
    S = found.parameters["S_rad_per_dps"]
    assert S.low < 0.0045 < S.high
    assert S.high - S.low < 2e-4


def test_of_one_rail_the_other_is_only_known_to_lie_beyond_the_outputs(tmp_path: Path) -> None:
    volts = U0 + K0 * RATES
    (found,) = diagnosed(np.maximum(volts, 0.136), tmp_path).findings
    assert found.effect == "two_rails"
    lower, upper = found.parameters["lower_v"], found.parameters["upper_v"]
    assert lower.low < 0.136 < lower.high
    assert upper.high > 10.0
    assert upper.value == pytest.approx(volts.max(), abs=0.01)


def test_a_dead_zone_is_seen(tmp_path: Path) -> None:
    (found,) = diagnosed(U0 + K0 * np.sign(RATES) * np.maximum(np.abs(RATES) - 1.0, 0.0), tmp_path).findings
    assert found.effect == "dead_zone"
    assert found.parameters["half_width_dps"].value == pytest.approx(1.0, abs=0.1)
