"""LabJack T7 over Ethernet: encoder count, gyro volts and thermistor volts in one hardware-timed scan.

Modbus TCP (port 502) for set-up and single readings, the spontaneous stream (port 702) for scans. The scan list is

    | count, low word | count, high word | gyro volts | thermistor volts |
    | DIOn_EF_READ_A  | DATA_CAPTURE_16  | AIN        | AIN              |

so that all four belong to the same instant by construction. Streamed samples are raw codes; they are converted to volts
with the calibration constants in the T7's flash.

Fault handling:

| fault                                                 | handling                                                 |
|-------------------------------------------------------|----------------------------------------------------------|
| no answer, a late, broken or foreign one, a cut link  | repeated on a new connection, as in `ModbusLink`         |
| a refusal                                             | `InstrumentError` with LabJack's own code                |
| the answer to ENABLE is lost                          | its state is read, and ENABLE repeated only if necessary |
| it has restarted                                      | `InstrumentError`: its encoder's count is lost           |
| a stream runs that this driver did not start          | `InstrumentError`: it belongs to another program         |
| packets of the stream are lost                        | a gap: `first_index` jumps                               |
| its buffer overflows, it skips scans and recovers     | a gap of the reported number of scans                    |
| the stream's connection breaks, or brings no packets  | reconnected, with a gap                                  |
| ... before the first packet                           | `LinkError`: the number of missing scans is unknown      |
| bytes between two packets of the stream               | ignored                                                  |
| the stream stops                                      | `LinkError`; received scans are kept                     |
| the encoder's count jumps, or all inputs are frozen   | `InstrumentError`, see `scan_watch.ScanWatch`            |
| the thermistor is at the end of its range             | `InstrumentError`: there is no temperature               |
| the gyro is at the end of its range                   | recorded unchanged: it may be the true rate              |
| its crystal drifts                                    | not handled: its counter is the clock of the samples     |

That a T7 continues its stream when the stream's connection is renewed is an assumption without a source; if it does
not, its silence raises `LinkError`.

Written from LabJack's public documents (T-series datasheet 3.2.4 and 20.0.1, the register map, the public C examples);
not tried on hardware.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np

from benchctl_instruments.digitizers import t7_registers as reg
from benchctl_instruments.digitizers.scan_watch import ScanWatch, refuse_at_rail
from benchctl_instruments.digitizers.t7_registers import SCAN_LENGTH, AinCalibration, ScanQueue
from benchctl_instruments.errors import InstrumentError, LinkError, UsageError
from benchctl_instruments.interfaces import Clock, Identity, Instrument, ScanBlock, SingleScan, StreamStart
from benchctl_instruments.links.address import parse_address
from benchctl_instruments.links.modbus import ModbusLink
from benchctl_instruments.links.tcp import LinkCutError, TcpLink
from benchctl_instruments.links.wirelog import WireLog, note_recovered
from benchctl_instruments.protocols.t7_stream import MOST_SAMPLES, NotAPacketError
from benchctl_instruments.recognition import ByRegisters

TICKS_HZ = 40_000_000
WRAP = 1 << 32


class CoreTimer:
    """CORE_TIMER, a 32-bit count at 40 MHz that wraps every 107 s, converted into seconds since the first reading.

    The number of wraps is found with another clock, which may be wrong by up to half a wrap (53 s) between two
    readings: for any crystal this takes days. The seconds themselves depend on the T7's crystal only.

    Parameters
    ----------
    count, clock_s
        The counter and the other clock, read at the same time.
    """

    def __init__(self, count: int, clock_s: float) -> None:
        self._count = count
        self._clock_s = clock_s
        self._ticks = 0

    def look(self, count: int, clock_s: float) -> float:
        """Add a reading and return the seconds since the first one."""
        part = (count - self._count) % WRAP
        wraps = round(((clock_s - self._clock_s) * TICKS_HZ - part) / WRAP)
        self._ticks += part + max(wraps, 0) * WRAP
        self._count, self._clock_s = count, clock_s
        return self._ticks / TICKS_HZ

    def seconds_at(self, count: int) -> float:
        """Return the time when the counter read `count`, which must be within 107 s after the last reading."""
        return (self._ticks + (count - self._count) % WRAP) / TICKS_HZ


STREAM_PORT = 702
PRODUCT_ID = 7
QUADRATURE = 10
QUADRATURE_LINES = (0, 2, 6)  # phase A; phase B is the next line
SINGLE_ENDED = 199
ETHERNET = 1
BUFFER_BYTES = 32768  # largest size that the T7 supports
LONGEST_PACKET_S = 0.05
LARGEST_RATE_STEP = 0.01  # between neighbouring scan rates, relative: 100 ns of an interval of 10 µs
RANGES_V = (10.0, 1.0, 0.1, 0.01)  # in the order of the calibration in the flash
CALIBRATION_FLASH_ADDRESS, CALIBRATION_BYTES = 0x3C4000, 16
LARGEST_RECEIVE = 1 << 18
SKIPPED, RESUMED = "left out", "connected again, what is missing is a gap"  # recovery from faults of the stream


def _recognised(link: ModbusLink, _: Clock) -> str:
    """Describe a T7 by its registers TEST, PRODUCT_ID and SERIAL_NUMBER; `InstrumentError`: another device."""
    registers = reg.T7Registers(link)
    if int(registers.read(reg.TEST)) != reg.TEST_VALUE or registers.read(reg.PRODUCT_ID) != PRODUCT_ID:
        raise InstrumentError(f"expected {reg.TEST_VALUE:08X}h in register TEST, and product {PRODUCT_ID}")
    return f"LabJack T7, serial {int(registers.read(reg.SERIAL_NUMBER))}"


class LabJackT7(Instrument):
    """A T7 with a quadrature encoder, a gyro and its thermistor; implements `interfaces.Digitizer`.

    Parameters
    ----------
    address
        `tcp://HOST:PORT` of its Modbus server.
    stream_address
        `tcp://HOST:PORT` of its stream; by default port 702 of the same host.
    clock
        The clock used to count the wraps of the T7's own counter.
    encoder_channel
        The digital line of the encoder's phase A: 0, 2 or 6; phase B is on the next one.
    gyro_ain, thermistor_ain
        The analog inputs, single ended.
    range_v
        Their ±range: 10, 1, 0.1 or 0.01 V.
    timeout_s
        Timeout of an answer and of a connection; wall time.
    fastest_counts_per_s
        Largest rate of the encoder's count: a larger change between two scans is a fault. Infinite: not checked.
    frozen_s
        Time without any change of code on any input after which the stream counts as frozen. Infinite: never.
    wire_log
        Log of the traffic on both connections.
    """

    recognition = (ByRegisters(read=_recognised, certainty="certain", schemes=("tcp",)),)

    def __init__(
        self,
        address: str,
        stream_address: str | None = None,
        *,
        clock: Clock,
        encoder_channel: int = 0,
        gyro_ain: int = 0,
        thermistor_ain: int = 1,
        range_v: float = 10.0,
        timeout_s: float = 2.0,
        fastest_counts_per_s: float = math.inf,
        frozen_s: float = 10.0,
        wire_log: WireLog | None = None,
    ) -> None:
        where = parse_address(address)
        if where.scheme != "tcp":
            raise UsageError(f"address {address!r}: expected tcp://HOST:PORT for a LabJack T7")
        if encoder_channel not in QUADRATURE_LINES:
            raise UsageError(
                f"encoder_channel {encoder_channel}: expected one on which a LabJack T7 counts, {QUADRATURE_LINES}"
            )
        if range_v not in RANGES_V:
            raise UsageError(f"range_v {range_v}: expected one of the ranges of a LabJack T7, {RANGES_V} V")
        host = f"[{where.host}]" if ":" in where.host else where.host
        self._who = f"LabJack T7 at {where}"
        self._encoder, self._inputs, self._range_v = encoder_channel, (gyro_ain, thermistor_ain), range_v
        self._clock, self._timeout_s = clock, timeout_s
        self._link = ModbusLink(address, name="LabJack T7", timeout_s=timeout_s, wire_log=wire_log)
        self._registers = reg.T7Registers(self._link)
        self._stream = TcpLink(stream_address or f"tcp://{host}:{STREAM_PORT}", wire_log=wire_log)
        self._scans: ScanQueue | None = None  # while a stream runs
        self._fastest_counts_per_s, self._frozen_s = fastest_counts_per_s, frozen_s
        self._watch: ScanWatch | None = None  # while a stream runs
        self._calibration = AinCalibration(positive_slope=math.nan, negative_slope=math.nan, centre=math.nan)
        self._core_timer = CoreTimer(0, 0.0)
        self._is_set_up = False

    def open(self) -> None:
        """Connect and check that a T7 answers; its inputs are set up when they are first used."""
        self._link.open()
        try:
            self._check_identity()
            self._read_calibration()
            self._is_set_up = False
            self._core_timer = CoreTimer(int(self._registers.read(reg.CORE_TIMER)), self._clock.now())
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close both connections; safe to call twice, and never raises."""
        self._forget_stream()
        self._link.close()

    def identify(self) -> Identity:
        """Return serial number and firmware."""
        return Identity(
            manufacturer="LabJack",
            model="T7",
            serial=str(int(self._registers.read(reg.SERIAL_NUMBER))),
            firmware=f"{self._registers.read(reg.FIRMWARE_VERSION):.4f}",
        )

    def read_once(self) -> SingleScan:
        """Return one reading of each input, taken in sequence; the T7 itself converts them to calibrated volts."""
        if self._scans is not None:
            raise UsageError(f"{self._who}: read_once while the stream runs; call stop_stream first")
        self._set_up_inputs()
        self._refuse_after_restart()
        gyro, thermistor = self._inputs
        count = np.uint32(self._registers.read(reg.ef_read_a(self._encoder)))
        gyro_v, thermistor_v = self._registers.read_together((reg.ain(gyro), reg.ain(thermistor)))
        scan = SingleScan(encoder_count=int(count.astype(np.int32)), gyro_v=gyro_v, thermistor_v=thermistor_v)
        self._check(lambda: refuse_at_rail(scan.thermistor_v, self._range_v))
        return scan

    def start_stream(self, rate_hz: float) -> StreamStart:
        """Start the stream at the nearest rate that the T7's clock supports, and return that rate.

        The scan interval is a multiple of 100 ns above 152.6 Hz and of coarser steps below: 3000 Hz is 3000.30 Hz.
        """
        if self._scans is not None:
            raise UsageError(f"{self._who}: start_stream while the stream runs; call stop_stream first")
        if not 0.0 < rate_hz < math.inf:
            raise UsageError(f"{self._who}: a scan rate of {rate_hz} Hz; give a finite one above 0")
        self._set_up_inputs()
        self._refuse_foreign_stream()
        self._stream.open(self._timeout_s)
        try:
            self._set_up_stream(rate_hz)
            self._refuse_after_restart()
            self._core_timer.look(int(self._registers.read(reg.CORE_TIMER)), self._clock.now())
            self._enable_stream()
            actual_hz = self._registers.read(reg.STREAM_SCANRATE_HZ)
            if not math.isclose(actual_hz, rate_hz, rel_tol=LARGEST_RATE_STEP):
                raise InstrumentError(
                    f"{self._who}: asked for {rate_hz:g} scans a second, it scans {actual_hz:g} times;"
                    " check that no other program uses it"
                )
            stamp = int(self._registers.read(reg.STREAM_START_TIME_STAMP))
        except BaseException:
            self._forget_stream()
            raise
        self._scans = ScanQueue(self._calibration)
        self._watch = ScanWatch(
            actual_hz,
            fastest_counts_per_s=self._fastest_counts_per_s,
            range_v=self._range_v,
            frozen_s=self._frozen_s,
        )
        return StreamStart(rate_hz=actual_hz, start_s=self._core_timer.seconds_at(stamp))

    def read_stream(self, scans: int, timeout_s: float) -> ScanBlock:
        """Return at least `scans` scans and any others received; see `benchctl_instruments.interfaces.Digitizer`.

        A scan arrives with the last one of its packet; a packet holds 50 ms, or one scan if the rate is below 20 Hz.
        Scans received before a `LinkError` are kept for the next call.
        """
        if self._scans is None or self._watch is None:
            raise UsageError(f"{self._who}: read_stream while no stream runs; call start_stream first")
        wanted = max(scans, 1)
        give_up_s = time.monotonic() + timeout_s
        try:
            more_waits = False
            while more_waits or not self._scans.ready(wanted):
                more_waits = self._receive(self._scans, give_up_s) and time.monotonic() < give_up_s
        except LinkError as err:
            came = self._scans.waiting
            raise LinkError(
                f"{self._who}: expected {wanted} scans within {timeout_s:g} s, {came} came: {err}; "
                "check its power and cable"
            ) from err
        except InstrumentError as err:
            raise InstrumentError(f"{self._who}: {err}") from err
        block, watch = self._scans.take(), self._watch
        self._check(lambda: watch.look(block))
        return block

    def stop_stream(self) -> None:
        """Stop the stream and discard the T7's buffered scans. Safe to call if no stream runs."""
        self._forget_stream()
        try:
            self._registers.write(reg.STREAM_ENABLE, 0)
        except reg.T7RefusalError as err:
            if err.code != reg.NOT_RUNNING:
                raise
        if self._registers.read(reg.STREAM_ENABLE) != 0:
            raise InstrumentError(
                f"{self._who}: told to stop its stream, it acknowledged and still runs; switch it off and on"
            )

    def _receive(self, scans: ScanQueue, give_up_s: float) -> bool:
        """Receive stream data, reconnecting if the connection broke; return whether more data is likely."""
        try:
            data = self._stream.receive(LARGEST_RECEIVE, give_up_s - time.monotonic())
            junk_bytes = scans.junk_bytes
            scans.feed(data)
            if scans.junk_bytes > junk_bytes:
                note_recovered(
                    f"{self._who}: {scans.junk_bytes - junk_bytes} bytes of its stream are no packet", SKIPPED
                )
        except (LinkCutError, NotAPacketError) as err:
            self._stream.open(self._timeout_s)
            scans.resume()
            scans.feed(self._stream.receive(LARGEST_RECEIVE, give_up_s - time.monotonic()))
            note_recovered(f"{self._who}: its stream broke: {err}", RESUMED)
            return False
        return len(data) == LARGEST_RECEIVE

    def _check(self, look: Callable[[], None]) -> None:
        try:
            look()
        except InstrumentError as err:
            raise InstrumentError(f"{self._who}: {err}") from err

    def _enable_stream(self) -> None:
        """Enable the stream; a T7 refuses a second ENABLE, so after a lost answer the state is read first."""
        try:
            self._registers.write(reg.STREAM_ENABLE, 1, once=True)
        except LinkError as err:
            if self._registers.read(reg.STREAM_ENABLE) != 1:
                self._registers.write(reg.STREAM_ENABLE, 1, once=True)
            note_recovered(str(err))

    def _refuse_after_restart(self) -> None:
        if self._registers.read(reg.ef_enable(self._encoder)) != 1:
            raise InstrumentError(
                f"{self._who}: its encoder input was set up and is so no more: it has restarted, and the count is lost;"
                " check its power supply and begin anew"
            )

    def _check_identity(self) -> None:
        test = int(self._registers.read(reg.TEST))
        if test == reg.TEST_VALUE_SWAPPED:
            raise InstrumentError(
                f"{self._who}: 32-bit numbers come low word first; look for what swaps words on the way"
            )
        if test != reg.TEST_VALUE:
            raise InstrumentError(
                f"{self._who}: expected {reg.TEST_VALUE:08X}h in register TEST, got {test:08X}h; "
                "check that the address is a LabJack's"
            )
        product = self._registers.read(reg.PRODUCT_ID)
        if product != PRODUCT_ID:
            raise InstrumentError(
                f"{self._who}: expected product {PRODUCT_ID}, a T7, got {product:g}; check its address and model"
            )

    def _read_calibration(self) -> None:
        flash = CALIBRATION_FLASH_ADDRESS + CALIBRATION_BYTES * RANGES_V.index(self._range_v)
        positive, negative, centre = self._registers.read_flash(flash, 3)
        self._calibration = AinCalibration(positive_slope=positive, negative_slope=negative, centre=centre)
        try:
            self._calibration.check(self._range_v)
        except InstrumentError as err:
            raise InstrumentError(f"{self._who}: reading its flash, {err}; have it calibrated") from err

    def _set_up_inputs(self) -> None:
        """Test the stream's address, then set up encoder and analog inputs, at their first use."""
        if self._is_set_up:
            return
        self._refuse_foreign_stream()
        try:  # now, and not half an hour later, when the chamber has soaked
            self._stream.open(self._timeout_s)
        except LinkError as err:
            raise LinkError(f"{self._who}: its stream: {err}") from err
        self._stream.close()
        self._set_up_encoder()
        for channel in self._inputs:
            self._registers.set(reg.ain_range(channel), self._range_v)
            self._registers.set(reg.ain_negative(channel), SINGLE_ENDED)
        self._is_set_up = True

    def _refuse_foreign_stream(self) -> None:
        if self._registers.read(reg.STREAM_ENABLE) != 0:
            raise InstrumentError(
                f"{self._who}: a stream runs that this program did not start: another one records with it; wait for "
                "its end, or switch the T7 off and on where there is none"
            )

    def _set_up_encoder(self) -> None:
        """Set up quadrature on two lines; if they are already counting, leave them alone to keep their zero."""
        lines = (self._encoder, self._encoder + 1)
        wanted = [(reg.ef_index(line), QUADRATURE) for line in lines] + [(reg.ef_enable(line), 1) for line in lines]
        if all(self._registers.read(register) == value for register, value in wanted):
            return
        for line in lines:
            self._registers.set(reg.ef_enable(line), 0)  # the feature of a running line cannot be changed
        for register, value in wanted:
            self._registers.set(register, value)

    def _set_up_stream(self, rate_hz: float) -> None:
        """Write all stream settings except ENABLE, which comes last; unchanged settings are not rewritten."""
        gyro, thermistor = self._inputs
        scan_list = (reg.ef_read_a(self._encoder), reg.STREAM_DATA_CAPTURE_16, reg.ain(gyro), reg.ain(thermistor))
        scans_a_packet = max(1, min(int(rate_hz * LONGEST_PACKET_S), MOST_SAMPLES // SCAN_LENGTH))
        self._registers.keep(
            {
                reg.STREAM_NUM_ADDRESSES: SCAN_LENGTH,
                reg.STREAM_SAMPLES_PER_PACKET: scans_a_packet * SCAN_LENGTH,
                reg.STREAM_SETTLING_US: 0.0,
                reg.STREAM_RESOLUTION_INDEX: 0,
                reg.STREAM_BUFFER_SIZE_BYTES: BUFFER_BYTES,
                reg.STREAM_CLOCK_SOURCE: 0,
                reg.STREAM_AUTO_TARGET: ETHERNET,
                reg.STREAM_NUM_SCANS: 0,
                reg.STREAM_TRIGGER_INDEX: 0,
                **{reg.stream_scanlist(index): register.address for index, register in enumerate(scan_list)},
            }
        )
        self._registers.write(reg.STREAM_SCANRATE_HZ, rate_hz)  # reads back as the nearest rate that the T7 supports
        self._registers.write(reg.STREAM_DATATYPE, 0)  # in no register map, so it may not be readable

    def _forget_stream(self) -> None:
        self._stream.close()
        self._scans = None


Driver = LabJackT7
