"""Two effects of one kind that differ in their order are two findings, from the search to the model file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchctl.bench import load_bench, template
from benchctl.campaign.opened import world_settings
from benchctl.cli.app import run_verb
from benchctl.diagnosis import diagnose
from benchctl.diagnosis.drive.problem import drive_problem
from benchctl.diagnosis.findings.findings import findings_of
from benchctl.diagnosis.next_run import left_open
from benchctl.diagnosis.next_run.experiment import NOTHING_OPEN, OpenPair
from benchctl.diagnosis.next_run.left_open import next_of
from benchctl.diagnosis.residual.attribution import named
from benchctl.diagnosis.result import Alternative, Diagnosis, NextExperiment, Unexplained
from benchctl.diagnosis.search.select import reduced, select, without
from benchctl.diagnosis.search.selection import Selection
from benchctl.estimation.fit import Fit, Point, fit, gain_of
from benchctl.estimation.noise_model import NoiseModel
from benchctl.model_file import Model, write_model
from benchctl.part_models import check_parts
from benchctl.recordings.model import BenchFacts, Meta, Unit
from benchctl.recordings.reader import open_recording
from benchctl_instruments.physics.effects.heading_dependent_bias import HeadingDependentBias
from tests.benchctl.diagnosis.following import fitted, problem_of
from tests.benchctl.diagnosis.made_drive import Truth, drive_channels
from tests.benchctl.diagnosis.made_recording import model_found, recording_of
from tests.benchctl.diagnosis.toy_problem import Cubic, Quintic, Ripple, Toy, toy

ONCE = Ripple(amplitude_v=1e-3, phase_deg=10.0, order=1.0)
TWICE = Ripple(amplitude_v=5e-4, phase_deg=40.0, order=2.0)
CUBIC = Cubic(size_v=5e-3)


def selected(problem: Toy) -> Selection:
    return select(problem, seed=0, progress=lambda _name, _share: None)


def orders(one: Fit) -> list[float]:
    return [effect.values["order"] for effect in one.point.effects if effect.identifier == "ripple"]


@pytest.fixture(scope="module")
def problem() -> Toy:
    return toy(ONCE, TWICE, CUBIC)


@pytest.fixture(scope="module")
def chosen(problem: Toy) -> Selection:
    return selected(problem)


def test_both_orders_are_found_whichever_is_larger_and_nothing_else() -> None:
    for seed in range(5):
        for truth in ((ONCE, TWICE), (replace(ONCE, amplitude_v=5e-4), replace(TWICE, amplitude_v=1e-3))):
            after = selected(toy(*truth, seed=seed)).after
            assert [effect.identifier for effect in after.point.effects] == ["ripple", "ripple"]
            for effect, true in zip(
                sorted(after.point.effects, key=lambda one: one.values["order"]), truth, strict=True
            ):
                assert effect.values["order"] == true.order
                assert effect.values["amplitude_v"] == pytest.approx(true.amplitude_v, rel=0.2)
                assert effect.values["phase_deg"] == pytest.approx(true.phase_deg, abs=10.0)


@pytest.mark.parametrize("truth", [ONCE, TWICE], ids=["once", "twice"])
def test_where_there_is_one_the_other_order_is_not_made_up(truth: Ripple) -> None:
    for seed in range(10):
        found = selected(toy(replace(truth, amplitude_v=5e-3), CUBIC, seed=seed))
        assert sorted(found.evidence) == ["cubic", "ripple"]
        assert orders(found.after) == [truth.order]
        assert found.evidence["ripple"].rivals == {}


def test_each_order_has_its_own_evidence(problem: Toy, chosen: Selection) -> None:
    assert list(chosen.evidence) == ["cubic", "ripple", "ripple_2"]
    for key, place in (("ripple", 1), ("ripple_2", 2)):
        effects = chosen.after.point.effects
        start = Point(baseline=chosen.after.point.baseline, effects=(*effects[:place], *effects[place + 1 :]))
        less = fit(problem, chosen.whitener, start, ~chosen.heldout)
        assert chosen.evidence[key].gain == pytest.approx(gain_of(chosen.after, less), rel=1e-6)
    assert chosen.evidence["ripple"].gain > 2.0 * chosen.evidence["ripple_2"].gain


def test_one_order_is_left_out_and_the_other_stays(problem: Toy, chosen: Selection) -> None:
    first, second = orders(chosen.after)
    assert orders(without(problem, chosen, "ripple")) == [second]
    assert orders(without(problem, chosen, "ripple_2")) == [first]


def test_a_selection_reduced_by_one_order_names_the_other_by_its_identifier(problem: Toy, chosen: Selection) -> None:
    less = reduced(problem, chosen, {"ripple"})
    assert orders(less.after) == orders(less.full) == [2.0]
    assert list(less.evidence) == ["cubic", "ripple"]
    assert less.evidence["ripple"] is chosen.evidence["ripple_2"]
    assert {one.effect for one in findings_of(problem, less)} == {"cubic", "ripple"}
    none = reduced(problem, chosen, {"ripple", "ripple_2"})
    assert list(none.evidence) == ["cubic"]


def test_nothing_is_left_and_no_order_is_withdrawn(problem: Toy, chosen: Selection) -> None:
    kept, unexplained, notes = named(problem, chosen, seed=0)
    assert kept is chosen
    assert not unexplained.significant
    assert notes == ()


def test_findings_of_one_kind_have_their_own_numbers_under_one_identifier(problem: Toy, chosen: Selection) -> None:
    told = findings_of(problem, chosen)
    assert [one.effect for one in told] == ["cubic", "ripple", "ripple"]
    for key, one in zip(chosen.evidence, told, strict=True):
        assert one.gain == chosen.evidence[key].gain
    assert [one.parameters["order"].value for one in told[1:]] == [1.0, 2.0]
    assert told[1].explains > 2.0 * told[2].explains


def test_an_order_that_the_model_has_is_nobody_s_rival() -> None:
    """A look-alike of the cubic that comes in two orders: one is in the model, the other is not promising."""

    class Alike(Quintic):
        look_alikes = ("ripple",)

    found = selected(toy(Alike(size_v=5e-3), ONCE, hypotheses=[Alike, Ripple]))
    assert sorted(found.evidence) == ["quintic", "ripple"]
    assert found.evidence["quintic"].rivals == {}


def test_each_order_is_parted_from_its_own_nearest_rival(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    given: list[OpenPair] = []

    def found(_problem: object, _noise: object, pairs: list[OpenPair], **_: object) -> NextExperiment:
        given.extend(pairs)
        return NOTHING_OPEN

    monkeypatch.setattr(left_open, "next_experiment", found)
    once, twice = (HeadingDependentBias(amplitude_v=1e-3, phase_deg=0.0, order=order) for order in (1.0, 2.0))
    gyro, made = problem_of(tmp_path, once), toy(ONCE, TWICE)
    theirs = selected(made)
    nearest = [replace(fitted(gyro).point, effects=(kept,)) for kept in (twice, once)]
    keys = ("heading_dependent_bias", "heading_dependent_bias_2")
    evidence = {
        key: replace(old, nearest=point)
        for key, old, point in zip(keys, theirs.evidence.values(), nearest, strict=True)
    }
    ours = replace(theirs, after=fitted(gyro), noise=NoiseModel.of(gyro), evidence=evidence)
    rival = Alternative(effect="encoder_eccentricity", probability=0.4, loss=0.5)
    findings = [
        replace(old, effect="heading_dependent_bias", alternatives=(rival,)) for old in findings_of(made, theirs)
    ]
    meta = Meta(status="complete", unit=Unit(serial="G", range_dps=100.0), bench=BenchFacts(sample_rate_hz=100.0))
    next_of(gyro, ours, findings, Unexplained(significant=False, share=0.0), meta, lambda _name, _share: None)
    assert [pair.second.point.effects[0].values["order"] for pair in given] == [2.0, 1.0]


def test_a_motor_s_teeth_and_a_load_out_of_balance_are_both_found() -> None:
    channels = drive_channels(Truth(cogging=0.01, order=12), 1)
    imbalance_nm = 0.006 * np.cos(np.radians(channels["encoder_deg"] - 30.0))
    drive = drive_problem(recording_of({**channels, "torque_nm": channels["torque_nm"] + imbalance_nm}))
    point = model_found(drive)
    tables = drive.model_of(point.baseline, point.effects, 0.0)["parts"]["drive"]["effects"]
    assert sorted(tables) == ["cogging_torque", "gravity"]
    assert tables["cogging_torque"]["order"] == 12.0
    assert tables["cogging_torque"]["amplitude_nm"] == pytest.approx(0.01, rel=0.1)
    assert tables["gravity"]["moment_nm"] == pytest.approx(0.006, rel=0.1)
    check_parts({"drive": {"effects": tables}})


RATES = "90.0, 60.0, 120.0, 30.0, 100.0, 80.0"
SPIN = f'''"""Spin."""

from collections.abc import Iterator

from benchctl.plan import ConstantRate, Static, Step, procedure


@procedure()
def spin() -> Iterator[Step]:
    """Whole turns both ways."""
    yield Static(duration_s=10.0)
    for rate in ({RATES}):
        yield ConstantRate(rate_dps=rate, duration_s=12.0, settle_s=1.0)
        yield ConstantRate(rate_dps=-rate, duration_s=12.0, settle_s=1.0)
    yield Static(duration_s=10.0)
'''
LAB = {
    "K0_v_per_dps": 0.016,
    "U0_v": 0.012,
    "T0_c": 23.0,
    "k_T": [],
    "k_omega": [3.0e-06],
    "noise_v_rms": 3e-4,
    "output_limit_v": 9.0,
}


def diagnosed(folder: Path, *, rates: str = RATES, counts: int = 360_000, **effects: Mapping[str, float]) -> Diagnosis:
    """The encoder's errors are the simulated bench's own; the bench samples at a quarter of its usual rate."""
    bench = template().replace("sample_rate_hz = 500.0", "sample_rate_hz = 125.0").replace("360000", f"{counts}")
    (folder / "bench.toml").write_text(bench, encoding="utf-8")
    (folder / "spin.py").write_text(SPIN.replace(RATES, rates), encoding="utf-8")
    write_model(folder / "model.toml", Model(simulation=LAB, effects=effects))
    options = {"-o": "run.h5", "--bench": "bench.toml", "--model": "model.toml"}
    arguments = [word for option, file in options.items() for word in (option, str(folder / file))]
    assert run_verb(["simulate", str(folder / "spin.py"), *arguments, "--quiet"]) == 0
    with open_recording(folder / "run.h5") as recording:
        return diagnose(recording, model=LAB)


@pytest.mark.slow
def test_both_orders_are_found_beside_a_structure_over_the_rate_though_the_encoder_is_coarser_than_the_second(
    tmp_path: Path,
) -> None:
    told = diagnosed(tmp_path, kink_of_bias_over_rate={"at": 40.0, "above": 2e-5})
    assert [(one.effect, one.parameters["order"].value) for one in told.findings] == [
        ("encoder_eccentricity", 1.0),
        ("encoder_eccentricity", 2.0),
    ]
    assert [one.parameters["amplitude_arcsec"].value for one in told.findings] == pytest.approx([15.0, 5.0], rel=0.1)
    (kink,) = told.unexplained.models
    assert kink.identifier == "kink_of_bias_over_rate"
    assert kink.parameters["at"].value == pytest.approx(40.0, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("change", [3e-4, 1e-2], ids=["weak", "strong"])
def test_both_orders_are_found_beside_a_bias_that_follows_the_last_direction(tmp_path: Path, change: float) -> None:
    """A strong one hides the encoder at first; constant rates are no swing and resolve no short period of volts."""
    told = diagnosed(tmp_path, positive_of_bias_over_last_sign={"change": change})
    assert [(one.effect, one.parameters["order"].value) for one in told.findings] == [
        ("encoder_eccentricity", 1.0),
        ("encoder_eccentricity", 2.0),
    ]
    assert [one.parameters["amplitude_arcsec"].value for one in told.findings] == pytest.approx([15.0, 5.0], rel=0.1)
    (direction,) = told.unexplained.models
    assert direction.identifier == "positive_of_bias_over_last_sign"
    assert direction.parameters["change"].value == pytest.approx(change, rel=0.05)


@pytest.mark.slow
def test_steps_of_constant_rates_beside_a_coarse_encoder_have_no_bandwidth(tmp_path: Path) -> None:
    told = diagnosed(tmp_path, rates="91.37, 61.13, 117.71, 31.87, 103.19, 78.83", counts=36_000)
    assert {one.effect for one in told.findings} == {"encoder_eccentricity"}
    assert any("encoder's rate is noisy" in note for note in told.notes)


@pytest.mark.slow
def test_the_simulated_bench_s_encoder_is_found_with_both_its_orders(tmp_path: Path) -> None:
    told = diagnosed(tmp_path)
    assert [one.effect for one in told.findings] == ["encoder_eccentricity"] * 2
    assert not told.unexplained.significant
    encoder = world_settings(load_bench(str(tmp_path / "bench.toml"))).encoder
    tables = told.model["effects"]
    assert list(tables) == ["encoder_eccentricity", "encoder_eccentricity_2"]
    once, twice = tables.values()
    assert (once["order"], twice["order"]) == (1.0, 2.0)
    assert once["amplitude_arcsec"] == pytest.approx(encoder.eccentricity_arcsec, rel=0.1)
    assert twice["amplitude_arcsec"] == pytest.approx(encoder.ellipticity_arcsec, rel=0.2)
    assert abs(math.remainder(once["phase_deg"] - encoder.eccentricity_phase_deg, 360.0)) < 5.0
    assert abs(math.remainder(twice["phase_deg"] - encoder.ellipticity_phase_deg, 180.0)) < 8.0
