"""A bench whose digitizer is an NI device, over the interface of NI-DAQmx: a campaign, its fit, and the doctor."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchctl.app.fit import fit
from benchctl.bench import Bench, load_bench
from benchctl.campaign.opened import open_bench
from benchctl.campaign.runner import run_campaign
from benchctl.doctor.instruments import findings_of_instrument
from benchctl.plan.find import find_procedure
from benchctl.recordings.reader import open_recording
from benchctl_instruments.links.address import parse_address

pytest.importorskip("grpc", reason="NI's package is not installed: pip install 'benchctl[daqmx]'")


def ni_bench(address: str | None = None) -> Bench:
    document = load_bench("simulated").model_dump()
    document["digitizer"] |= {"model": "ni_daqmx", "address": address}
    return Bench.model_validate(document)


def test_constant_rates_are_recorded_and_fitted(tmp_path: Path) -> None:
    """The gyro of the simulated bench is U = U0 + K0/S·sin(S·ω): 50 mV/(deg/s), S = 4.5e-3, U0 = 12 mV."""
    plan = find_procedure("rate_sweep").expand({"soak_s": "60", "rates": "4", "verify": "no", "zero_s": "20"})
    with open_bench(ni_bench()) as opened:
        assert opened.identities["digitizer"].model == "USB-6343"
        outcome = run_campaign(plan, opened, tmp_path / "c")
    assert (outcome.status, outcome.error) == ("complete", None)
    with open_recording(outcome.recording) as recording:
        for step in list(recording.steps())[1:]:
            assert step.info.gaps == 0
            slope_dps = np.polyfit(step["time_s"], np.unwrap(step["encoder_deg"], period=360.0), 1)[0]
            assert slope_dps == pytest.approx(step.info.rate_dps or 0.0, abs=2e-3), step.info.name
    joint = fit([outcome.recording]).coefficients["joint"]["parameters"]
    assert joint["K0_v_per_dps"]["value"] == pytest.approx(0.05, rel=3e-4)
    assert joint["S_rad_per_dps"]["value"] == pytest.approx(4.5e-3, rel=1e-3)
    assert joint["U0_v"]["value"] == pytest.approx(0.012, abs=3e-4)


def test_the_doctor_tells_a_device_that_is_not_there_from_one_that_is() -> None:
    from benchctl_instruments.simulated.clock import ScaledClock
    from benchctl_instruments.simulated.ni_daqmx import SimulatedNiDaqmx
    from tests.instruments.simulated.fake_inputs import FakeInputs

    with SimulatedNiDaqmx(FakeInputs(ScaledClock(1.0))) as twin:
        for device, verdict, says in (
            ("Dev1", "ok", "answers as ni_daqmx at daqmx://127.0.0.1:"),
            ("Dev2", "bad", "Dev2: could not set up its inputs: NI-DAQmx states -200220, device identifier is invalid"),
        ):
            address = twin.address.replace("Dev1", device)
            bench = ni_bench(address)
            (finding,) = findings_of_instrument(bench, "digitizer", parse_address(address))
            assert (finding.verdict, says in finding.message) == (verdict, True), finding
