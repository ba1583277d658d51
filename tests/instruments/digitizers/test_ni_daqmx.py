"""The driver of NI devices: its calls of NI-DAQmx, one by one, against a simulated device, and what it refuses."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

pytest.importorskip("nidaqmx", reason="NI's package is not installed: pip install 'benchctl[daqmx]'")
pytest.importorskip("grpc", reason="gRPC is not installed: pip install 'benchctl[daqmx]'")

import grpc
import nidaqmx
from google.protobuf.json_format import MessageToDict
from nidaqmx.constants import AcquisitionType, AngleUnits, TerminalConfiguration
from nidaqmx.errors import DaqError, DaqNotFoundError

from benchctl_instruments.digitizers import ni_daqmx
from benchctl_instruments.digitizers.ni_daqmx import NiDaqmx
from benchctl_instruments.errors import InstrumentError, LinkError, UsageError
from benchctl_instruments.interfaces import Identity
from benchctl_instruments.links.daqmx import OVERRUNS, DaqmxLink
from benchctl_instruments.simulated.clock import ScaledClock, VirtualClock
from benchctl_instruments.simulated.ni_daqmx import SimulatedNiDaqmx
from tests.instruments.digitizers.daqmx_c_library import CLibrary
from tests.instruments.simulated.fake_inputs import FakeInputs

NAMES = ("task", "sessionName", "zidxPhaseRaw", "activeEdgeRaw", "unitsRaw", "fillModeRaw", "arraySizeInSamps")


@pytest.fixture
def inputs() -> FakeInputs:
    return FakeInputs(VirtualClock(), first_count=7)


@pytest.fixture
def twin(inputs: FakeInputs) -> Iterator[SimulatedNiDaqmx]:
    with SimulatedNiDaqmx(inputs) as twin:
        yield twin


@pytest.fixture
def digitizer(twin: SimulatedNiDaqmx, inputs: FakeInputs) -> Iterator[NiDaqmx]:
    with NiDaqmx(twin.address, clock=inputs.clock) as digitizer:
        yield digitizer


@contextmanager
def tasks_of(twin: SimulatedNiDaqmx) -> Iterator[Any]:
    """The options with which another program's tasks reach the device."""
    with grpc.insecure_channel(twin.address.split("/")[2]) as channel:
        yield nidaqmx.GrpcSessionOptions(channel, "")


def commands(twin: SimulatedNiDaqmx) -> list[tuple[str, dict[str, Any]]]:
    """The calls that set or read something, without what is the same in each of them."""
    shown = [(name, MessageToDict(message)) for name, message in twin.calls if not name.startswith("Get")]
    return [(name, {key: value for key, value in fields.items() if key not in NAMES}) for name, fields in shown]


def test_the_counter_is_set_up_and_started_before_the_inputs_whose_clock_latches_it(inputs: FakeInputs) -> None:
    with (
        SimulatedNiDaqmx(inputs, encoder_channel=1, gyro_ain=4) as twin,
        NiDaqmx(twin.address, clock=inputs.clock, encoder_channel=1, gyro_ain=4, wiring="rse", range_v=5.0) as driver,
    ):
        driver.start_stream(500.0)
        inputs.clock.sleep(0.002)
        driver.read_stream(2, 1.0)
        driver.stop_stream()
    volts = {"terminalConfigRaw": 10083, "minVal": -5.0, "maxVal": 5.0}
    every = {"sampleModeRaw": 10123, "sampsPerChan": "1000000"}
    two = {"numSampsPerChan": 2, "timeout": 5.0}
    assert commands(twin) == [
        ("CreateTask", {}),
        ("CreateCIAngEncoderChan", {"counter": "Dev1/ctr1", "decodingTypeRaw": 10092, "pulsesPerRev": 90}),
        ("CfgSampClkTiming", {"source": "/Dev1/ai/SampleClock", "rate": 100000.0, **every}),
        ("CreateTask", {}),
        ("CreateAIVoltageChan", {"physicalChannel": "Dev1/ai4", **volts}),
        ("CreateAIVoltageChan", {"physicalChannel": "Dev1/ai1", **volts}),
        ("StartTask", {}),
        ("CfgSampClkTiming", {"rate": 500.0, **every}),
        ("StartTask", {}),
        ("ReadAnalogF64", two),
        ("ReadCounterF64Ex", two),
        ("StopTask", {}),
        ("ClearTask", {}),
        ("ClearTask", {}),
    ]
    started = [message.task.name for name, message in twin.calls if name == "StartTask"]
    created = {name: message.task.name for name, message in twin.calls if name.startswith(("CreateCI", "CreateAI"))}
    assert started == [created["CreateCIAngEncoderChan"], created["CreateAIVoltageChan"]]


def test_count_and_volts_of_a_scan_belong_to_one_instant(digitizer: NiDaqmx, inputs: FakeInputs) -> None:
    inputs.clock.sleep(3.0)
    start = digitizer.start_stream(3000.0)
    assert start.rate_hz == 100e6 / 33333  # a whole number of periods of the time base
    assert start.start_s == pytest.approx(3.0)
    inputs.clock.sleep(2.0)
    blocks = [digitizer.read_stream(1000, 1.0), digitizer.read_stream(1000, 1.0)]
    assert [(block.first_index, len(block.gyro_v)) for block in blocks] == [(0, 6001), (6001, 1000)]
    times_s = 3.0 + np.arange(7001) / start.rate_hz
    counts, volts = (np.concatenate([getattr(block, name) for block in blocks]) for name in ("encoder_count", "gyro_v"))
    assert np.array_equal(counts, inputs.counts(times_s) - 7)  # a count begins when the counter's task starts
    assert volts == pytest.approx(inputs.gyro_v(times_s), abs=10.0 / 2**16)
    assert blocks[0].thermistor_v == pytest.approx(0.25, abs=10.0 / 2**16)


@pytest.fixture
def c_library(inputs: FakeInputs, monkeypatch: pytest.MonkeyPatch) -> SimulatedNiDaqmx:
    """A simulated device that `nidaqmx` reaches as a library of this computer, in place of NI's."""
    from nidaqmx._lib import lib_importer as importer

    twin = SimulatedNiDaqmx(inputs)
    library = CLibrary(twin)
    for name, value in (("_windll", library), ("_cdll", library), ("_encoding", "utf-8")):
        monkeypatch.setattr(importer, name, value)
    return twin


def test_through_nis_c_interface_on_this_computer_the_same_calls_bring_the_same_scans(
    c_library: SimulatedNiDaqmx, twin: SimulatedNiDaqmx, inputs: FakeInputs
) -> None:
    drivers = [NiDaqmx(address, clock=inputs.clock) for address in ("daqmx://Dev1", twin.address)]
    for driver in drivers:
        driver.open()
        driver.start_stream(500.0)
    inputs.clock.sleep(1.0)
    here, there = (driver.read_stream(501, 1.0) for driver in drivers)
    assert np.array_equal(here.encoder_count, there.encoder_count)
    assert np.array_equal(here.gyro_v, there.gyro_v)
    assert np.array_equal(here.thermistor_v, there.thermistor_v)
    assert np.ptp(here.encoder_count) == 1000
    identities = [driver.identify() for driver in drivers]
    assert identities[0] == identities[1]
    for driver in drivers:
        driver.close()
    here_called, there_called = ([name for name, _ in each.calls if name[:3] != "Get"] for each in (c_library, twin))
    assert here_called == there_called


def test_an_overflow_at_nis_c_interface_says_the_same(
    c_library: SimulatedNiDaqmx, inputs: FakeInputs, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ni_daqmx, "BUFFER_SCANS", 1000)
    with NiDaqmx("daqmx://Dev1", clock=inputs.clock) as digitizer:
        digitizer.start_stream(500.0)
        inputs.clock.sleep(3.0)
        with pytest.raises(InstrumentError, match=r"Dev1: could not read 1501 scans: NI-DAQmx states -200279, the app"):
            digitizer.read_stream(100, 1.0)


def test_the_count_goes_on_between_two_streams_and_single_readings(digitizer: NiDaqmx, inputs: FakeInputs) -> None:
    seen = []
    for _ in range(3):
        inputs.clock.sleep(10.0)
        seen.append(digitizer.read_once().encoder_count)
        digitizer.start_stream(100.0)
        inputs.clock.sleep(1.0)
        seen.append(int(digitizer.read_stream(101, 1.0).encoder_count[-1]))
        inputs.clock.sleep(0.5)  # these scans are discarded
        digitizer.stop_stream()
    assert seen == [10_000, 11_050, 21_600, 22_650, 33_200, 34_250]  # each stop waits for 50 ms


def test_a_counter_of_32_bits_that_wraps_is_continued(twin: SimulatedNiDaqmx, inputs: FakeInputs) -> None:
    inputs.counts_per_s = 1e9
    with NiDaqmx(twin.address, clock=inputs.clock) as digitizer:
        digitizer.start_stream(100.0)
        inputs.clock.sleep(10.0)
        assert digitizer.read_stream(1, 1.0).encoder_count[-1] == 10_000_000_000


def test_a_device_states_model_and_serial_number(digitizer: NiDaqmx) -> None:
    assert digitizer.identify() == Identity(manufacturer="NI", model="USB-6343", serial="01A2B3C4")


def test_a_buffer_that_overflows_says_that_scans_are_lost(
    twin: SimulatedNiDaqmx, inputs: FakeInputs, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ni_daqmx, "BUFFER_SCANS", 1000)
    with NiDaqmx(twin.address, clock=inputs.clock) as digitizer:
        digitizer.start_stream(500.0)
        inputs.clock.sleep(3.0)
        with pytest.raises(
            InstrumentError,
            match=r"^NI-DAQmx device at daqmx://127\S+/Dev1: could not read 1501 scans: NI-DAQmx states -200279, the"
            r" application is not able to keep up .*; scans are lost: lower sample_rate_hz",
        ):
            digitizer.read_stream(100, 1.0)


def test_the_codes_of_overruns_are_those_of_nis_package() -> None:
    from nidaqmx.error_codes import DAQmxErrors

    words = ("OVERRUN", "OVERWRIT", "OVERFLOW", "SAMPLES_NO_LONGER_AVAILABLE")
    assert all(any(word in DAQmxErrors(code).name for word in words) for code in OVERRUNS)


def test_scans_that_do_not_come_are_counted_and_kept(digitizer: NiDaqmx, inputs: FakeInputs) -> None:
    digitizer.start_stream(10.0)
    inputs.clock.sleep = lambda seconds: None  # type: ignore[method-assign]
    with pytest.raises(LinkError, match=r"expected 5 scans within 0\.05 s, 1 came; check that its sample clock runs"):
        digitizer.read_stream(5, 0.05)
    del inputs.clock.sleep  # type: ignore[attr-defined]
    assert digitizer.read_stream(5, 1.0).first_index == 0


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"encoder_channel": 4}, "NI-DAQmx states -200170, physical channel specified does not exist on this device"),
        ({"gyro_ain": 32}, "NI-DAQmx states -200170, physical channel specified does not exist on this device"),
        ({"range_v": 20.0}, "NI-DAQmx states -200077, requested value is not a supported value for this property"),
    ],
)
def test_what_ni_daqmx_refuses_is_told_with_its_code(
    twin: SimulatedNiDaqmx, inputs: FakeInputs, options: dict[str, Any], says: str
) -> None:
    with (
        pytest.raises(InstrumentError, match=rf"could not set up its inputs: {says}; check that no other program"),
        NiDaqmx(twin.address, clock=inputs.clock, **options),
    ):
        pass


def test_a_device_that_is_not_there_is_told_with_its_name(twin: SimulatedNiDaqmx, inputs: FakeInputs) -> None:
    with (
        pytest.raises(InstrumentError, match=r"/Dev2: could not set up its inputs: .* -200220, device identifier is"),
        NiDaqmx(twin.address.replace("Dev1", "Dev2"), clock=inputs.clock),
    ):
        pass


def test_a_device_that_another_program_has_is_told(
    twin: SimulatedNiDaqmx, digitizer: NiDaqmx, inputs: FakeInputs
) -> None:
    with tasks_of(twin) as options, nidaqmx.Task(grpc_options=options) as other:
        other.ai_channels.add_ai_voltage_chan("Dev1/ai2")
        other.start()
        with pytest.raises(
            InstrumentError, match=r"could not start to scan at 500 Hz: NI-DAQmx states -50103, the spec"
        ):
            digitizer.start_stream(500.0)


def test_a_server_that_does_not_answer_is_a_fault_of_the_link(twin: SimulatedNiDaqmx, inputs: FakeInputs) -> None:
    driver = NiDaqmx(twin.address, clock=inputs.clock, timeout_s=0.3)
    with SimulatedNiDaqmx(inputs) as gone:
        address = gone.address
    with pytest.raises(LinkError, match=r"no NI gRPC Device Server answers within 0\.3 s; check that it runs there"):
        NiDaqmx(address, clock=inputs.clock, timeout_s=0.3).open()
    with driver:
        twin.__exit__()
        with pytest.raises(LinkError, match=r"could not start to scan at 100 Hz: .*UNAVAILABLE"):
            driver.start_stream(100.0)


def test_a_call_that_is_not_answered_ends_after_its_timeout(twin: SimulatedNiDaqmx, inputs: FakeInputs) -> None:
    with (
        NiDaqmx(twin.address, clock=inputs.clock, timeout_s=0.3) as driver,
        twin._lock,
        pytest.raises(LinkError, match=r"could not start to scan at 100 Hz: .*DEADLINE_EXCEEDED"),
    ):
        driver.start_stream(100.0)


def test_without_nis_driver_it_says_what_to_install(inputs: FakeInputs) -> None:
    try:
        nidaqmx.Task().close()
    except DaqNotFoundError:
        pass
    else:
        pytest.skip("NI-DAQmx is installed on this computer")
    with (
        pytest.raises(
            UsageError, match=r"Dev1: could not find an installation of NI-DAQmx; install NI's driver NI-DAQ"
        ),
        NiDaqmx("daqmx://Dev1", clock=inputs.clock),
    ):
        pass


def test_without_nis_package_it_says_what_to_install(inputs: FakeInputs, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("nidaqmx", "nidaqmx._stubs"):
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(UsageError, match=r"nidaqmx, which is not installed: pip install 'benchctl\[daqmx\]'$"):
        NiDaqmx("daqmx://Dev1", clock=inputs.clock).open()
    with pytest.raises(UsageError, match=r"nidaqmx, which is not installed: pip install 'benchctl\[daqmx\]'$"):
        SimulatedNiDaqmx(inputs).__enter__()


@pytest.mark.parametrize(
    ("address", "says"),
    [
        ("tcp://10.0.0.7:502", "expected daqmx://Dev1, or daqmx://HOST:PORT/Dev1, for an NI-DAQmx device"),
        ("daqmx://", "the name of the device is missing, or is none"),
        ("daqmx://10.0.0.7/Dev1", "the port is missing or 0"),
        ("daqmx://10.0.0.7:31763", "the name of the device is missing, or is none"),
    ],
)
def test_an_address_that_is_none_is_refused(inputs: FakeInputs, address: str, says: str) -> None:
    with pytest.raises(UsageError, match=says):
        NiDaqmx(address, clock=inputs.clock)


def test_a_wiring_that_there_is_not_is_refused(inputs: FakeInputs) -> None:
    with pytest.raises(UsageError, match="wiring = 'pseudo': expected one of default, differential, rse, nrse"):
        NiDaqmx("daqmx://Dev1", clock=inputs.clock, wiring="pseudo")


def test_a_stream_is_started_once_and_read_while_it_runs(digitizer: NiDaqmx) -> None:
    with pytest.raises(UsageError, match="read_stream while no stream runs"):
        digitizer.read_stream(1, 0.1)
    with pytest.raises(UsageError, match="a scan rate of inf Hz"):
        digitizer.start_stream(math.inf)
    digitizer.start_stream(100.0)
    with pytest.raises(UsageError, match="a stream runs already"):
        digitizer.read_once()
    digitizer.stop_stream()
    digitizer.stop_stream()
    digitizer.close()
    with pytest.raises(UsageError, match="it is not open"):
        digitizer.start_stream(100.0)


def test_the_link_of_a_device_of_this_computer_has_no_server() -> None:
    link = DaqmxLink("daqmx://Dev1", name="device", timeout_s=1.0)
    link.open()
    assert (link.grpc_options, link.address.host, link.address.device) == (None, "", "Dev1")
    link.close()


@pytest.mark.foreign_client(
    "ni_daqmx", "nidaqmx, calls of step305/MEMS_Gyro_Tests", "samples nine inputs for a while", package="nidaqmx"
)
def test_a_public_gyro_bench_samples_its_inputs() -> None:
    inputs = FakeInputs(ScaledClock(1.0))
    with SimulatedNiDaqmx(inputs) as twin, tasks_of(twin) as options, nidaqmx.Task(grpc_options=options) as task:
        for number in range(9):
            task.ai_channels.add_ai_voltage_chan(
                f"Dev1/ai{number:d}", terminal_config=TerminalConfiguration.RSE, min_val=-10, max_val=10
            )
        task.timing.cfg_samp_clk_timing(rate=1000, sample_mode=AcquisitionType.FINITE, samps_per_chan=100)
        for _ in range(2):
            data = task.read(number_of_samples_per_channel=100, timeout=100 / 1000 * 1.6)
            assert (len(data), len(data[0])) == (9, 100)
            assert np.diff(data[0]) == pytest.approx(1e-4, abs=2 * 20.0 / 2**16)  # a ramp of 0.1 V/s
            assert data[1] == pytest.approx([0.25] * 100, abs=10.0 / 2**16)
            assert np.ptp(data[2:]) == 0.0
            task.stop()


@pytest.mark.foreign_client("ni_daqmx", "nidaqmx", "reads an encoder on the inputs' sample clock", package="nidaqmx")
def test_nis_package_reads_an_encoder_in_degrees() -> None:
    inputs = FakeInputs(ScaledClock(1.0), counts_per_s=9000.0)
    with SimulatedNiDaqmx(inputs) as twin, tasks_of(twin) as options, nidaqmx.Task(grpc_options=options) as counter:
        counter.ci_channels.add_ci_ang_encoder_chan(
            "Dev1/ctr0", units=AngleUnits.DEGREES, pulses_per_rev=9000, initial_angle=10.0
        )
        counter.timing.cfg_samp_clk_timing(
            1000.0, source="/Dev1/ai/SampleClock", sample_mode=AcquisitionType.CONTINUOUS
        )
        counter.start()
        with nidaqmx.Task(grpc_options=options) as analog:
            analog.ai_channels.add_ai_voltage_chan("Dev1/ai0")
            analog.timing.cfg_samp_clk_timing(1000.0, sample_mode=AcquisitionType.CONTINUOUS)
            analog.start()
            analog.read(number_of_samples_per_channel=100, timeout=2.0)
            degrees = np.array(counter.read(number_of_samples_per_channel=100, timeout=2.0))
        assert np.polyfit(np.arange(100) / 1000.0, degrees, 1)[0] == pytest.approx(90.0, rel=1e-2)
        assert degrees[0] >= 10.0
        with pytest.raises(DaqError, match="not yet been acquired"):
            counter.read(number_of_samples_per_channel=10_000, timeout=0.0)
