"""The drive of a table: what its torque says beyond inertia and viscous friction."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from benchctl.diagnosis.drive.problem import DriveProblem, drive_problem
from benchctl.diagnosis.parts import problem_of
from benchctl.diagnosis.search.held_out import held_out_steps
from benchctl.recordings.importing import import_recording
from benchctl.recordings.reader import Recording, join, open_recording
from benchctl_instruments.errors import UsageError
from tests.benchctl.diagnosis.made_drive import INERTIA, VISCOUS, Truth, drive_channels
from tests.benchctl.diagnosis.made_recording import found_in, recording_of
from tests.shared import SHARED, needs_shared

MAP = Path(__file__).parents[2] / "recordings" / "maps" / "drive.toml"
DATA = SHARED / "data" / "table_drive"


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_a_drive_of_inertia_and_viscous_friction_brings_no_finding(seed: int) -> None:
    problem = drive_problem(recording_of(drive_channels(Truth(), seed)))
    assert found_in(problem) == {}
    assert problem.baseline_start == pytest.approx([INERTIA, VISCOUS], rel=2e-3)


@pytest.mark.parametrize(
    ("truth", "effect", "parameters"),
    [
        (Truth(coulomb=0.02), "coulomb_friction", {"coulomb_nm": 0.02}),
        (Truth(offset=0.004), "torque_offset", {"offset_nm": 0.004}),
        (
            Truth(breakaway=0.03, creep_rad_s=0.3, swing=0.06),
            "stribeck_friction",
            {"breakaway_nm": 0.03, "velocity_rad_s": 0.3},
        ),
        (Truth(drag=0.001), "quadratic_drag", {"drag_nm_s2": 0.001}),
        (Truth(cogging=0.01, order=12), "cogging_torque", {"amplitude_nm": 0.01, "order": 12}),
        (Truth(cogging=0.004, order=1), "gravity", {"moment_nm": 0.004, "hangs_at_deg": 270 + np.degrees(0.7)}),
        (Truth(drift_per_hour=0.3), "torque_drift", {"nm_per_hour": 0.3}),
        (Truth(warm_up=-0.2), "viscous_warm_up", {"tau_s": 20.0, "fraction": -0.2 * (1 - np.exp(-90 / 20))}),
        (Truth(delay_s=0.01), "torque_delay", {"delay_s": 0.01}),
    ],
)
def test_what_a_drive_does_beside_is_found_and_nothing_else(
    truth: Truth, effect: str, parameters: dict[str, float]
) -> None:
    found = found_in(drive_problem(recording_of(drive_channels(truth, 1))))
    assert list(found) == [effect]
    values = found[effect].values
    assert {name: values[name] for name in parameters} == pytest.approx(parameters, rel=0.1)


def test_more_samples_than_memory_holds_are_refused_before_they_are_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("benchctl.limits.memory_bytes", lambda: 4_000_000)
    with pytest.raises(UsageError, match=r"all of encoder_deg, torque_nm at once needs .* this machine has 0\.004 GB"):
        drive_problem(recording_of(drive_channels(Truth(), 1)))


def test_dry_friction_and_an_offset_are_told_apart_where_the_table_turns_both_ways() -> None:
    found = found_in(drive_problem(recording_of(drive_channels(Truth(coulomb=0.03, offset=0.01), 1))))
    assert set(found) == {"coulomb_friction", "torque_offset"}
    assert found["coulomb_friction"].values["coulomb_nm"] == pytest.approx(0.03, rel=0.03)
    assert found["torque_offset"].values["offset_nm"] == pytest.approx(0.01, rel=0.03)


def test_two_effects_of_which_neither_passes_alone_are_found_as_a_pair() -> None:
    """A run each way: what either effect leaves of the other is as even over each run as the effect itself."""
    runs = [
        recording_of(drive_channels(Truth(coulomb=0.035, offset=0.012, swing=0.01, steady=steady), 1, seconds=25.0))
        for steady in (0.2, -0.15)
    ]
    found = found_in(drive_problem(join(runs)))
    assert set(found) == {"coulomb_friction", "torque_offset"}
    assert found["coulomb_friction"].values["coulomb_nm"] == pytest.approx(0.035, rel=0.1)
    assert found["torque_offset"].values["offset_nm"] == pytest.approx(0.012, rel=0.1)


def test_a_table_that_turns_one_way_cannot_tell_dry_friction_from_an_offset_and_says_so() -> None:
    problem = drive_problem(recording_of(drive_channels(Truth(coulomb=0.02, swing=0.05, steady=0.3), 1)))
    rows = slice(200, None)  # once it turns
    rate = problem.rows.means(problem.rows.rate_rad_s)
    assert (rate[problem.usable] > 0.0).all()
    moved = [_column(problem, name) for name in ("coulomb_friction", "torque_offset")]
    assert moved[0][rows] / moved[1][rows] == pytest.approx(1.0)
    none = np.zeros(problem.time_s.size)
    assert any("one way only" in remark for remark in problem.remarks(none, none, problem.usable))


def _column(problem: DriveProblem, name: str) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    kind = problem.effects[name]
    effect = kind.make({next(iter(kind.parameters)): 1e-3})
    return problem.predict(problem.baseline_start, (effect,)) - problem.predict(problem.baseline_start, ())


def test_at_one_rate_friction_of_any_kind_is_not_observable_and_nothing_is_found() -> None:
    time_s = np.arange(20000) / 500.0
    draws = np.random.default_rng(5)
    torque = 0.06 + draws.normal(0.0, 0.01, time_s.size)
    angle = np.mod(57.0 * time_s + draws.normal(0.0, 0.5 / 3600.0, time_s.size), 360.0)
    problem = drive_problem(recording_of({"time_s": time_s, "encoder_deg": angle, "torque_nm": torque}))
    assert found_in(problem) == {}
    none = np.zeros(problem.time_s.size)
    assert any("one rate only" in remark for remark in problem.remarks(none, none, problem.usable))


def test_a_ripple_is_looked_for_only_up_to_the_order_that_the_slowest_rows_resolve() -> None:
    def highest_order(steady: float) -> float:
        problem = drive_problem(recording_of(drive_channels(Truth(swing=0.02, steady=steady), 1, seconds=30.0)))
        found = problem.effects.get("cogging_torque")
        return 0.0 if found is None else found.parameters["order"].scan[-1]

    # the table turns at 0.3, 7 and 70 rad/s; in a row of 0.05 s half a turn of order 9 passes at 7 rad/s
    assert highest_order(0.01) == 72.0
    assert 9.0 <= highest_order(0.2) <= 40.0
    assert highest_order(2.0) == 0.0


def test_a_current_is_a_torque_by_the_constant_of_the_model() -> None:
    channels = drive_channels(Truth(coulomb=0.02), 1, seconds=30.0)
    by_torque = drive_problem(recording_of(channels))
    channels["current_a"] = channels.pop("torque_nm") / 0.4
    with pytest.raises(UsageError, match="torque_constant_nm_per_a"):
        drive_problem(recording_of(channels))
    by_current = problem_of(recording_of(channels, drive={"torque_constant_nm_per_a": 0.4}), "drive")
    assert by_current.measured == pytest.approx(by_torque.measured, abs=1e-12)
    told = by_current.model_of(by_current.baseline_start, (), 0.01)["parts"]["drive"]
    assert told["torque_constant_nm_per_a"] == 0.4


def test_a_measured_rate_takes_the_place_of_an_encoder() -> None:
    channels = drive_channels(Truth(), 1, seconds=60.0)
    angle = np.unwrap(channels.pop("encoder_deg"), period=360.0)
    channels["table_rate_dps"] = np.gradient(angle, channels["time_s"])
    problem = drive_problem(recording_of(channels))
    assert problem.baseline_start == pytest.approx([INERTIA, VISCOUS], rel=5e-3)


def test_a_lab_that_believes_in_another_inertia_has_its_change_weighed_by_the_torque() -> None:
    channels = drive_channels(Truth(), 1, seconds=60.0)
    problem = problem_of(recording_of(channels), "drive", model={"inertia_kg_m2": 0.04, "viscous_nm_s": VISCOUS})
    assert problem.believed
    assert problem.matters("inertia_kg_m2", 0.01) > 0.05
    estimated = problem_of(recording_of(channels), "drive")
    assert not estimated.believed
    assert estimated.matters("inertia_kg_m2", 0.01) == 0.0


def test_one_long_step_is_held_out_in_whole_pieces() -> None:
    problem = drive_problem(recording_of(drive_channels(Truth(), 1, seconds=30.0)))
    assert len(problem.steps) == len(problem.step_names) == 36
    assert held_out_steps(problem).sum() == 6
    assert (np.diff(problem.step) >= 0).all()
    assert problem.steps[0].t_end < problem.steps[1].t_start


def test_a_load_at_rest_shows_the_friction_that_holds_it_and_gravity_in_its_own_unit() -> None:
    """A geared servo lifts and holds a pendulum: it moves for a part of the time, and rests under load for the rest."""
    time_s = np.arange(0.0, 12.0, 0.005)
    angle = np.zeros(time_s.size)
    load = 300.0 * np.sin(1.3 * time_s) + 120.0 * np.sin(3.1 * time_s)
    rate = 0.0
    for i in range(1, time_s.size):
        pull = 400.0 * math.sin(angle[i - 1])
        holds = 40.0 + 0.3 * abs(load[i])
        push = load[i] - pull
        if rate == 0.0 and abs(push) <= holds:
            angle[i] = angle[i - 1]
            continue
        way = math.copysign(1.0, rate if rate != 0.0 else push)
        after = rate + 0.005 * (push - holds * way - 30.0 * rate) / 6.0
        rate = 0.0 if rate * after < 0.0 else after
        angle[i] = angle[i - 1] + 0.005 * rate
    read = np.degrees(np.round(angle / (2 * math.pi / 4096)) * 2 * math.pi / 4096)
    channels = {"time_s": time_s, "encoder_deg": read, "drive_load": np.round(load)}
    problem = drive_problem(recording_of(channels, channel_units={"drive_load": "count"}))
    assert problem.unit == "count"
    assert problem.baseline_units == ("count s2 rad-1", "count s rad-1")
    assert problem.rows.rests
    found = found_in(problem)
    assert "gravity" in found
    assert {"coulomb_friction", "gear_friction"} & set(found)
    assert found["gravity"].values["moment_nm"] == pytest.approx(400.0, rel=0.15)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"torque_nm": None}, "no step has the channels encoder_deg, torque_nm together"),
        ({"encoder_deg": None}, "no step has the channels encoder_deg, torque_nm together"),
        ({"encoder_deg": 0.0}, "the table turns for 0 s only"),
        ({"torque_nm": 0.0}, "the torque is 0 throughout; name its column"),
    ],
)
def test_what_is_missing_for_a_drive_is_said(change: dict[str, float | None], says: str) -> None:
    channels = drive_channels(Truth(), 1, seconds=20.0)
    for name, value in change.items():
        samples = channels.pop(name)
        if value is not None:
            channels[name] = np.full(samples.size, value)
    with pytest.raises(UsageError, match=says):
        drive_problem(recording_of(channels))


def test_a_recording_of_a_moment_is_too_short() -> None:
    with pytest.raises(UsageError, match="too short to tell an acceleration from noise"):
        drive_problem(recording_of(drive_channels(Truth(), 1, seconds=0.5)))


def test_a_torque_in_another_unit_than_its_name_is_refused() -> None:
    channels = drive_channels(Truth(), 1, seconds=20.0)
    with pytest.raises(UsageError, match="torque_nm is in 'V', its name promises 'N m'"):
        drive_problem(recording_of(channels, channel_units={"torque_nm": "V"}))


@pytest.mark.parametrize(
    ("model", "says"),
    [
        ({"inertia": 1.0}, r"\[drive\] inertia: no such field"),
        ({"inertia_kg_m2": 1.0}, r"\[drive\] viscous_nm_s: this field is missing"),
        ({"inertia_kg_m2": "1", "viscous_nm_s": 0.1}, r"\[drive\] inertia_kg_m2: expected a finite number"),
    ],
)
def test_a_wrong_field_of_the_model_is_named(model: dict[str, object], says: str) -> None:
    with pytest.raises(UsageError, match=says):
        drive_problem(recording_of(drive_channels(Truth(), 1, seconds=20.0)), model=model)


def _imported(name: str, folder: Path) -> Recording:
    output = folder / f"{name}.h5"
    import_recording(DATA / f"{name}.mat", MAP, output)
    return open_recording(output)


@pytest.mark.slow
@needs_shared("data/table_drive")
def test_a_motor_bench_rubs_dryly_and_its_torque_is_off_where_both_directions_are_read(tmp_path: Path) -> None:
    names = ("idf_neg_0.045_1", "idf_pos_0.065_1", "idf_pos_0.065_2")
    recordings = [_imported(name, tmp_path) for name in names]
    problem = drive_problem(join(recordings))
    found = found_in(problem)
    assert set(found) == {"coulomb_friction", "torque_offset"}
    assert found["coulomb_friction"].values["coulomb_nm"] == pytest.approx(0.0355, abs=0.001)
    assert found["torque_offset"].values["offset_nm"] == pytest.approx(0.0079, abs=0.0005)
    for recording in recordings:
        recording.close()


@needs_shared("data/table_drive")
def test_a_single_run_of_the_motor_bench_says_that_it_turns_one_way_only(tmp_path: Path) -> None:
    with _imported("idf_pos_0.065_2", tmp_path) as recording:
        problem = drive_problem(recording)
        found = found_in(problem)
    (only,) = found.values()
    assert only.identifier in ("coulomb_friction", "torque_offset")
    assert max(only.values.values()) == pytest.approx(0.0428, abs=0.0015)
    none = np.zeros(problem.time_s.size)
    assert any("one way only" in remark for remark in problem.remarks(none, none, problem.usable))
