"""The driver against the simulated gyros, over a real pseudo-terminal or a real socket."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from benchctl_instruments.errors import InstrumentError, LinkError, UsageError
from benchctl_instruments.gyros.sensonor_stim300 import SensonorStim300
from benchctl_instruments.interfaces import Gyro, Identity
from benchctl_instruments.protocols import stim300 as stim
from benchctl_instruments.protocols.stim300 import StimConfiguration
from benchctl_instruments.simulated.clock import VirtualClock
from benchctl_instruments.simulated.push_line import PushLine
from benchctl_instruments.simulated.sensonor_stim300 import SimulatedStim300
from tests.instruments.gyros.gyro_inputs import SETTINGS, RampInputs

LINES = [
    pytest.param(False, marks=pytest.mark.skipif(sys.platform == "win32", reason="needs pseudo-terminals")),
    True,
]
STEP_DPS = 2.0**-14


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


@pytest.fixture
def inputs(clock: VirtualClock) -> RampInputs:
    return RampInputs(clock, rate_dps=-30.0, ramp_dps2=10.0)


def test_it_is_a_gyro_and_says_who_it_is(inputs: RampInputs, clock: VirtualClock) -> None:
    with SimulatedStim300(inputs, SETTINGS, serial="25582100000042") as twin:
        clock.sleep(0.05)
        with SensonorStim300(twin.address, clock=clock) as gyro:
            as_interface: Gyro = gyro
            assert as_interface.identify() == Identity(
                manufacturer="Sensonor", model="STIM300", serial="25582100000042", firmware="F31"
            )


@pytest.mark.parametrize("over_tcp", LINES)
@pytest.mark.parametrize("crlf", [False, True])
@pytest.mark.parametrize("datagram_id", [0x90, 0xA7, 0xAF])
def test_samples_are_those_of_the_gyros_own_instants(
    inputs: RampInputs, clock: VirtualClock, datagram_id: int, crlf: bool, over_tcp: bool
) -> None:
    with SimulatedStim300(
        inputs, SETTINGS, rate_hz=250.0, datagram_id=datagram_id, crlf=crlf, over_tcp=over_tcp
    ) as twin:
        clock.sleep(0.1)  # nothing of this is read
        with SensonorStim300(twin.address, clock=clock) as gyro:
            assert gyro.start_stream(250.0) == 250.0
            clock.sleep(0.5)
            block = gyro.read_stream(125, 5.0)
    assert block.sequence.tolist() == list(range(len(block.sequence)))
    assert (block.gaps, block.faults, block.counts.bad_frames) == ((), (), 0)
    # the first sample is the first one after the answer
    first_s = (block.rate_dps[0] + 30.0) / 10.0
    assert 0.1 - 1.0 / 250.0 < first_s <= 0.1 + 3.0 / 250.0
    np.testing.assert_allclose(block.rate_dps, block.rate_dps[0] + 10.0 * block.sequence / 250.0, rtol=0, atol=STEP_DPS)
    if datagram_id == 0x90:
        assert np.isnan(block.temperature_c).all()
    else:
        np.testing.assert_allclose(block.temperature_c, 21.75)
    assert block.valid.all()


@pytest.mark.parametrize("unit", ["average angular rate", "incremental angle"])
def test_other_units_of_the_gyro_are_rates_too(inputs: RampInputs, clock: VirtualClock, unit: str) -> None:
    inputs.ramp_dps2 = 0.0
    with (
        SimulatedStim300(inputs, SETTINGS, gyro_unit=unit) as twin,
        SensonorStim300(twin.address, clock=clock) as gyro,
    ):
        gyro.start_stream(1000.0)
        np.testing.assert_allclose(gyro.read_stream(9, 5.0).rate_dps, -30.0, atol=1000.0 * 2.0**-21)


@pytest.mark.parametrize("step", [1, 9, 16, 255])
def test_whatever_the_counter_goes_up_by_lost_datagrams_are_counted(
    inputs: RampInputs, clock: VirtualClock, step: int
) -> None:
    with (
        SimulatedStim300(inputs, SETTINGS, rate_hz=125.0, counter_step=step) as twin,
        SensonorStim300(twin.address, clock=clock) as gyro,
    ):
        gyro.start_stream(125.0)
        first = gyro.read_stream(9, 5.0)
        swallowed = bytearray()

        def swallow_four(data: bytes) -> bytes:
            took = data[: 4 * 59 - len(swallowed)]
            swallowed.extend(took)
            return data[len(took) :]

        twin.line.disturb = swallow_four
        clock.sleep(0.2)
        second = gyro.read_stream(15, 5.0)
    assert [gap.lost for gap in second.gaps] == [4]
    assert second.counts.lost == 4
    sequence = np.concatenate([first.sequence, second.sequence])
    rates = np.concatenate([first.rate_dps, second.rate_dps])
    np.testing.assert_allclose(rates - rates[0], 10.0 * sequence / 125.0, atol=2 * STEP_DPS)


def test_a_status_is_told_in_words(inputs: RampInputs, clock: VirtualClock) -> None:
    with (
        SimulatedStim300(inputs, SETTINGS) as twin,
        SensonorStim300(twin.address, clock=clock) as gyro,
    ):
        gyro.start_stream(1000.0)
        gyro.read_stream(9, 5.0)
        twin.status = 1 << 6
        inputs.rate_dps = 500.0
        clock.sleep(0.05)
        block = gyro.read_stream(20, 5.0)
    assert not block.valid[-1]
    assert block.rate_dps[-1] == 400.0
    assert block.faults == ("overload (Z)", "starting up (Z)")


def test_another_rate_than_it_is_set_to_is_refused_with_what_to_do(inputs: RampInputs, clock: VirtualClock) -> None:
    with (
        SimulatedStim300(inputs, SETTINGS, rate_hz=125.0) as twin,
        SensonorStim300(twin.address, clock=clock) as gyro,
    ):
        with pytest.raises(InstrumentError, match=r"1000 samples a second were asked for, it is set to 125"):
            gyro.start_stream(1000.0)
        assert gyro.start_stream(125.0) == 125.0
        with pytest.raises(UsageError, match="call stop_stream first"):
            gyro.start_stream(125.0)


class Stating:
    """Answers the two questions with a configuration of one's own, and sends nothing else."""

    def __init__(self, configuration: StimConfiguration) -> None:
        self.configuration = configuration

    def feed(self, data: bytes) -> bytes:
        said = stim.encode_configuration(self.configuration) if stim.ASK_CONFIGURATION in data else b""
        return said + (stim.encode_serial("0" * 14) if stim.ASK_SERIAL in data else b"")

    def due(self) -> bytes:
        return b""

    def lose(self) -> None:
        return

    def wait(self, timeout_s: float) -> bool:
        return False


@pytest.mark.parametrize(
    ("rate_hz", "unit", "error", "says"),
    [
        (None, "angular rate", InstrumentError, "samples at an external trigger"),
        (125.0, "integrated angle", InstrumentError, "put out integrated angle, expected one of angular rate"),
        (125.0, "angular rate", LinkError, "expected 9 datagrams A7h as it is configured, 0 came and 0 bytes"),
    ],
)
def test_what_makes_no_stream_is_told_in_one_line(
    clock: VirtualClock, rate_hz: float | None, unit: str, error: type[Exception], says: str
) -> None:
    device = Stating(StimConfiguration(datagram_id=0xA7, crlf=False, rate_hz=rate_hz, gyro_unit=unit))
    with (
        PushLine(device, baud=921_600, over_tcp=True) as line,
        SensonorStim300(line.address, clock=clock, timeout_s=0.2) as gyro,
    ):
        with pytest.raises(error, match=says):
            gyro.start_stream(125.0)
        with pytest.raises(UsageError, match="call start_stream first"):
            gyro.read_stream(1, 0.1)


class Noise:
    """A device that sends rubbish, as a wrong baud rate makes of anything."""

    def feed(self, data: bytes) -> bytes:
        return b""

    def due(self) -> bytes:
        return bytes(range(256))

    def lose(self) -> None:
        return

    def wait(self, timeout_s: float) -> bool:
        return True


def test_a_line_at_the_wrong_speed_is_told_by_what_came() -> None:
    with PushLine(Noise(), baud=9600, over_tcp=True) as line:
        gyro = SensonorStim300(line.address, clock=VirtualClock(), timeout_s=0.1)
        with pytest.raises(
            LinkError, match=r"expected a datagram STIM300 configuration within 0.1 s, got [1-9]\d* bytes"
        ):
            gyro.open()


@pytest.mark.parametrize("axis", ["w", "", "xy"])
def test_an_axis_that_is_none_is_the_callers_fault(axis: str) -> None:
    with pytest.raises(UsageError, match="axis"):
        SensonorStim300("serial:///dev/null", clock=VirtualClock(), axis=axis)


class AnswersAfterABrokenDatagram:
    """A STIM300 whose latest datagram ends in the byte with which a longer answer would begin; then time stands."""

    def feed(self, data: bytes) -> bytes:
        if data == stim.ASK_CONFIGURATION:
            configuration = StimConfiguration(
                datagram_id=0xA7, crlf=False, rate_hz=250.0, gyro_unit="angular rate", revision="F", firmware=31
            )
            return b"\xa7\x00\xbd" + stim.encode_configuration(configuration)
        return stim.encode_serial("25582100000042", crlf=False) if data == stim.ASK_SERIAL else b""

    def due(self) -> bytes:
        return b""

    def lose(self) -> None:
        return

    def wait(self, timeout_s: float) -> bool:
        return False


def test_an_answer_is_complete_even_if_the_bytes_before_it_look_like_the_start_of_a_longer_one() -> None:
    with (
        PushLine(AnswersAfterABrokenDatagram(), baud=921_600, over_tcp=True) as line,
        SensonorStim300(line.address, clock=VirtualClock(), timeout_s=1.0) as gyro,
    ):
        assert gyro.identify().serial == "25582100000042"
