"""The driver against the simulated gyro, over a real pseudo-terminal or a real socket."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator

import numpy as np
import pytest

from benchctl_instruments.errors import InstrumentError, LinkError, UsageError
from benchctl_instruments.gyros.kvh_dsp1760 import KvhDsp1760
from benchctl_instruments.interfaces import Gyro, Identity
from benchctl_instruments.simulated.clock import ScaledClock, VirtualClock
from benchctl_instruments.simulated.kvh_dsp1760 import SimulatedKvhDsp1760
from benchctl_instruments.simulated.push_line import PushLine
from tests.instruments.gyros.gyro_inputs import SETTINGS, RampInputs

LINES = [
    pytest.param(False, marks=pytest.mark.skipif(sys.platform == "win32", reason="needs pseudo-terminals")),
    True,
]


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


@pytest.fixture
def inputs(clock: VirtualClock) -> RampInputs:
    return RampInputs(clock, rate_dps=-30.0, ramp_dps2=10.0)


@pytest.fixture(params=LINES, ids=lambda over_tcp: "tcp" if over_tcp else "pty")
def twin(inputs: RampInputs, request: pytest.FixtureRequest) -> Iterator[SimulatedKvhDsp1760]:
    with SimulatedKvhDsp1760(inputs, SETTINGS, over_tcp=request.param) as running:
        yield running


@pytest.fixture
def gyro(twin: SimulatedKvhDsp1760, clock: VirtualClock) -> Iterator[KvhDsp1760]:
    with KvhDsp1760(twin.address, clock=clock) as opened:
        yield opened


def test_it_is_a_gyro_and_says_who_it_is(gyro: KvhDsp1760) -> None:
    as_interface: Gyro = gyro
    assert as_interface.identify() == Identity(manufacturer="KVH", model="DSP-1760")


def test_samples_are_those_of_the_gyros_own_instants(gyro: KvhDsp1760, inputs: RampInputs, clock: VirtualClock) -> None:
    clock.sleep(1.0)  # nothing of this is read
    assert gyro.start_stream(250.0) == 250.0
    clock.sleep(1.0)  # what a terminal's buffer holds
    block = gyro.read_stream(250, 5.0)
    assert block.sequence.tolist() == list(range(250))
    first_s = 1.0
    expected = -30.0 + 10.0 * (first_s + block.sequence / 250.0)
    np.testing.assert_allclose(block.rate_dps, expected, rtol=0, atol=1e-5)
    np.testing.assert_allclose(block.temperature_c, 21.75)
    assert block.valid.all()
    assert (block.gaps, block.faults) == ((), ())
    assert inputs.held_since_s == pytest.approx(2.0)


def test_blocks_go_on_from_each_other_and_a_new_stream_begins_anew(gyro: KvhDsp1760, clock: VirtualClock) -> None:
    gyro.start_stream(100.0)
    clock.sleep(0.5)
    first = gyro.read_stream(50, 5.0)
    clock.sleep(0.5)
    second = gyro.read_stream(50, 5.0)
    assert np.concatenate([first.sequence, second.sequence]).tolist() == list(range(100))
    gyro.stop_stream()
    clock.sleep(10.0)
    gyro.start_stream(100.0)
    clock.sleep(0.2)
    again = gyro.read_stream(20, 5.0)
    assert again.sequence[0] == 0
    assert again.gaps == ()
    assert again.rate_dps[0] == pytest.approx(-30.0 + 10.0 * 11.0)
    assert again.counts.samples == len(again.sequence)


def test_an_axis_across_the_tables_reads_nothing(twin: SimulatedKvhDsp1760, clock: VirtualClock) -> None:
    with KvhDsp1760(twin.address, clock=clock, axis="x") as gyro:
        gyro.start_stream(100.0)
        clock.sleep(0.1)
        assert (gyro.read_stream(5, 5.0).rate_dps == 0.0).all()


def test_a_sample_that_the_gyro_does_not_vouch_for_is_told(
    twin: SimulatedKvhDsp1760, gyro: KvhDsp1760, clock: VirtualClock
) -> None:
    gyro.start_stream(100.0)
    twin.status = 0b011
    clock.sleep(0.1)
    block = gyro.read_stream(10, 5.0)
    assert not block.valid.any()
    assert block.faults == ("gyro Z is not valid",)
    assert np.isnan(block.rates_dps).all(axis=0).tolist() == [False, False, True]


def test_a_disturbed_line_costs_the_frames_it_hits_and_all_is_counted(
    twin: SimulatedKvhDsp1760, gyro: KvhDsp1760, clock: VirtualClock
) -> None:
    gyro.start_stream(100.0)

    def hit_every_tenth(data: bytes) -> bytes:
        frames = [bytearray(data[at : at + 36]) for at in range(0, len(data), 36)]
        for frame in frames:
            if frame[29] % 10 == 0:
                frame[20] ^= 0x10
        return b"".join(frames)

    twin.line.disturb = hit_every_tenth
    clock.sleep(3.0)
    block = gyro.read_stream(250, 5.0)
    assert block.counts.samples + block.counts.lost == int(block.sequence[-1]) + 1
    assert sum(gap.lost for gap in block.gaps) == block.counts.lost > 0
    expected = -30.0 + 10.0 * block.sequence / 100.0
    np.testing.assert_allclose(block.rate_dps - block.rate_dps[0], expected - expected[0], atol=1e-4)
    assert block.counts.junk_bytes == 36 * block.counts.bad_frames


def test_fewer_samples_than_asked_for_are_a_link_error_and_are_kept(gyro: KvhDsp1760, clock: VirtualClock) -> None:
    gyro.start_stream(100.0)
    clock.sleep(0.2)
    with pytest.raises(LinkError, match=r"KVH DSP-1760 at .*: expected 1000 samples within 0.2 s, \d+ came"):
        gyro.read_stream(1000, 0.2)
    assert gyro.read_stream(10, 5.0).sequence[:10].tolist() == list(range(10))


@pytest.mark.parametrize("rate_hz", [2.0, 125.0, 200.0, 9999.0])
def test_a_rate_that_the_gyro_does_not_have_is_refused_in_one_line_with_those_that_it_has(
    gyro: KvhDsp1760, rate_hz: float
) -> None:
    words = (
        rf"^KVH DSP-1760 at [^\n]*: a rate of {rate_hz:g} Hz; give one .*: 1, 5, 10, 25, 50, 100, 250, 500, 750, 1000"
    )
    with pytest.raises(UsageError, match=words):
        gyro.start_stream(rate_hz)
    assert gyro.start_stream(750.0) == 750.0


@pytest.mark.parametrize("rate_hz", [0.0, -1.0, float("nan"), float("inf"), 100.5])
def test_a_rate_that_is_none_is_the_callers_fault(gyro: KvhDsp1760, rate_hz: float) -> None:
    with pytest.raises(UsageError, match="rate of"):
        gyro.start_stream(rate_hz)


def test_reading_without_a_stream_and_a_second_start_are_the_callers_fault(gyro: KvhDsp1760) -> None:
    with pytest.raises(UsageError, match="call start_stream first"):
        gyro.read_stream(1, 0.1)
    gyro.start_stream(100.0)
    with pytest.raises(UsageError, match="call stop_stream first"):
        gyro.start_stream(100.0)


def test_stopping_twice_does_no_harm(gyro: KvhDsp1760) -> None:
    gyro.stop_stream()
    gyro.stop_stream()


@pytest.mark.parametrize("axis", ["w", "", "xy"])
def test_an_axis_that_is_none_is_the_callers_fault(axis: str) -> None:
    with pytest.raises(UsageError, match="axis"):
        KvhDsp1760("serial:///dev/null", clock=VirtualClock(), axis=axis)


class Deaf:
    """A device that hears nothing and says nothing, or noise."""

    def feed(self, data: bytes) -> bytes:
        return b""

    def due(self) -> bytes:
        return b""

    def lose(self) -> None:
        return

    def wait(self, timeout_s: float) -> bool:
        return False


@pytest.mark.parametrize("over_tcp", LINES)
def test_a_device_that_does_not_answer_is_told_and_the_line_let_go_of(over_tcp: bool) -> None:
    with PushLine(Deaf(), baud=9600, over_tcp=over_tcp) as line:
        gyro = KvhDsp1760(line.address, clock=VirtualClock(), timeout_s=0.1)
        with pytest.raises(LinkError, match=r"sent b'=config,1.*got 0 bytes without it.*check the line"):
            gyro.open()
        with pytest.raises(UsageError, match="open"):
            gyro.stop_stream()


def test_a_gyro_that_goes_away_is_told_in_one_line(twin: SimulatedKvhDsp1760, gyro: KvhDsp1760) -> None:
    gyro.start_stream(100.0)
    twin.stop()
    with pytest.raises(LinkError, match=r"expected 1 samples within 0\.3 s"):
        gyro.read_stream(1, 0.3)
    gyro.close()
    gyro.close()


@pytest.mark.parametrize("echoes_exit", [True, False])
@pytest.mark.parametrize("over_tcp", LINES)
def test_a_stream_starts_whether_leaving_configuration_is_echoed_or_answered_by_frames_only(
    over_tcp: bool, echoes_exit: bool
) -> None:
    clock = ScaledClock()
    with (
        SimulatedKvhDsp1760(RampInputs(clock), SETTINGS, echoes_exit=echoes_exit, over_tcp=over_tcp) as twin,
        KvhDsp1760(twin.address, clock=clock, timeout_s=10.0) as gyro,
    ):
        for _ in range(2):
            assert gyro.start_stream(100.0) == 100.0
            block = gyro.read_stream(20, 10.0)
            assert block.sequence[:20].tolist() == list(range(20))
            assert (block.gaps, block.counts.junk_bytes) == ((), 0)
            gyro.stop_stream()


class Scripted(Deaf):
    """A device that answers certain bytes with certain bytes, and keeps what it heard."""

    def __init__(self, *script: tuple[bytes, bytes]) -> None:
        self._script = list(script)
        self.heard = b""

    def feed(self, data: bytes) -> bytes:
        self.heard += data
        if data and self._script and self.heard.endswith(self._script[0][0]):
            return self._script.pop(0)[1]
        return b""


FRAME = bytes.fromhex("FE81FF55 37A96A6E 38586C1F B75BF862 BF803E78 BB650D28 3B0A37AC 77 3D 0028 4BFA34D8")


def test_byte_for_byte_it_says_what_public_drivers_say_and_takes_a_published_frame_as_confirmation() -> None:
    script = (
        (b"=config,1\r\n", FRAME[7:] + b"CONFIG,1\r\n"),  # it was streaming
        (b"=config,1\r\n", b"CONFIG,1\r\n"),
        (b"=rotfmt,rate\r\n", b"ROTFMT,RATE\r\n"),
        (b"=rotunits,deg\r\n", b"ROTUNITS,DEG\r\n"),
        (b"=tempunits,c_100\r\n", b"TEMPUNITS,C_100\r\n"),
        (b"=dr,1000\r\n", b"DR,1000\r\n"),
        (b"=config,0\r\n", FRAME),
    )
    device = Scripted(*script)
    with (
        PushLine(device, baud=921_600, over_tcp=True) as line,
        KvhDsp1760(line.address, clock=VirtualClock(), axis="x") as gyro,
    ):
        gyro.start_stream(1000.0)
        block = gyro.read_stream(1, 5.0)
    assert device.heard == b"".join(said for said, _ in script)
    assert block.rate_dps[0] == pytest.approx(2.0196e-5, rel=1e-4)
    assert (block.temperature_c[0], block.status[0]) == (0.4, 0x77)


def test_a_command_that_the_gyro_refuses_is_told_in_one_line_at_once() -> None:
    with PushLine(Scripted((b"=config,1\r\n", b"INVALID,CONFIG,1\r\n")), baud=9600, over_tcp=True) as line:
        gyro = KvhDsp1760(line.address, clock=VirtualClock(), timeout_s=60.0)
        with pytest.raises(InstrumentError, match=r"^KVH DSP-1760 at .*sent b'=config,1.*answered 'INVALID,CONFIG,1'"):
            gyro.open()


def test_silence_after_leaving_configuration_says_what_was_expected() -> None:
    names = ("config,1", "config,1", "rotfmt,rate", "rotunits,deg", "tempunits,c_100", "dr,10")
    script = [(f"={name}\r\n".encode(), f"{name}\r\n".upper().encode()) for name in names]
    with (
        PushLine(Scripted(*script), baud=9600, over_tcp=True) as line,
        KvhDsp1760(line.address, clock=VirtualClock(), timeout_s=0.5) as gyro,
        pytest.raises(LinkError, match=r"sent b'=config,0.*expected its echo or a frame within 0.5 s"),
    ):
        gyro.start_stream(10.0)


@pytest.mark.parametrize("over_tcp", LINES)
def test_on_the_walls_clock_a_host_that_is_away_loses_frames_and_says_so(over_tcp: bool) -> None:
    clock = ScaledClock()
    inputs = RampInputs(clock)
    lost = bytearray()

    def unplugged(data: bytes) -> bytes:
        lost.extend(data)
        return b""

    with (
        SimulatedKvhDsp1760(inputs, SETTINGS, baud=4_000_000, over_tcp=over_tcp) as twin,
        KvhDsp1760(twin.address, clock=clock) as gyro,
    ):
        gyro.start_stream(1000.0)
        gyro.read_stream(100, 10.0)
        twin.line.disturb = unplugged
        while len(lost) < 300 * len(FRAME):  # more than the frames' numbers count, however slow the machine
            time.sleep(0.01)
        twin.line.disturb = lambda data: data
        seen = 0
        gaps: list[bool] = []
        while False not in gaps and seen < 20_000:
            block = gyro.read_stream(50, 10.0)
            seen += len(block.sequence)
            gaps += [gap.exact for gap in block.gaps]
        gyro.stop_stream()
    assert False in gaps
