"""The next experiment of a diagnosis, run at once on the simulated bench: from open to closed."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

from benchctl.bench import Bench, load_bench, template
from benchctl.campaign.opened import world_settings
from benchctl.cli.app import run_verb
from benchctl.cli.next_run import bench_of, run_next, write_next
from benchctl.diagnosis.gyro.problem import GyroProblem, gyro_problem
from benchctl.diagnosis.next_run.candidates import candidates
from benchctl.diagnosis.next_run.experiment import ALIKE, SETTLED, OpenPair, next_experiment
from benchctl.diagnosis.next_run.sampled import SampleNoise
from benchctl.diagnosis.result import NextExperiment
from benchctl.estimation.fit import Fit, Point, fit
from benchctl.estimation.noise import Whitener
from benchctl.recordings.reader import Recording, join, open_recording
from benchctl.toml_file import parse_toml
from benchctl_instruments.physics.effects.sensor_bandwidth import SensorBandwidth
from benchctl_instruments.physics.effects.timing_offset import TimingOffset
from tests.benchctl.diagnosis.example import pair

LAB: dict[str, Any] = {
    "K0_v_per_dps": 0.02,
    "U0_v": 0.01,
    "T0_c": 23.0,
    "k_T": [],
    "k_omega": [],
    "noise_v_rms": 5e-4,
    "output_limit_v": 8.0,
}

SLOW = '''"""Slow motion only."""

from benchctl.plan import Sine, Static, procedure


@procedure()
def slow():
    """Rest and slow swings."""
    for _ in range(3):
        yield Static(duration_s=10.0)
        yield Sine(amplitude_dps=60.0, frequency_hz=0.5, cycles=10)
'''


def bench_file(folder: Path) -> Path:
    """A bench whose gyro's samples come 4 ms late, of which its lab knows nothing."""
    import tomllib

    told = tomllib.loads(template())
    told["digitizer"]["sample_rate_hz"] = 100.0
    told |= {
        "simulation": LAB,
        "physics": {"seed": 3, "response": LAB},
        "effects": {"timing_offset": {"offset_s": 0.004}},
    }
    path = folder / "bench.toml"
    path.write_text(tomli_w.dumps(told), encoding="utf-8")
    return path


def recorded(folder: Path, verb: str) -> Path:
    """A short recording of slow motion, by `simulate` or over the wires by `run`."""
    (folder / "slow.py").write_text(SLOW, encoding="utf-8")
    arguments = [verb, folder / "slow.py", "--bench", bench_file(folder), "--quiet"]
    out = ["-o", folder / "slow.h5"] if verb == "simulate" else ["--out", folder / "campaign"]
    assert run_verb([str(argument) for argument in (*arguments, *out)]) == 0
    return folder / "slow.h5" if verb == "simulate" else folder / "campaign" / "recording.h5"


def rows_of(recording: Recording) -> tuple[GyroProblem, Whitener]:
    problem = gyro_problem(recording)
    weight = problem.usable.astype(np.float64)
    return problem, Whitener(interval_s=problem.interval_s, weight=weight)


def fitted(problem: GyroProblem, whitener: Whitener, point: Point) -> Fit:
    return fit(problem, whitener, point, np.ones(len(problem.step_names), np.bool_))


def settle(path: Path) -> tuple[float, float, float]:
    """What parts a delay from a low-pass before the next experiment, what that promises, and what parts them after."""
    with open_recording(path) as first:
        problem, whitener = rows_of(first)
        late = fitted(problem, whitener, Point(baseline=problem.baseline_start, effects=(TimingOffset(offset_s=1e-4),)))
        delay_s = late.point.effects[0].values["offset_s"]
        low_pass = SensorBandwidth(cutoff_hz=np.sqrt(2.0) / (2.0 * np.pi * delay_s), order=2.0)
        smooth = fitted(problem, whitener, Point(baseline=problem.baseline_start, effects=(low_pass,)))
        left_open = OpenPair(finding="timing_offset", rival="sensor_bandwidth", first=late, second=smooth)
        before = (left_open.second.squares - late.squares) / late.deviation**2
        stands = bench_of([path], None)
        following = next_experiment(problem, SampleNoise(white_v=late.deviation), [left_open], bench=stands)
        assert following.separation is not None
        with open_recording(run_next(following, stands, quiet=True)) as second:
            both, whitened = rows_of(join([first, second]))
            jointly = fitted(both, whitened, late.point)
            rival = fitted(both, whitened, left_open.second.point)
    (found,) = jointly.point.effects
    assert found.values["offset_s"] == pytest.approx(0.004, abs=2e-5)
    return before, following.separation, (rival.squares - jointly.squares) / jointly.deviation**2


def test_a_delay_or_a_low_pass_is_open_after_slow_motion_and_settled_by_the_next_experiment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    before, promised, after = settle(recorded(tmp_path, "simulate"))
    assert abs(before) < ALIKE
    assert promised >= SETTLED
    assert 0.5 * promised < after < 2.0 * promised


@pytest.mark.slow
@pytest.mark.timeout(120)
def test_the_same_over_the_wires(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    before, promised, after = settle(recorded(tmp_path, "run"))
    assert abs(before) < ALIKE < SETTLED <= promised
    assert after > 0.5 * promised


def test_what_is_written_for_another_day_passes_the_check(tmp_path: Path) -> None:
    stands = load_bench(str(bench_file(tmp_path)))
    proposed = [told for told, plan in candidates(stands) if plan.procedure == "sine_sweep" and told]
    following = NextExperiment(says="Run it: it tells.", procedure="sine_sweep", parameters=proposed[-1])
    told = write_next(tmp_path / "next.py", replace(pair(), next_experiment=following))
    assert told == f"next experiment: benchctl run {tmp_path / 'next.py'} --bench bench.toml"
    assert run_verb(["check", str(tmp_path / "next.py"), "--bench", str(tmp_path / "bench.toml"), "--quiet"]) == 0


def test_the_bench_of_another_day_has_the_same_encoder_and_other_noise(tmp_path: Path) -> None:
    made = recorded(tmp_path, "simulate")
    with open_recording(made) as recording:
        provenance = recording.meta.provenance
    before = parse_toml(provenance["bench_toml"], Bench, "bench.toml")
    before = before.model_copy(update={"physics": json.loads(provenance["bench_physics"])})
    days = [bench_of([made] * count, None) for count in (1, 2)]
    worlds = [world_settings(stands) for stands in (before, *days)]
    assert [world.encoder for world in worlds] == [worlds[0].encoder] * 3
    assert len({world.seed for world in worlds}) == 3
    assert all(stands.effects == {"timing_offset": {"offset_s": 0.004}} for stands in days)
