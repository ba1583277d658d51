from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

from benchctl_instruments.errors import InstrumentError, UsageError
from benchctl_instruments.links.address import parse_address
from benchctl_instruments.links.modbus import ModbusLink
from benchctl_instruments.protocols.t7_stream import ScanRun, StreamReader
from benchctl_instruments.simulated.clock import VirtualClock
from benchctl_instruments.simulated.labjack_t7 import SimulatedLabJackT7
from tests.instruments.links.pairs import read_f32, read_u32, write_f32, write_u32
from tests.instruments.simulated.fake_inputs import FakeInputs


@pytest.fixture
def inputs() -> FakeInputs:
    return FakeInputs(VirtualClock())


@pytest.fixture
def twin(inputs: FakeInputs) -> Iterator[SimulatedLabJackT7]:
    with SimulatedLabJackT7(inputs) as server:
        yield server


@pytest.fixture
def link(twin: SimulatedLabJackT7) -> Iterator[ModbusLink]:
    master = ModbusLink(twin.address)
    master.open()
    yield master
    master.close()


def connect(twin: SimulatedLabJackT7) -> socket.socket:
    where = parse_address(twin.stream_address)
    client = socket.create_connection((where.host, where.port), timeout=5.0)
    client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 16)
    return client


def set_up(link: ModbusLink, *, rate_hz: float = 1000.0, packet: int = 40, buffer_bytes: int = 4096) -> None:
    """Everything that a stream of the count needs but ENABLE, in plain registers."""
    for line in (0, 1):
        write_u32(link, 44100 + 2 * line, 10)
        write_u32(link, 44000 + 2 * line, 1)
    write_f32(link, 4002, rate_hz)
    for address, value in {4004: 3, 4006: packet, 4012: buffer_bytes, 4016: 1, 4018: 0, 4020: 0}.items():
        write_u32(link, address, value)
    for place, address in enumerate((3000, 4899, 0)):
        write_u32(link, 4100 + 2 * place, address)


def enable(link: ModbusLink, value: int = 1) -> None:
    write_u32(link, 4990, value)


def receive(client: socket.socket, reader: StreamReader, scans: int) -> list[ScanRun]:
    """Runs until that many scans have come."""
    runs: list[ScanRun] = []
    while sum(len(run.samples) for run in runs) < scans:
        data = client.recv(1 << 16)
        assert data, "the simulated T7 closed its stream"
        runs += reader.feed(data)
    return runs


def refused_with(link: ModbusLink, address: int, value: int) -> int:
    """LabJack's code for a write that must be refused."""
    with pytest.raises(InstrumentError, match="device failure"):
        write_u32(link, address, value)
    return link.read(55000)[0]


def test_constants_have_the_values_of_the_register_map(link: ModbusLink) -> None:
    assert read_u32(link, 55100) == 0x00112233
    assert read_f32(link, 55124) == -9999.0
    assert read_f32(link, 60000) == 7.0
    assert read_u32(link, 60028) == 470_012_345


def test_the_core_timer_runs_at_40_mhz_of_bench_time_and_wraps(link: ModbusLink, inputs: FakeInputs) -> None:
    before = read_u32(link, 61520)
    inputs.clock.sleep(120.0)
    after = read_u32(link, 61520)
    assert (after - before) % 2**32 == 120 * 40_000_000 % 2**32


def test_an_analog_input_reads_through_a_clipping_converter(link: ModbusLink, inputs: FakeInputs) -> None:
    inputs.clock.sleep(70.0)
    assert read_f32(link, 0) == pytest.approx(2.0, abs=1e-6)
    write_f32(link, 40000, 1.0)
    assert read_f32(link, 0) == pytest.approx(1.0, abs=1e-6)
    assert read_f32(link, 26) == pytest.approx(0.0, abs=1e-6)


def test_a_range_that_does_not_exist_becomes_the_next_larger_one(link: ModbusLink) -> None:
    write_f32(link, 40000, 0.5)
    assert read_f32(link, 40000) == 1.0
    write_f32(link, 40000, 0.0)
    assert read_f32(link, 40000) == 10.0


def test_the_count_reads_zero_until_quadrature_is_enabled_on_both_lines(link: ModbusLink, inputs: FakeInputs) -> None:
    inputs.clock.sleep(2.0)
    write_u32(link, 44100, 10)
    write_u32(link, 44000, 1)
    assert read_u32(link, 3000) == 0
    write_u32(link, 44102, 10)
    write_u32(link, 44002, 1)
    assert read_u32(link, 3000) == 2000


def test_the_feature_of_an_enabled_line_cannot_be_changed(link: ModbusLink) -> None:
    write_u32(link, 44000, 1)
    assert refused_with(link, 44100, 10) == 0


@pytest.mark.parametrize(
    ("address", "value", "code"),
    [
        (4004, 0, 2607),
        (4004, 200, 2607),
        (4100, 4899, 2607),
        (4102, 12345, 2607),
        (4002, 0, 2608),
        (4006, 513, 2618),
        (4006, 0, 2618),
        (4012, 3000, 2615),
        (4012, 65536, 2615),
        (4016, 16, 2612),
        (4016, 0, 2612),
        (4018, 1, 0),
    ],
)
def test_a_wrong_setting_is_refused_when_the_stream_is_enabled(
    link: ModbusLink, address: int, value: int, code: int
) -> None:
    set_up(link)
    write_u32(link, address, value)
    assert refused_with(link, 4990, 1) == code
    assert read_u32(link, 4990) == 0


def test_configuring_reading_inputs_and_enabling_again_are_refused_while_a_stream_runs(link: ModbusLink) -> None:
    set_up(link)
    enable(link)
    assert refused_with(link, 4006, 20) == 2605
    assert refused_with(link, 4990, 1) == 2605
    with pytest.raises(InstrumentError, match="device failure"):
        read_f32(link, 0)
    enable(link, 0)
    assert refused_with(link, 4990, 0) == 2620


def test_the_code_of_a_refusal_is_one_word_and_the_next_is_the_modbus_exception(link: ModbusLink) -> None:
    assert link.read(55000, 2) == [0, 0]
    assert refused_with(link, 4990, 0) == 2620
    assert link.read(55000, 2) == [2620, 4]


@pytest.mark.parametrize("address", [4494, 4000, 4018 + 10, 4500, 5000, 7000, 55002, 55300, 61500, 65534])
def test_a_register_that_a_t7_or_this_one_does_not_have_is_an_illegal_data_address(
    link: ModbusLink, address: int
) -> None:
    for attempt in (lambda: link.read(address), lambda: link.write(address, [0, 0])):
        with pytest.raises(InstrumentError, match="exception 2"):
            attempt()


@pytest.mark.parametrize(
    ("asked_hz", "actual_hz"),
    [
        (30_000.0, 10e6 / 333),
        (3000.0, 10e6 / 3333),
        (512.0, 10e6 / 19531),
        (152.7, 10e6 / 65488),
        (152.5, 5e6 / 32787),
        (120.0, 5e6 / 41667),
        (50.0, 50.0),
        (0.7, 10e6 / 256 / 55804),
    ],
)
def test_the_scan_interval_is_a_whole_number_of_steps_and_the_rate_reads_as_what_it_is(
    twin: SimulatedLabJackT7, link: ModbusLink, inputs: FakeInputs, asked_hz: float, actual_hz: float
) -> None:
    set_up(link, rate_hz=asked_hz, packet=3)
    for running in (0, 1):
        if running:
            enable(link)
        assert read_f32(link, 4002) == np.float32(actual_hz)
    with connect(twin) as client:
        inputs.clock.sleep(10.0)
        receive(client, StreamReader(3), int(9.0 * actual_hz))
    assert [interval_s for _, interval_s, _ in inputs.calls] == pytest.approx([1.0 / actual_hz] * len(inputs.calls))


def test_a_jump_of_bench_time_brings_all_scans_of_it(
    twin: SimulatedLabJackT7, link: ModbusLink, inputs: FakeInputs
) -> None:
    set_up(link)
    with connect(twin) as client:
        inputs.clock.sleep(7.25)
        enable(link)
        assert read_u32(link, 4026) == (0xF000_0000 + int(7.25 * 40e6)) & 0xFFFFFFFF
        inputs.clock.sleep(100.0)
        runs = receive(client, StreamReader(3), 99_990)
    samples = np.concatenate([run.samples for run in runs]).astype(np.int64)
    times_s = 7.25 + np.arange(len(samples)) / 1000.0
    assert (samples[:, 0] | samples[:, 1] << 16).tolist() == inputs.counts(times_s).tolist()
    assert samples[:, 2] * 20.0 / 65536 - 10.0 == pytest.approx(inputs.gyro_v(times_s), abs=2e-4)


def test_as_many_scans_are_taken_as_were_due_when_it_was_stopped_however_far_the_sender_had_come(
    link: ModbusLink, inputs: FakeInputs
) -> None:
    set_up(link)
    for _ in range(20):
        inputs.calls.clear()
        enable(link)
        inputs.clock.sleep(0.1035)
        enable(link, 0)
        assert sum(scans for _, _, scans in inputs.calls) == 104


def test_a_client_that_connects_late_still_gets_the_first_scan(
    twin: SimulatedLabJackT7, link: ModbusLink, inputs: FakeInputs
) -> None:
    set_up(link)
    enable(link)
    inputs.clock.sleep(0.4)
    time.sleep(0.05)
    with connect(twin) as client:
        assert receive(client, StreamReader(3), 100)[0].first_index == 0


def test_a_new_client_begins_with_a_whole_packet(
    twin: SimulatedLabJackT7, link: ModbusLink, inputs: FakeInputs
) -> None:
    set_up(link, packet=509)
    with connect(twin) as first:
        enable(link)
        inputs.clock.sleep(400.0)  # more than the wire holds
        first.recv(1)
        time.sleep(0.1)
        with connect(twin) as second:
            runs = receive(second, StreamReader(3), 1000)
    assert len(runs[0].samples) > 0


def test_a_client_that_does_not_read_makes_the_buffer_overflow_and_learns_how_much_is_missing(
    twin: SimulatedLabJackT7, link: ModbusLink, inputs: FakeInputs
) -> None:
    set_up(link, rate_hz=25_000.0, packet=510)
    with connect(twin) as client:
        enable(link)
        inputs.clock.sleep(20.0)  # 500000 scans, far more than the wire holds: these are on their way
        sampled = -1
        while sampled != (sampled := len(inputs.calls)):
            time.sleep(0.1)
        inputs.clock.sleep(1.0)  # 25000 scans for a buffer of 682
        while twin._stream._stream._kept_until is None:  # type: ignore[union-attr]
            time.sleep(0.01)
        client.settimeout(0.2)
        reader, found = StreamReader(3), list[ScanRun]()
        while reader.skipped_scans == 0:
            try:
                found += reader.feed(client.recv(1 << 18))
            except TimeoutError:  # all that was kept has come; new packets need new scans
                inputs.clock.sleep(0.05)
    assert reader.lost_packets == 0
    assert 24_000 < reader.skipped_scans < 26_000
    before, after = (next(run for run in runs if len(run.samples)) for runs in (found, found[::-1]))
    times_s = (after.first_index + np.arange(len(after.samples))) / 25_000.0
    assert before.first_index == 0
    counts = after.samples[:, 0].astype(np.int64) | after.samples[:, 1].astype(np.int64) << 16
    assert np.abs(counts - inputs.counts(times_s)).max() <= 1


def test_no_bench_time_costs_anything_while_no_stream_runs(link: ModbusLink, inputs: FakeInputs) -> None:
    set_up(link)
    enable(link)
    enable(link, 0)
    time.sleep(0.05)
    sampled = len(inputs.calls)
    inputs.clock.sleep(30 * 3600.0)
    time.sleep(0.05)
    assert len(inputs.calls) == sampled
    assert inputs.held_since_s is None


def test_history_is_held_from_the_next_scan_on_while_a_stream_runs(
    twin: SimulatedLabJackT7, link: ModbusLink, inputs: FakeInputs
) -> None:
    set_up(link)
    inputs.clock.sleep(3.0)
    with connect(twin) as client:
        enable(link)
        assert inputs.held_since_s == 3.0
        inputs.clock.sleep(2.0)
        receive(client, StreamReader(3), 1980)
    assert inputs.held_since_s == pytest.approx(5.0, abs=0.02)
    enable(link, 0)
    assert inputs.held_since_s is None


def test_a_port_that_is_taken_leaves_no_thread_behind(inputs: FakeInputs) -> None:
    twin = SimulatedLabJackT7(inputs)
    with twin:
        place = parse_address(twin.address)
    before = threading.active_count()
    with socket.create_server((place.host, place.port)), pytest.raises(UsageError, match="choose another port"):
        twin.start()
    assert threading.active_count() == before


def test_it_can_be_stopped_twice_and_started_again_at_the_same_place(inputs: FakeInputs) -> None:
    twin = SimulatedLabJackT7(inputs)
    with twin:
        addresses = twin.address, twin.stream_address
    twin.stop()
    with twin:
        assert (twin.address, twin.stream_address) == addresses
