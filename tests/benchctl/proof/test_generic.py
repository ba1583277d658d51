"""The generic arm, on recordings of another lab's bench."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchctl.proof.generic.arm import available, boosted, regress
from benchctl.proof.generic.library import TERMS, baseline, library
from benchctl.proof.generic.rows import Rows, rows_of
from benchctl.proof.generic.sparse import sparse
from benchctl.recordings.reader import open_recording
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.effects.registry import effects
from tests.benchctl.diagnosis.foreign import Truth, make, to_recording
from tests.shared import SHARED, needs_shared

needs_pysindy = pytest.mark.skipif(not available(), reason="pysindy is not installed")


@pytest.fixture(scope="module")
def rows() -> Rows:
    with to_recording(*make(Truth(kind="null", bench=0, plan=0), 1)) as recording:
        return rows_of(recording)


def test_the_library_has_fifty_terms_and_each_stands_for_an_effect_of_the_vocabulary(rows: Rows) -> None:
    names, columns = library(rows)
    assert len(names) >= 50
    assert columns.shape == (rows.time_s.size, len(names))
    assert {effect for effect, _ in TERMS.values()} <= set(effects())


def test_terms_that_the_labs_model_has_are_no_findings(rows: Rows) -> None:
    names, _ = library(rows)
    assert (rows.k_T_terms, rows.k_omega_terms) == (2, 2)
    assert {"ωT", "ωT²", "ω³", "ω⁵"}.isdisjoint(names)
    assert {"ωT³", "ω⁷"} <= set(names)
    assert baseline(rows).shape[1] == 6


def test_rows_are_means_whose_noise_is_that_of_their_residual_at_rest(rows: Rows) -> None:
    at_rest = np.abs(rows.rate_dps) < 0.05
    beyond = rows.residual_v[at_rest] - np.median(rows.residual_v[at_rest])
    assert np.std(beyond) == pytest.approx(rows.noise_v, rel=0.1)
    assert 10_000 < rows.time_s.size < 120_000


@needs_pysindy
def test_a_plain_term_is_found_and_white_noise_brings_none(rows: Rows) -> None:
    names, columns = library(rows)
    white = rows.noise_v * np.random.default_rng(2).standard_normal(rows.time_s.size)
    empty = sparse(baseline(rows), columns, replace(rows, residual_v=white))
    assert not empty.coefficients.any()
    assert empty.heldout == pytest.approx(1.0, abs=0.01)
    heading = 2.0 * rows.noise_v * np.cos(np.radians(rows.angle_deg))
    chosen = sparse(baseline(rows), columns, replace(rows, residual_v=white + heading))
    assert [names[k] for k in np.flatnonzero(chosen.coefficients)] == ["cos θ"]
    assert chosen.heldout == pytest.approx(1.0, abs=0.02)


@needs_pysindy
def test_of_a_recording_with_nothing_missing_it_says_nothing(rows: Rows) -> None:
    _, columns = library(rows)
    chosen = sparse(baseline(rows), columns, rows)
    assert not chosen.coefficients.any()
    assert chosen.heldout == pytest.approx(1.0, abs=0.05)


@needs_pysindy
@needs_shared("recordings/examples")
@pytest.mark.slow
def test_a_low_pass_is_taken_for_several_things() -> None:
    with open_recording(SHARED / "recordings" / "examples" / "single") as recording:
        found = regress(recording)
    assert "sensor_bandwidth" in found.effects
    assert len(found.effects) > 1
    assert found.heldout_ratio > 1.05


def test_without_pysindy_it_says_what_to_install(rows: Rows, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pysindy.optimizers", None)
    with pytest.raises(UsageError, match=r"needs pysindy: pip install 'benchctl\[test\]'"):
        sparse(baseline(rows), library(rows)[1], rows)


def test_a_recording_without_a_model_is_refused(tmp_path: Path) -> None:
    description, table = make(Truth(kind="null", bench=0, plan=0), 1)
    with (
        to_recording({**description, "simulation": None}, table) as recording,
        pytest.raises(UsageError, match="its lab states no model"),
    ):
        rows_of(recording)


@needs_pysindy
def test_a_boosted_tree_follows_a_step_over_the_temperature_that_no_term_of_the_library_has(rows: Rows) -> None:
    stepped = replace(rows, residual_v=rows.residual_v + 20.0 * rows.noise_v * (rows.warmer_c > 10.0))
    assert boosted(baseline(rows), stepped) < 0.3 * float(np.std(stepped.residual_v) / rows.noise_v)
