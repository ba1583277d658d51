"""The model that a lab states in its bench.toml goes into every recording."""

from pathlib import Path

import pytest

from benchctl.bench import load_bench, template
from benchctl.campaign.opened import open_bench
from benchctl.campaign.runner import run_campaign
from benchctl.plan import Plan, Static
from benchctl.recordings.reader import open_recording
from benchctl_instruments.errors import UsageError

STATED = """
[simulation]
K0_v_per_dps = 0.05
U0_v = 0.012
T0_c = 20.0
k_T = [-1.315e-4, 2.066e-6]
k_omega = []
noise_v_rms = 0.0006
output_limit_v = 11.0
"""


def bench_toml(folder: Path, text: str) -> str:
    path = folder / "bench.toml"
    path.write_text(template() + text, encoding="utf-8")
    return str(path)


def test_the_stated_model_is_in_the_recording(tmp_path: Path) -> None:
    bench = load_bench(bench_toml(tmp_path, STATED))
    plan = Plan(procedure="mine", parameters={}, steps=(Static(duration_s=1.0),), calibrates=False)
    with open_bench(bench, wires=False) as opened:
        outcome = run_campaign(plan, opened, tmp_path / "c")
    with open_recording(outcome.recording) as recording:
        assert recording.meta.simulation == {
            "K0_v_per_dps": 0.05,
            "U0_v": 0.012,
            "T0_c": 20.0,
            "k_T": [-1.315e-4, 2.066e-6],
            "k_omega": [],
            "noise_v_rms": 0.0006,
            "output_limit_v": 11.0,
        }


def test_a_bench_may_state_none() -> None:
    assert load_bench("simulated").simulation is None


def test_a_model_with_a_wrong_field_is_named(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"simulation\.K0"):
        load_bench(bench_toml(tmp_path, STATED.replace("K0_v_per_dps", "K0")))
