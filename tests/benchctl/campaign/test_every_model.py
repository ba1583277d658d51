"""A short campaign with every model of the catalog on the simulated bench, over its wires, however it is wired."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchctl.bench import Bench, load_bench
from benchctl.campaign.opened import open_bench
from benchctl.campaign.operator import MANUAL_RATE_ERROR
from benchctl.campaign.runner import run_campaign
from benchctl.plan import ConstantRate, Plan, Soak
from benchctl.recordings.reader import open_recording
from benchctl_instruments.catalog import MANUAL, Kind, fastest_hz, models
from benchctl_instruments.errors import UsageError

SOAKED_TO_C = 24.0
SOAK = Soak(setpoint_c=SOAKED_TO_C, hold_s=60.0, drift_c_per_min=10.0)
TURN = ConstantRate(rate_dps=20.0, duration_s=4.0)
TTY, BOX = "serial:///dev/ttyUSB0?baud=9600", "socket://10.0.0.7:4001"
needs_terminals = pytest.mark.skipif(sys.platform == "win32", reason="needs pseudo-terminals")

KINDS: tuple[Kind, ...] = ("rate_table", "chamber", "digitizer")
AS_DELIVERED = [(kind, model, {}, None) for kind in KINDS for model in models(kind)]
WIRED = [
    ("chamber", "watlow_f4", {"unit_id": 7, "on_event": 3}, BOX),
    ("chamber", "watlow_f4", {"on_event": None}, TTY),
    ("chamber", "watlow_f4t", {"unit_id": 2, "loop": 3, "word_order": "high_first"}, None),
    ("chamber", "watlow_f4t", {"on_by": "event", "on_number": 2, "running_output": [1, 1]}, None),
    ("chamber", "watlow_f4t", {"on_by": "momentary_key", "on_number": 3, "running_output": [1, 1]}, None),
    ("chamber", "watlow_f4t", {"on_by": "nothing"}, "tcp://10.0.0.7:502"),
    ("chamber", "watlow_f4t_scpi", {"loop": 2, "on_number": 3}, "tcp://10.0.0.7:5025"),
    ("chamber", "eurotherm_2400", {"unit_id": 9}, BOX),
    ("chamber", "binder_mb2", {"unit_id": 11, "word_order": "high_first"}, TTY),
    ("chamber", "binder_mb1", {"unit_id": 2}, BOX),
    ("chamber", "csz_ezt430i", {"unit_id": 12}, TTY),
    ("chamber", "espec_p300", {}, TTY),
    ("chamber", "espec_p300", {"rs485_address": 3}, TTY),
    ("chamber", "thermotron_3800", {}, BOX),
    ("chamber", "thermotron_8800", {"ramp_c_per_min": 2.0}, TTY),
    ("chamber", "weiss_ascii2", {"unit_id": 0}, TTY),
    ("chamber", "weiss_ascii2", {}, "tcp://10.0.0.7:2049"),
    ("rate_table", "newport_esp301", {}, BOX),
    ("rate_table", "acutrol3000", {}, "visa://GPIB0::7::INSTR"),
    ("digitizer", "labjack_t7", {"encoder_channel": 6, "gyro_ain": 4, "thermistor_ain": 0}, None),
    (
        "digitizer",
        "ni_daqmx",
        {"encoder_channel": 1, "gyro_ain": 7, "thermistor_ain": 3, "wiring": "rse"},
        "daqmx://Dev3",
    ),
    ("digitizer", "keithley_daq6510", {"gyro_channel": 120, "thermistor_channel": 103}, "tcp://10.0.0.8:5025"),
    ("digitizer", "keysight_34970a", {"gyro_channel": 105, "thermistor_channel": 101}, TTY),
]


def bench_with(kind: str, model: str, options: dict[str, Any], address: str | None) -> Bench:
    document = load_bench("simulated").model_dump()
    document[kind] |= {"model": model, "options": options, "address": address}
    if kind == "digitizer":
        document[kind]["sample_rate_hz"] = min(document[kind]["sample_rate_hz"], fastest_hz(model))
    if model == MANUAL:
        del document["limits"]["motion_error_percent"]  # its default is another one
    return Bench.model_validate(document)


@needs_terminals
@pytest.mark.parametrize(("kind", "model", "options", "address"), [*AS_DELIVERED, *WIRED])
def test_a_campaign_is_complete(
    kind: str, model: str, options: dict[str, Any], address: str | None, tmp_path: Path
) -> None:
    plan = Plan(procedure="mine", parameters={}, steps=(SOAK, TURN), calibrates=False)
    bench = bench_with(kind, model, options, address)
    with open_bench(bench) as opened:
        outcome = run_campaign(plan, opened, tmp_path / "c")
        assert opened.simulated is not None
        if address is not None:
            served = opened.simulated.addresses[kind].partition("://")[0]
            assert (served == "serial") == address.startswith("serial")
    assert (outcome.status, outcome.error) == ("complete", None)
    assert (outcome.safe.problems, outcome.safe.remarks) == ((), ())
    with open_recording(outcome.recording) as recording:
        soak, turn = recording.steps()
        assert soak["poll_chamber_setpoint_c"][-1] == pytest.approx(SOAKED_TO_C, abs=0.06)
        assert soak["poll_chamber_temp_c"][-1] == pytest.approx(SOAKED_TO_C, abs=SOAK.tolerance_c + 0.1)
        slope_dps = np.polyfit(turn["time_s"], np.unwrap(turn["encoder_deg"], period=360.0), 1)[0]
        off_dps = 1.05 * MANUAL_RATE_ERROR * TURN.rate_dps if bench.by_hand else 0.05
        assert slope_dps == pytest.approx(TURN.rate_dps, abs=off_dps)
        assert np.mean(turn["gyro_v"]) == pytest.approx(0.012 + 0.05 * slope_dps, abs=0.05)
        assert np.mean(turn["gyro_temp_c"]) == pytest.approx(23.5, abs=1.0)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"unitid": 5}, "chamber.options: watlow_f4 has no option 'unitid': did you mean unit_id\\?"),
        ({"unit_id": 5, "decimals": 2}, "chamber.options: watlow_f4 has no option 'decimals': there are "),
        ({"on_event": "two"}, "chamber.options: watlow_f4 cannot be made with them: "),
    ],
)
def test_options_that_cannot_be_are_one_line(options: dict[str, Any], says: str) -> None:
    with (
        pytest.raises(UsageError, match=f"^{says}") as refused,
        open_bench(bench_with("chamber", "watlow_f4", options, None)),
    ):
        pass
    assert "\n" not in str(refused.value)


def test_a_twin_that_cannot_be_made_is_one_line() -> None:
    bench = bench_with("chamber", "watlow_f4t", {"loop": "two"}, None)
    with (
        pytest.raises(UsageError, match=r"^chamber\.options: its simulated twin cannot be made with") as refused,
        open_bench(bench),
    ):
        pass
    assert "\n" not in str(refused.value)
