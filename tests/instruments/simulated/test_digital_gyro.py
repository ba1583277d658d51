"""The simulated gyros themselves, without a driver."""

from __future__ import annotations

import numpy as np
import pytest

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError
from benchctl_instruments.mounting import Position
from benchctl_instruments.physics.response_gyro import ResponseParameters
from benchctl_instruments.physics.three_axes import ThreeAxisParameters
from benchctl_instruments.protocols import kvh1760 as kvh
from benchctl_instruments.protocols import stim300 as stim
from benchctl_instruments.protocols.frames import FrameReader
from benchctl_instruments.simulated.clock import VirtualClock
from benchctl_instruments.simulated.kvh_dsp1760 import SimulatedKvhDsp1760
from benchctl_instruments.simulated.sensonor_stim300 import SimulatedStim300
from benchctl_instruments.simulated.settings import WorldSettings
from benchctl_instruments.simulated.world import World
from tests.instruments.gyros.gyro_inputs import SETTINGS, RampInputs
from tests.instruments.simulated.quiet import quiet


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


@pytest.fixture
def inputs(clock: VirtualClock) -> RampInputs:
    return RampInputs(clock, rate_dps=10.0)


@pytest.fixture
def gyro(inputs: RampInputs) -> SimulatedKvhDsp1760:
    return SimulatedKvhDsp1760(inputs, SETTINGS)


def said(gyro: SimulatedKvhDsp1760, *lines: str) -> bytes:
    return gyro.feed("".join(f"{line}\r\n" for line in lines).encode())


def read(data: bytes) -> kvh.KvhFrames:
    runs = FrameReader([kvh.FORMAT]).feed(data)
    return kvh.decode_frames(np.concatenate([run.rows for run in runs]))


def test_a_setting_is_answered_once_settings_may_be_changed(gyro: SimulatedKvhDsp1760) -> None:
    assert said(gyro, "=dr,100") == b""
    assert said(gyro, "=config,1", "=DR,100", "=rotfmt,rate") == b"CONFIG,1\r\nDR,100\r\nROTFMT,RATE\r\n"
    assert said(gyro, "=config,0", "=dr,10") == b"CONFIG,0\r\n"


@pytest.mark.parametrize(
    ("command", "answer"),
    [
        ("=dr,125", b"INVALID,DR,125\r\n"),
        ("=dr,2000", b"INVALID,DR,2000\r\n"),
        ("=dr,many", b"INVALID,DR,MANY\r\n"),
        ("=rotfmt,sideways", b"INVALID,ROTFMT,SIDEWAYS\r\n"),
        ("=gain,2", b"INVALID,GAIN,2\r\n"),
        ("?gain", b"INVALID,GAIN\r\n"),
        ("?dr", b"DR,1000\r\n"),
        ("?TEMPUNITS", b"TEMPUNITS,C\r\n"),
        ("=axes,1,0,0,0,-1,0,0,0,-1.0", b"AXES,1,0,0,0,-1,0,0,0,-1.0\r\n"),
        ("=filttype,g,butter", b"FILTTYPE,G,BUTTER\r\n"),
        ("hello", b""),
    ],
)
def test_in_configuration_every_command_is_answered(gyro: SimulatedKvhDsp1760, command: str, answer: bytes) -> None:
    said(gyro, "=config,1")
    assert said(gyro, command) == answer


@pytest.mark.parametrize("rate_hz", kvh.RATES_HZ)
def test_every_rate_of_the_maker_is_taken_and_sent(
    gyro: SimulatedKvhDsp1760, clock: VirtualClock, rate_hz: int
) -> None:
    assert said(gyro, "=config,1", f"=dr,{rate_hz}", "?dr")[-len(f"DR,{rate_hz}\r\n") :] == b"DR,%d\r\n" % rate_hz
    said(gyro, "=config,0")
    clock.sleep(3.0)
    frames = 0
    while data := gyro.due():
        frames += len(data) // 36
    assert frames == pytest.approx(3 * rate_hz, abs=1)


def test_a_rate_that_the_line_cannot_carry_is_refused(inputs: RampInputs) -> None:
    gyro = SimulatedKvhDsp1760(inputs, SETTINGS, rate_hz=100.0, baud=115_200)
    assert said(gyro, "=config,1", "=dr,250", "=dr,500") == b"CONFIG,1\r\nDR,250\r\nINVALID,DR,500\r\n"


def test_a_reset_gives_the_settings_back_as_delivered(gyro: SimulatedKvhDsp1760) -> None:
    answers = said(gyro, "=config,1", "=dr,10", "=rotunits,deg", "=rstcfg", "?dr", "?rotunits").split(b"\r\n")
    assert answers[3:] == [b"RSTCFG", b"DR,1000", b"ROTUNITS,RAD", b""]


def test_leaving_configuration_may_be_confirmed_by_frames_only(inputs: RampInputs, clock: VirtualClock) -> None:
    gyro = SimulatedKvhDsp1760(inputs, SETTINGS, echoes_exit=False)
    assert said(gyro, "=config,1", "=config,0") == b"CONFIG,1\r\n"
    clock.sleep(0.01)
    assert gyro.due()[:4] == kvh.HEADER


@pytest.mark.foreign_client("kvh_dsp1760", "ESA drivers-dsp1760", "configures it")
def test_the_driver_of_esa_configures_it_by_buffers_of_fixed_length(gyro: SimulatedKvhDsp1760) -> None:
    """drivers-dsp1760, dsp1760.cpp: it sends the rest of each buffer too, which comes before its next command."""
    gyro.feed(b"=config,1\n" + b"=dr,250\n".ljust(16, b"\0") + b"=config,0\n")
    assert said(gyro, "=config,1", "?dr").endswith(b"DR,250\r\n")
    gyro.feed(b"=rotfmt,rate\n".ljust(32, b"\x7f"))
    assert said(gyro, "?rotfmt") == b"ROTFMT,RATE\r\n"
    assert gyro.feed(b"=rotfmt,reset\n".ljust(32, b"\0")) == b"ROTFMT,RESET\r\n"
    assert said(gyro, "?rotfmt") == b"ROTFMT,DELTA\r\n"


@pytest.mark.foreign_client("kvh_dsp1760", "ros_kvh1750", "queries settings")
def test_the_queries_of_a_public_driver_for_the_1750_are_answered(gyro: SimulatedKvhDsp1760) -> None:
    """What ros_kvh1750 does at its start: lines end with LF alone, and each query goes in and out of configuration."""
    for query, answer in (("TEMPUNITS", b"TEMPUNITS,C\r\n"), ("ROTFMT", b"ROTFMT,DELTA\r\n"), ("DR", b"DR,1000\r\n")):
        assert gyro.feed(b"=CONFIG,1\n") == b"CONFIG,1\r\n"
        assert gyro.feed(f"?{query}\n".encode()) == answer
        gyro.feed(b"=CONFIG,0\n")


@pytest.mark.parametrize(
    ("settings", "rotation", "temperature"),
    [
        (("=rotfmt,rate", "=rotunits,deg", "=tempunits,c_100"), 10.0, 2175),
        (("=rotfmt,rate", "=rotunits,rad", "=tempunits,c"), np.radians(10.0), 22),
        (("=rotfmt,delta", "=rotunits,deg", "=tempunits,c"), 0.1, 22),
        (("=rotfmt,rate", "=rotunits,deg", "=tempunits,f"), 10.0, 71),
    ],
)
def test_frames_are_in_the_units_that_were_set(
    gyro: SimulatedKvhDsp1760, clock: VirtualClock, settings: tuple[str, ...], rotation: float, temperature: int
) -> None:
    said(gyro, "=config,1", *settings, "=dr,100", "=config,0")
    clock.sleep(0.1)
    frames = read(gyro.due())
    np.testing.assert_allclose(frames.rotation[:, 2], rotation, rtol=1e-6)
    assert (frames.rotation[:, :2] == 0.0).all()
    assert set(frames.temperature) == {temperature}


def test_a_frame_is_due_when_the_line_would_have_carried_it(gyro: SimulatedKvhDsp1760, clock: VirtualClock) -> None:
    said(gyro, "=config,1", "=dr,100", "=config,0")
    wire_s = 360 / 921_600
    clock.sleep(0.9 * wire_s)
    assert gyro.due() == b""
    clock.sleep(0.2 * wire_s)
    assert len(gyro.due()) == 36
    assert gyro.due() == b""
    clock.sleep(0.03)
    assert len(gyro.due()) == 3 * 36
    assert gyro.sent == 4


def test_numbers_go_on_over_batches_and_no_frame_is_made_twice(gyro: SimulatedKvhDsp1760, clock: VirtualClock) -> None:
    said(gyro, "=config,1", "=dr,1000", "=config,0")
    clock.sleep(5.0)
    batches = []
    while data := gyro.due():
        batches.append(read(data).sequence)
    sequence = np.concatenate(batches)
    assert len(batches) > 1
    assert sequence.tolist() == [place % 128 for place in range(5000)]


def test_history_is_held_for_what_is_still_to_be_sampled(
    gyro: SimulatedKvhDsp1760, inputs: RampInputs, clock: VirtualClock
) -> None:
    clock.sleep(3.0)
    said(gyro, "=config,1", "=dr,100", "=config,0")
    assert inputs.held_since_s == 3.0
    clock.sleep(1.0)
    gyro.due()
    assert inputs.held_since_s == pytest.approx(4.0)
    said(gyro, "=config,1")
    assert inputs.held_since_s is None
    clock.sleep(1.0)
    assert gyro.due() == b""
    assert gyro.wait(0.0) is False


def test_more_frames_than_the_line_can_carry_are_refused(inputs: RampInputs) -> None:
    with pytest.raises(
        UsageError, match=r"2000 frames of 59 bytes a second do not fit through 921600 baud: at most 1562"
    ):
        SimulatedStim300(inputs, rate_hz=2000.0)


@pytest.mark.parametrize(
    "options", [{"rate_hz": 100.0}, {"datagram_id": 0x95}, {"gyro_unit": "integrated angle"}, {"gyro_unit": "furlongs"}]
)
def test_a_stim300_that_is_not_made_is_refused_with_those_that_are(
    inputs: RampInputs, options: dict[str, float | int | str]
) -> None:
    (name,) = options
    with pytest.raises(UsageError, match=f"{name} .*a simulated STIM300 has one of "):
        SimulatedStim300(inputs, **options)  # type: ignore[arg-type]


def test_rates_beyond_the_range_stop_there_and_state_an_overload(inputs: RampInputs, clock: VirtualClock) -> None:
    gyro = SimulatedStim300(inputs, SETTINGS)
    inputs.rate_dps = -450.0
    gyro._begin_stream(1000.0)
    clock.sleep(0.01)
    (run,) = FrameReader([stim.frame_format(0xA7)]).feed(gyro.due())
    frames = stim.decode_frames(0xA7, run.rows)
    assert set(frames.gyro[:, 2] * stim.RATE_STEP_DPS) == {-400.0}
    assert stim.status_words(int(frames.status[0])) == ("overload (Z)",)


def test_on_the_whole_bench_the_gyro_feels_the_table_and_the_earth(clock: VirtualClock) -> None:
    settings = quiet(latitude_deg=90.0)
    world = World(clock, settings)
    world.table.close_loop()
    gyro = SimulatedKvhDsp1760(world.inputs, settings)
    said(gyro, "=config,1", "=rotfmt,rate", "=rotunits,deg", "=tempunits,c_100", "=dr,100", "=config,0")
    clock.sleep(1.0)
    at_rest = read(gyro.due())
    world.table.demand_rate(5.0)
    clock.sleep(2.0)
    turning = read(gyro.due())
    assert at_rest.rotation[-1, 2] == pytest.approx(15.041 / 3600.0, abs=1e-6)
    assert turning.rotation[-1, 2] - at_rest.rotation[-1, 2] == pytest.approx(5.0, abs=1e-3)
    assert turning.temperature[-1] == 2000


def test_a_gyro_of_a_stated_response_is_scaled_by_that(clock: VirtualClock) -> None:
    response = ResponseParameters(
        K0_v_per_dps=0.02, U0_v=0.3, T0_c=20.0, k_T=(), k_omega=(), noise_v_rms=0.0, output_limit_v=10.0
    )
    settings = WorldSettings(response=response)
    world = World(clock, settings)
    gyro = SimulatedKvhDsp1760(world.inputs, settings)
    said(gyro, "=config,1", "=rotfmt,rate", "=rotunits,deg", "=dr,100", "=config,0")
    clock.sleep(1.0)
    np.testing.assert_allclose(read(gyro.due()).rotation[:, 2], 0.0, atol=1e-6)


UNIT = ThreeAxisParameters(arw_deg_per_sqrt_h=0.0)
TURNED = WorldSettings(three_axes=UNIT, latitude_deg=0.0)


def datagrams(data: bytes) -> stim.StimFrames:
    runs = FrameReader([stim.frame_format(0xA7)]).feed(data)
    return stim.decode_frames(0xA7, np.concatenate([run.rows for run in runs]))


@pytest.mark.parametrize(("position", "axis"), [("along", "y"), ("y up", "z"), ("across", "x")])
def test_a_unit_of_three_axes_states_all_of_them_as_it_is_turned(position: Position, axis: str) -> None:
    clock = VirtualClock()
    world = World(clock, TURNED)
    gyro = SimulatedStim300(world.second_gyro(), TURNED, axis=axis)
    world.mount(position)
    world.table.close_loop()
    world.table.demand_rate(50.0)
    clock.sleep(5.0)
    gyro._begin_stream(1000.0)
    clock.sleep(1.0)
    frames = datagrams(gyro.due())
    rates = frames.gyro * stim.RATE_STEP_DPS
    warmer_c = frames.temperature_c[0, 0] - UNIT.T0_c
    column = np.reshape(UNIT.matrix, (3, 3))[:, 1] + warmer_c * np.reshape(UNIT.matrix_per_c, (3, 3))[:, 1]
    bias = np.array(UNIT.bias_dps) + warmer_c * np.array(UNIT.bias_dps_per_c)
    np.testing.assert_allclose(rates.mean(axis=0), 50.0 * column + bias, atol=0.01)  # the Earth's rate is 0.004


def test_each_frame_belongs_to_the_position_of_its_instant_and_not_to_the_batch() -> None:
    def sampled(*parts: int) -> FloatArray:
        clock = VirtualClock()
        world = World(clock, WorldSettings(three_axes=ThreeAxisParameters()))
        inputs = world.second_gyro()
        world.table.close_loop()
        world.table.demand_rate(50.0)
        clock.sleep(5.0)
        inputs.hold_history(5.0)
        clock.sleep(1.0)
        world.mount("x up")
        clock.sleep(1.0)
        edges = np.cumsum([0, *parts])
        return np.concatenate(
            [
                inputs.sample_axes("z", 5.0, 0.01, length, start=start)[0]
                for start, length in zip(edges.tolist(), parts, strict=False)
            ]
        )

    whole = sampled(200)
    assert (whole[:100, 2] > 40.0).all()
    assert (whole[102:, 0] > 40.0).all()
    np.testing.assert_array_equal(sampled(30, 90, 80), whole)


def test_a_unit_of_three_axes_without_supply_states_nothing() -> None:
    clock = VirtualClock()
    world = World(clock, TURNED)
    inputs = world.second_gyro()
    world.power(False)
    clock.sleep(1.0)
    np.testing.assert_array_equal(inputs.sample_axes("z", 0.9, 0.01, 5)[0], 0.0)


def test_after_a_leap_of_the_clock_the_frames_are_those_of_now(inputs: RampInputs, clock: VirtualClock) -> None:
    inputs.ramp_dps2 = 0.01
    gyro = SimulatedStim300(inputs, SETTINGS, rate_hz=250.0)
    gyro._begin_stream(250.0)
    clock.sleep(3600.0)  # a soak, in which nobody reads
    data = b""
    while came := gyro.due():
        data += came
    frames = datagrams(data)
    rates = frames.gyro[:, 2] * stim.RATE_STEP_DPS
    assert len(rates) == pytest.approx(2500, abs=2)
    assert rates[0] == pytest.approx(10.0 + 0.01 * 3590.0, abs=0.01)
    assert rates[-1] == pytest.approx(10.0 + 0.01 * 3600.0, abs=0.01)
