from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from benchctl_instruments.catalog import driver, twin
from benchctl_instruments.digitizers.labjack_t7 import LabJackT7
from benchctl_instruments.errors import InstrumentError, LinkError, UsageError
from benchctl_instruments.interfaces import Digitizer
from benchctl_instruments.links.modbus import ModbusLink
from benchctl_instruments.links.wirelog import WireLog
from benchctl_instruments.protocols.t7_stream import StreamReader
from benchctl_instruments.simulated.clock import ScaledClock, VirtualClock
from benchctl_instruments.simulated.labjack_t7 import SimulatedLabJackT7
from benchctl_instruments.simulated.modbus_server import ModbusTcpServer, RegisterTable, f32, u32
from tests.instruments.links.pairs import read_u32, write_u32
from tests.instruments.simulated.fake_inputs import FakeInputs
from tests.instruments.wire_transcript import Transcript


@pytest.fixture
def inputs() -> FakeInputs:
    return FakeInputs(VirtualClock(), first_count=-500, counts_per_s=1234.5)


@pytest.fixture
def server(inputs: FakeInputs) -> Iterator[SimulatedLabJackT7]:
    with SimulatedLabJackT7(inputs) as running:
        yield running


@pytest.fixture
def t7(server: SimulatedLabJackT7, inputs: FakeInputs) -> Iterator[LabJackT7]:
    with LabJackT7(server.address, server.stream_address, clock=inputs.clock) as opened:
        yield opened


def test_the_catalog_finds_the_driver_and_its_twin() -> None:
    assert driver("digitizer", "labjack_t7") is LabJackT7
    assert twin("digitizer", "labjack_t7") is SimulatedLabJackT7


def test_it_is_a_digitizer_and_says_who_it_is(t7: LabJackT7) -> None:
    digitizer: Digitizer = t7
    identity = digitizer.identify()
    assert (identity.manufacturer, identity.model, identity.serial, identity.firmware) == (
        "LabJack",
        "T7",
        "470012345",
        "1.0292",
    )


def test_single_readings_are_signed_counts_and_volts(t7: LabJackT7, inputs: FakeInputs) -> None:
    scan = t7.read_once()
    assert scan.encoder_count == -500
    assert (scan.gyro_v, scan.thermistor_v) == pytest.approx((-5.0, 0.25), abs=2e-6)
    inputs.clock.sleep(80.0)
    assert t7.read_once().encoder_count == -500 + int(80 * 1234.5)


@pytest.mark.parametrize(("gyro_ain", "thermistor_ain"), [(2, 3), (3, 2), (0, 5)])
def test_single_readings_are_those_of_the_inputs_that_are_wired_neighbours_or_not(
    inputs: FakeInputs, gyro_ain: int, thermistor_ain: int
) -> None:
    with (
        SimulatedLabJackT7(inputs, gyro_ain=gyro_ain, thermistor_ain=thermistor_ain) as wired,
        LabJackT7(
            wired.address, wired.stream_address, clock=inputs.clock, gyro_ain=gyro_ain, thermistor_ain=thermistor_ain
        ) as t7,
    ):
        scan = t7.read_once()
    assert (scan.gyro_v, scan.thermistor_v) == pytest.approx((-5.0, 0.25), abs=2e-6)


def test_neighbouring_inputs_are_read_with_one_request(server: SimulatedLabJackT7, inputs: FakeInputs) -> None:
    wire_log = WireLog()
    with LabJackT7(server.address, server.stream_address, clock=inputs.clock, wire_log=wire_log) as t7:
        t7.read_once()
    asked = [entry.data[-4:] for entry in wire_log.last(20) if entry.direction == "sent"]
    assert asked[-1] == bytes([0, 0, 0, 4])  # registers 0 to 3: AIN0 and AIN1


def test_a_stream_brings_every_scan_once_with_its_true_count_and_volts(t7: LabJackT7, inputs: FakeInputs) -> None:
    inputs.clock.sleep(3.0)
    start = t7.start_stream(200.0)
    assert start.rate_hz == 200.0
    assert start.start_s == pytest.approx(3.0, abs=1e-7)
    blocks = []
    for _ in range(30):
        inputs.clock.sleep(5.0)
        blocks.append(t7.read_stream(990, 5.0))
    assert [block.first_index for block in blocks] == [0, *np.cumsum([len(block.gyro_v) for block in blocks])[:-1]]
    count = np.concatenate([block.encoder_count for block in blocks])
    times_s = start.start_s + np.arange(len(count)) / start.rate_hz
    assert len(count) == pytest.approx(30_000, abs=10)
    assert count.tolist() == inputs.counts(times_s).tolist()
    gyro_v = np.concatenate([block.gyro_v for block in blocks])
    assert np.abs(gyro_v - inputs.gyro_v(times_s)).max() <= 20.0 / 65536
    assert blocks[-1].thermistor_v == pytest.approx(0.25, abs=2e-4)
    assert blocks[-1].backlog <= 10


def test_the_count_goes_on_where_its_32_bits_wrap(inputs: FakeInputs) -> None:
    inputs.first_count = 2**31 - 2000
    with (
        SimulatedLabJackT7(inputs) as server,
        LabJackT7(server.address, server.stream_address, clock=inputs.clock) as t7,
    ):
        assert t7.read_once().encoder_count == 2**31 - 2000
        t7.start_stream(100.0)
        inputs.clock.sleep(10.0)
        count = t7.read_stream(990, 5.0).encoder_count
    assert count[0] == 2**31 - 2000
    assert count[-1] > 2**31 + 9000


def test_the_start_is_counted_from_open_however_often_the_counter_has_wrapped(
    server: SimulatedLabJackT7, inputs: FakeInputs
) -> None:
    inputs.clock.sleep(10.0)
    with LabJackT7(server.address, server.stream_address, clock=inputs.clock) as t7:
        for waited_s in (0.0, 50.0, 107.4, 30 * 3600.0, 5.0):
            before_s = inputs.now() - 10.0
            inputs.clock.sleep(waited_s)
            assert t7.start_stream(100.0).start_s == pytest.approx(before_s + waited_s, abs=1e-6)
            t7.stop_stream()


@pytest.mark.parametrize(
    ("asked_hz", "actual_hz"), [(500.0, 500.0), (3000.0, 3000.3000300), (300.0, 300.0030000), (120.0, 119.9990400)]
)
def test_the_rate_of_a_stream_is_the_one_that_the_t7_does_and_the_instants_of_its_scans_follow_from_it(
    t7: LabJackT7, inputs: FakeInputs, asked_hz: float, actual_hz: float
) -> None:
    inputs.counts_per_s = 1e6
    inputs.clock.sleep(3.0)
    start = t7.start_stream(asked_hz)
    assert start.rate_hz == pytest.approx(actual_hz, rel=1e-7)
    inputs.clock.sleep(100.0)
    counts = t7.read_stream(int(99.0 * asked_hz), 10.0).encoder_count
    times_s = start.start_s + np.arange(len(counts)) / start.rate_hz
    assert np.abs(counts - inputs.counts(times_s)).max() <= 10  # 10 µs, of 10 ms that the asked rate would be off
    t7.stop_stream()
    assert t7.start_stream(asked_hz).rate_hz == start.rate_hz


def test_a_rate_that_is_far_from_the_one_that_was_asked_for_is_an_instrument_error(
    t7: LabJackT7, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("benchctl_instruments.simulated.labjack_t7.scan_rate", lambda rate_hz: rate_hz / 2.0)
    with pytest.raises(InstrumentError, match=r"asked for 100 scans a second, it scans 50 times"):
        t7.start_stream(100.0)


def answers_after(transcript: list[str], request: str) -> list[str]:
    """What goes over the wire from a request on, without the numbers of the transactions."""
    bare = [f"{line[0]} {line[8:]}" for line in transcript]
    return bare[bare.index(request) :]


def test_byte_for_byte_stopping_asks_for_the_one_word_of_last_err_detail_and_takes_2620_for_a_stopped_stream(
    server: SimulatedLabJackT7, inputs: FakeInputs
) -> None:
    transcript = Transcript()
    with LabJackT7(server.address, server.stream_address, clock=inputs.clock, wire_log=transcript.log) as t7:
        t7.stop_stream()
    assert answers_after(transcript.lines, "> 00 00 00 0B 01 10 13 7E 00 02 04 00 00 00 00")[:6] == [
        "> 00 00 00 0B 01 10 13 7E 00 02 04 00 00 00 00",  # 0 to STREAM_ENABLE, 4990
        "< 00 00 00 03 01 90 04",
        "> 00 00 00 06 01 03 D6 D8 00 01",  # one word from 55000
        "< 00 00 00 05 01 03 02 0A 3C",  # 2620
        "> 00 00 00 06 01 03 13 7E 00 02",
        "< 00 00 00 07 01 03 04 00 00 00 00",
    ]


def test_byte_for_byte_a_stream_is_enabled_and_then_its_actual_rate_is_read_from_4002(
    server: SimulatedLabJackT7, inputs: FakeInputs
) -> None:
    transcript = Transcript()
    with LabJackT7(server.address, server.stream_address, clock=inputs.clock, wire_log=transcript.log) as t7:
        assert t7.start_stream(3000.0).rate_hz == 3000.300048828125
    assert "> 00 00 00 0B 01 10 0F A2 00 02 04 45 3B 80 00" in answers_after(
        transcript.lines, "> 00 00 00 06 01 03 D7 3C 00 02"
    )
    assert answers_after(transcript.lines, "> 00 00 00 0B 01 10 13 7E 00 02 04 00 00 00 01")[1:4] == [
        "< 00 00 00 06 01 10 13 7E 00 02",
        "> 00 00 00 06 01 03 0F A2 00 02",
        "< 00 00 00 07 01 03 04 45 3B 84 CD",
    ]
    assert not any("03 11 8E" in line for line in transcript.lines)  # 4494 is no register of a T7


@pytest.mark.parametrize(("rate_hz", "samples"), [(1.0, 4), (100.0, 20), (1000.0, 200), (20_000.0, 512)])
def test_a_packet_lasts_fifty_milliseconds_at_most_or_holds_one_scan(
    t7: LabJackT7, server: SimulatedLabJackT7, rate_hz: float, samples: int
) -> None:
    t7.start_stream(rate_hz)
    link = ModbusLink(server.address)
    link.open()
    found = read_u32(link, 4006)
    link.close()
    assert found == samples


def test_reading_in_real_time_waits_for_the_scans_and_no_longer() -> None:
    clock = ScaledClock(1.0)
    with (
        SimulatedLabJackT7(FakeInputs(clock)) as server,
        LabJackT7(server.address, server.stream_address, clock=clock) as t7,
    ):
        t7.start_stream(1000.0)
        started_s = time.monotonic()
        block = t7.read_stream(300, 5.0)
        took_s = time.monotonic() - started_s
    assert len(block.gyro_v) >= 300
    assert 0.2 < took_s < 2.0


def test_too_few_scans_in_time_are_a_link_error_that_counts_them_and_loses_none(
    t7: LabJackT7, server: SimulatedLabJackT7, inputs: FakeInputs
) -> None:
    t7.start_stream(100.0)
    inputs.clock.sleep(1.0)
    with pytest.raises(LinkError, match=rf"{server.address}.*expected 500 scans within 0.3 s, 100 came.*nothing came"):
        t7.read_stream(500, 0.3)
    inputs.clock.sleep(4.0)
    block = t7.read_stream(500, 5.0)
    assert (block.first_index, len(block.gyro_v)) == (0, 500)


def test_a_stream_that_is_cut_is_a_link_error(t7: LabJackT7, server: SimulatedLabJackT7, inputs: FakeInputs) -> None:
    t7.start_stream(100.0)
    inputs.clock.sleep(1.0)
    t7.read_stream(100, 5.0)
    server._stream.stop()
    with pytest.raises(LinkError, match="expected 10 scans"):
        t7.read_stream(10, 2.0)


def test_a_gap_ends_a_block_and_the_next_one_starts_where_scanning_went_on(
    t7: LabJackT7, server: SimulatedLabJackT7, inputs: FakeInputs
) -> None:
    t7.start_stream(20_000.0)
    inputs.clock.sleep(60.0)
    sampled = -1
    while sampled != (sampled := len(inputs.calls)):
        time.sleep(0.1)
    inputs.clock.sleep(2.0)
    while server._stream._stream._kept_until is None:  # type: ignore[union-attr]
        time.sleep(0.01)
    end, block = 0, t7.read_stream(1, 5.0)
    while block.first_index == end:
        end += len(block.gyro_v)
        try:
            block = t7.read_stream(1, 0.2)
        except LinkError:  # all that was kept has come; new packets need new scans
            inputs.clock.sleep(0.05)
            block = t7.read_stream(1, 5.0)
    assert 60 * 20_000 + 4096 - 128 <= end <= 60 * 20_000 + 4096
    assert block.first_index == pytest.approx(62 * 20_000, abs=5000)
    times_s = (block.first_index + np.arange(len(block.gyro_v))) / 20_000.0
    assert np.abs(block.encoder_count - inputs.counts(times_s)).max() <= 1


def test_too_high_a_rate_is_an_instrument_error_that_says_so(t7: LabJackT7, inputs: FakeInputs) -> None:
    t7.start_stream(40_000.0)
    inputs.clock.sleep(1.0)
    with pytest.raises(InstrumentError, match=r"LabJack T7 at tcp.*2942.*lower rate"):
        t7.read_stream(1, 5.0)


def test_stopping_is_safe_at_any_time_and_a_stream_can_be_started_again(t7: LabJackT7, inputs: FakeInputs) -> None:
    t7.stop_stream()
    t7.start_stream(100.0)
    inputs.clock.sleep(1.0)
    t7.stop_stream()
    t7.stop_stream()
    inputs.clock.sleep(1.0)
    start = t7.start_stream(50.0)
    inputs.clock.sleep(1.0)
    block = t7.read_stream(48, 5.0)
    assert block.first_index == 0
    assert block.encoder_count[0] == inputs.counts(np.array([start.start_s]))[0]


@pytest.mark.parametrize("call", ["read_once", "start_stream"])
def test_a_stream_of_another_program_is_left_alone_until_this_one_is_told_to_stop_it(
    server: SimulatedLabJackT7, inputs: FakeInputs, call: str
) -> None:
    with LabJackT7(server.address, server.stream_address, clock=inputs.clock) as first:
        first.start_stream(100.0)
        with LabJackT7(server.address, server.stream_address, clock=inputs.clock) as second:
            assert second.identify().serial == first.identify().serial
            with pytest.raises(InstrumentError, match="a stream runs that this program did not start"):
                _ = second.read_once() if call == "read_once" else second.start_stream(100.0)
            inputs.clock.sleep(1.0)
            block = first.read_stream(90, 5.0)
            assert (block.first_index, len(block.gyro_v) >= 90) == (0, True)
            second.stop_stream()
            assert second.read_once().encoder_count == inputs.counts(np.array([inputs.clock.now()]))[0]


@pytest.fixture
def link(server: SimulatedLabJackT7) -> Iterator[ModbusLink]:
    other = ModbusLink(server.address)
    other.open()
    yield other
    other.close()


def test_an_encoder_input_that_counts_already_is_left_alone(
    server: SimulatedLabJackT7, link: ModbusLink, inputs: FakeInputs
) -> None:
    index, enable = 44100, 44000

    def features() -> list[list[int]]:
        return [[read_u32(link, first + 2 * line) for first in (index, enable)] for line in range(3)]

    with LabJackT7(server.address, server.stream_address, clock=inputs.clock) as t7:
        t7.read_once()
        assert features() == [[10, 1], [10, 1], [0, 0]]
        inputs.clock.sleep(1.0)
        read_u32(link, 3100)  # sets the count to zero
        assert t7.read_once().encoder_count == 0
    with LabJackT7(server.address, server.stream_address, clock=inputs.clock) as t7:
        assert t7.read_once().encoder_count == 0
    write_u32(link, enable + 2, 0)
    write_u32(link, index + 2, 7)
    with LabJackT7(server.address, server.stream_address, clock=inputs.clock) as t7:
        t7.read_once()
        assert features() == [[10, 1], [10, 1], [0, 0]]


def test_a_refused_setting_is_explained_in_labjacks_words(
    t7: LabJackT7, server: SimulatedLabJackT7, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("benchctl_instruments.digitizers.labjack_t7.BUFFER_BYTES", 3000)
    with pytest.raises(InstrumentError, match=r"STREAM_ENABLE.*LabJack error 2615, the buffer size is invalid"):
        t7.start_stream(100.0)
    monkeypatch.undo()
    assert t7.start_stream(100.0).rate_hz == 100.0


def test_a_second_stream_writes_nothing_that_is_as_the_first_one_left_it(
    t7: LabJackT7, server: SimulatedLabJackT7, monkeypatch: pytest.MonkeyPatch
) -> None:
    t7.start_stream(200.0)
    t7.stop_stream()
    written: list[int] = []
    keep = server._keep

    def noted(address: int, value: float) -> None:
        written.append(address)
        keep(address, value)

    monkeypatch.setattr(server, "_keep", noted)
    t7.start_stream(200.0)
    t7.stop_stream()
    assert written == [4002, 4018]  # one reads otherwise than written, the other perhaps cannot be read
    t7.start_stream(100.0)
    assert set(written) == {4018, 4002, 4006}


def test_a_setting_that_does_not_stay_is_an_instrument_error(
    t7: LabJackT7, server: SimulatedLabJackT7, monkeypatch: pytest.MonkeyPatch
) -> None:
    t7.read_once()
    monkeypatch.setattr(server, "_keep", lambda address, value: None)
    with pytest.raises(InstrumentError, match=r"wrote 4 to STREAM_NUM_ADDRESSES, acknowledged, reads 0"):
        t7.start_stream(100.0)


@pytest.mark.parametrize("call", ["read_once", "start_stream"])
def test_what_a_running_stream_forbids_is_a_usage_error(t7: LabJackT7, call: str) -> None:
    t7.start_stream(100.0)
    arguments: dict[str, Any] = {"rate_hz": 100.0} if call == "start_stream" else {}
    with pytest.raises(UsageError, match=rf"{call} while the stream runs"):
        getattr(t7, call)(**arguments)


def test_reading_without_a_stream_is_a_usage_error(t7: LabJackT7) -> None:
    with pytest.raises(UsageError, match="no stream runs"):
        t7.read_stream(1, 1.0)


@pytest.mark.parametrize("rate_hz", [0.0, -1.0, float("nan"), float("inf")])
def test_a_rate_that_is_none_is_a_usage_error(t7: LabJackT7, rate_hz: float) -> None:
    with pytest.raises(UsageError, match="scan rate"):
        t7.start_stream(rate_hz)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"address": "serial:///dev/ttyUSB0"}, "expected tcp://HOST:PORT"),
        ({"encoder_channel": 4}, r"encoder_channel 4.*\(0, 2, 6\)"),
        ({"range_v": 5.0}, r"range_v 5.0"),
    ],
)
def test_an_option_that_a_t7_does_not_have_is_a_usage_error(options: dict[str, Any], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        LabJackT7(**{"address": "tcp://127.0.0.1:502", "clock": VirtualClock(), **options})


@pytest.mark.parametrize(
    ("test", "product", "words"),
    [(0x22330011, 7.0, "low word first"), (0xDEADBEEF, 7.0, "DEADBEEFh"), (0x00112233, 4.0, r"product 7.*got 4")],
)
def test_what_is_no_t7_is_recognised_on_open(test: int, product: float, words: str) -> None:
    registers = RegisterTable([u32(55100, lambda: test), f32(60000, lambda: product)])
    with ModbusTcpServer(registers, unit_id=None) as server:
        t7 = LabJackT7(server.address, clock=VirtualClock())
        with pytest.raises(InstrumentError, match=words):
            t7.open()


def test_a_calibration_that_makes_no_sense_is_an_instrument_error(
    server: SimulatedLabJackT7, inputs: FakeInputs, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("benchctl_instruments.digitizers.labjack_t7.CALIBRATION_FLASH_ADDRESS", 0)
    with pytest.raises(InstrumentError, match="reading its flash, expected the calibration"):
        LabJackT7(server.address, server.stream_address, clock=inputs.clock).open()


def test_a_stream_port_where_nobody_listens_is_a_link_error_at_the_first_use_and_leaves_no_stream_behind(
    server: SimulatedLabJackT7, inputs: FakeInputs
) -> None:
    server._stream.stop()
    with LabJackT7(server.address, server.stream_address, clock=inputs.clock, timeout_s=0.5) as t7:
        with pytest.raises(LinkError, match=server.stream_address):
            t7.read_once()
        with pytest.raises(LinkError, match=server.stream_address):
            t7.start_stream(100.0)
        server._stream.start()
        assert t7.read_once().encoder_count == -500  # refused where a stream was left


def test_closing_twice_is_safe_and_a_closed_one_can_be_opened_again(t7: LabJackT7) -> None:
    t7.close()
    t7.close()
    t7.open()
    assert t7.read_once().encoder_count == -500


def test_no_thread_is_left_behind(inputs: FakeInputs) -> None:
    before = threading.active_count()
    with (
        SimulatedLabJackT7(inputs) as server,
        LabJackT7(server.address, server.stream_address, clock=inputs.clock) as t7,
    ):
        t7.start_stream(100.0)
        inputs.clock.sleep(1.0)
        t7.read_stream(10, 1.0)
    assert threading.active_count() == before


def test_packets_lost_on_the_way_are_a_gap_in_the_index(t7: LabJackT7, inputs: FakeInputs) -> None:
    t7.start_stream(100.0)
    inputs.clock.sleep(1.0)
    t7.read_stream(100, 5.0)
    assert t7._scans is not None
    reader: StreamReader = t7._scans._reader
    assert reader._next_transaction is not None
    reader._next_transaction -= 3  # as if three packets of five scans had been lost
    inputs.clock.sleep(1.0)
    assert t7.read_stream(100, 5.0).first_index == 115
