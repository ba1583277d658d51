"""NI multifunction device (X or M series) by NI-DAQmx: encoder, gyro and thermistor on one sample clock.

An angular encoder on a counter and two analog inputs are two tasks of NI-DAQmx; the analog inputs' sample clock also
latches the counter:

    | task    | channels              | sample clock         | started                 |
    |---------|-----------------------|----------------------|-------------------------|
    | counter | ctr0, X4              | /Dev1/ai/SampleClock | by `open`, once         |
    | analog  | ai0, ai1, one by one  | its own              | by each stream, as last |

The counter's task waits for clocks from `open` to `close`, so that the count goes on between two streams. The inputs
are multiplexed: the thermistor is converted a few microseconds after the gyro. Encoder phases A and B go to the
counter's default terminals (ctr0 of most devices: PFI 8 and PFI 10).

Fault handling:

| fault                                                | handling                                              |
|------------------------------------------------------|-------------------------------------------------------|
| NI-DAQmx, or the package nidaqmx, is not installed   | `UsageError` that names what to install               |
| a wrong device name, a setting that it refuses       | `InstrumentError` with NI's own code                  |
| another program has the device                       | `InstrumentError`                                     |
| a buffer or the device's memory overflows            | `InstrumentError`: the count of lost scans is unknown |
| scans do not arrive in time, a call over the network | `LinkError`; received scans are kept                  |
| the encoder's count jumps, or all inputs are frozen  | `InstrumentError`, see `scan_watch.ScanWatch`         |
| the thermistor is at the end of its range            | `InstrumentError`: there is no temperature            |
| the sample clock drifts                              | not handled: it is the clock of the samples           |

Sources: NI's documentation of the package nidaqmx and of NI-DAQmx (angular encoder, sample clock as a counter's clock,
error codes); step305/MEMS_Gyro_Tests `drivers/NIDAQ.py` for the analog inputs of a gyro bench. Not tried on hardware.
"""

from __future__ import annotations

import math
import time
from contextlib import suppress
from typing import Any

import numpy as np

from benchctl_instruments.digitizers.scan_watch import ScanWatch
from benchctl_instruments.errors import BenchError, InstrumentError, LinkError, UsageError
from benchctl_instruments.interfaces import Clock, Identity, Instrument, ScanBlock, SingleScan, StreamStart
from benchctl_instruments.links.daqmx import DaqmxLink

NAME = "NI-DAQmx device"
BUFFER_SCANS = 1_000_000
MOST_HZ = 100_000.0
"""Highest expected rate of the sample clock; NI-DAQmx sets the counter's task up for it."""
PULSES_PER_REV = 90
"""At X4 a count is then one degree, so that NI-DAQmx returns counts; bench.toml states how many make a turn."""
SINGLE_HZ = 1000.0  # of the one scan that a single reading takes
LONGEST_WAIT_S = 0.1
HANDED_OVER_S = 0.05
"""Time after the last clock until a device on USB has handed its samples over; an assumption."""
COUNTER_WRAP = 1 << 32
WIRINGS = {"default": "DEFAULT", "differential": "DIFF", "rse": "RSE", "nrse": "NRSE"}


class NiDaqmx(Instrument):
    """An NI device with a quadrature encoder, a gyro and its thermistor; implements `interfaces.Digitizer`.

    Parameters
    ----------
    address
        `daqmx://Dev1`, a device of this computer; `daqmx://HOST:PORT/Dev1`, one behind an NI gRPC Device Server.
    clock
        The clock of `StreamStart.start_s`; the device has no counter that runs on between two streams.
    encoder_channel
        The counter: 0 is ctr0.
    gyro_ain, thermistor_ain
        The analog inputs.
    wiring
        Of both: "differential", "rse" (against ground), "nrse" (against AI SENSE), "default" (the device's own).
    range_v
        Their ±range; NI-DAQmx takes the next wider one that the device has.
    timeout_s
        Timeout of a connection and of a call over the network; wall time.
    fastest_counts_per_s
        Largest rate of the encoder's count: a larger change between two scans is a fault. Infinite: not checked.
    frozen_s
        Time without any change of code on any input after which the inputs count as frozen. Infinite: never.
    """

    def __init__(
        self,
        address: str,
        *,
        clock: Clock,
        encoder_channel: int = 0,
        gyro_ain: int = 0,
        thermistor_ain: int = 1,
        wiring: str = "default",
        range_v: float = 10.0,
        timeout_s: float = 5.0,
        fastest_counts_per_s: float = math.inf,
        frozen_s: float = 10.0,
    ) -> None:
        if wiring not in WIRINGS:
            raise UsageError(f"wiring = {wiring!r}: expected one of {', '.join(WIRINGS)}")
        self._link = DaqmxLink(address, name=NAME, timeout_s=timeout_s)
        self._who, self._clock, self._wiring, self._range_v = self._link.who, clock, wiring, range_v
        self._encoder, self._inputs = encoder_channel, (gyro_ain, thermistor_ain)
        self._fastest_counts_per_s, self._frozen_s = fastest_counts_per_s, frozen_s
        self._counter: Any = None  # tasks of nidaqmx, while open
        self._analog: Any = None
        self._opened_s = 0.0
        self._rate_hz: float | None = None  # while a stream runs
        self._watch: ScanWatch | None = None  # while a stream runs
        self._next_index, self._last_count = 0, 0

    def open(self) -> None:
        """Connect, set up both tasks and start the counter; nothing is sampled yet."""
        self.close()
        self._link.open()
        try:
            with self._link.doing("set up its inputs"):
                self._set_up()
        except BaseException:
            self.close()
            raise
        self._opened_s = self._clock.now()

    def close(self) -> None:
        """Clear both tasks and close the connection; safe to call twice, and never raises."""
        tasks, self._analog, self._counter, self._rate_hz = (self._analog, self._counter), None, None, None
        for task in tasks:
            if task is not None:
                with suppress(BenchError), self._link.doing("clear a task"):
                    task.close()
        self._link.close()

    def identify(self) -> Identity:
        """Return model and serial number."""
        from nidaqmx.system import Device

        with self._link.doing("read its serial number"):
            device = Device(self._link.address.device, grpc_options=self._link.grpc_options)
            return Identity(manufacturer="NI", model=device.product_type, serial=f"{device.serial_num:08X}")

    def read_once(self) -> SingleScan:
        """Return one scan, which starts and ends a stream: the counter is only read by the sample clock."""
        self.start_stream(SINGLE_HZ)
        try:
            block = self.read_stream(1, self._link.timeout_s)
        finally:
            self.stop_stream()
        return SingleScan(
            encoder_count=int(block.encoder_count[0]),
            gyro_v=float(block.gyro_v[0]),
            thermistor_v=float(block.thermistor_v[0]),
        )

    def start_stream(self, rate_hz: float) -> StreamStart:
        """Start the sample clock at the nearest rate that the device supports, and return that rate.

        The interval is a multiple of the period of the device's time base, 10 ns on an X series: 3000 Hz is 3000.03 Hz.
        """
        from nidaqmx.constants import AcquisitionType

        analog = self._task_of_inputs()
        if self._rate_hz is not None:
            raise UsageError(f"{self._who}: a stream runs already; call stop_stream first")
        if not 0.0 < rate_hz < math.inf:
            raise UsageError(f"{self._who}: a scan rate of {rate_hz} Hz; give a finite one above 0")
        with self._link.doing(f"start to scan at {rate_hz:g} Hz"):
            analog.timing.cfg_samp_clk_timing(
                rate_hz, sample_mode=AcquisitionType.CONTINUOUS, samps_per_chan=BUFFER_SCANS
            )
            actual_hz = float(analog.timing.samp_clk_rate)
            asked_s = self._clock.now()
            analog.start()
        start_s = 0.5 * (asked_s + self._clock.now()) - self._opened_s
        self._rate_hz, self._next_index = actual_hz, 0
        self._watch = ScanWatch(
            actual_hz,
            fastest_counts_per_s=self._fastest_counts_per_s,
            range_v=self._range_v,
            frozen_s=self._frozen_s,
        )
        return StreamStart(rate_hz=actual_hz, start_s=start_s)

    def read_stream(self, scans: int, timeout_s: float) -> ScanBlock:
        """Return at least `scans` scans and any others received; see `benchctl_instruments.interfaces.Digitizer`.

        Only scans that both tasks hold are taken out of them; others remain for the next call, also after an error.
        """
        if self._rate_hz is None or self._watch is None:
            raise UsageError(f"{self._who}: read_stream while no stream runs; call start_stream first")
        wanted, give_up_s = max(scans, 1), time.monotonic() + timeout_s
        while (ready := self._ready()) < wanted:
            if time.monotonic() > give_up_s:
                raise LinkError(
                    f"{self._who}: expected {wanted} scans within {timeout_s:g} s, {ready} came; check that its sample"
                    " clock runs, and that the counter can take it"
                )
            self._clock.sleep(min((wanted - ready) / self._rate_hz, LONGEST_WAIT_S))
        count, volts = self._read(ready)
        block = ScanBlock(
            first_index=self._next_index, encoder_count=count, gyro_v=volts[0].copy(), thermistor_v=volts[1].copy()
        )
        self._next_index += ready
        try:
            self._watch.look(block)
        except InstrumentError as err:
            raise InstrumentError(f"{self._who}: {err}") from err
        return block

    def stop_stream(self) -> None:
        """Stop the sample clock and discard the scans in both buffers. Safe to call if no stream runs."""
        self._rate_hz = None
        analog = self._task_of_inputs()
        with self._link.doing("stop its scans"):
            analog.stop()
            self._clock.sleep(HANDED_OVER_S)  # a count that came later would shift the next stream by a scan
            if left := int(self._counter.in_stream.avail_samp_per_chan):
                self._read_count(left)

    def _set_up(self) -> None:
        import nidaqmx
        from nidaqmx.constants import AcquisitionType, AngleUnits, EncoderType, TerminalConfiguration

        device, options = self._link.address.device, self._link.grpc_options
        self._counter = nidaqmx.Task(grpc_options=options)
        self._counter.ci_channels.add_ci_ang_encoder_chan(
            f"{device}/ctr{self._encoder}",
            decoding_type=EncoderType.X_4,
            zidx_enable=False,
            units=AngleUnits.DEGREES,
            pulses_per_rev=PULSES_PER_REV,
        )
        self._counter.timing.cfg_samp_clk_timing(
            MOST_HZ,
            source=f"/{device}/ai/SampleClock",
            sample_mode=AcquisitionType.CONTINUOUS,
            samps_per_chan=BUFFER_SCANS,
        )
        self._analog = nidaqmx.Task(grpc_options=options)
        for number in self._inputs:
            self._analog.ai_channels.add_ai_voltage_chan(
                f"{device}/ai{number}",
                terminal_config=TerminalConfiguration[WIRINGS[self._wiring]],
                min_val=-self._range_v,
                max_val=self._range_v,
            )
        self._counter.start()
        self._last_count = 0

    def _task_of_inputs(self) -> Any:
        if self._analog is None:
            raise UsageError(f"{self._who}: it is not open; call open() first")
        return self._analog

    def _ready(self) -> int:
        """Return the number of scans that both tasks hold."""
        with self._link.doing("ask for its scans"):
            return min(int(task.in_stream.avail_samp_per_chan) for task in (self._analog, self._counter))

    def _read(self, scans: int) -> tuple[Any, Any]:
        """Take scans that are ready out of both tasks: counts (scans,), volts (2, scans)."""
        from nidaqmx.stream_readers import AnalogMultiChannelReader

        volts = np.empty((len(self._inputs), scans))
        with self._link.doing(f"read {scans} scans"):
            reader = AnalogMultiChannelReader(self._analog.in_stream)
            reader.verify_array_shape = False  # another call; the shape is right
            reader.read_many_sample(volts, scans, self._link.timeout_s)
            return self._read_count(scans), volts

    def _read_count(self, scans: int) -> Any:
        """Take counts out of the counter's task, continued across wraps of the 32-bit counter."""
        from nidaqmx.stream_readers import CounterReader

        degrees = np.empty(scans)
        reader = CounterReader(self._counter.in_stream)
        reader.verify_array_shape = False
        reader.read_many_sample_double(degrees, scans, self._link.timeout_s)
        counts = np.rint(degrees * (4 * PULSES_PER_REV / 360.0)).astype(np.int64)
        steps = np.diff(counts, prepend=self._last_count)
        half = COUNTER_WRAP // 2
        unwrapped = self._last_count + np.cumsum((steps + half) % COUNTER_WRAP - half)
        self._last_count = int(unwrapped[-1])
        return unwrapped


Driver = NiDaqmx
