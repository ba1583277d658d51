"""A simulated NI X series device behind an NI gRPC Device Server, whose calls are those of NI-DAQmx's C interface.

The messages are NI's own (nidaqmx.proto, which the package nidaqmx contains): a program that is written with this
package runs on it if it hands `grpc_options` to its tasks. Analog inputs in volts and angular encoders are served, any
other call is unimplemented. What they do is taken from NI's documentation of NI-DAQmx:

- A count begins at the initial angle when its task starts, and is a signed number of 32 bits.
- A task whose sample clock is `/Dev1/ai/SampleClock` gets a sample with each clock of the analog inputs, of which one
  task runs at a time: a second one is refused (-50103). A read starts a task that does not run.
- A sample clock is the time base of 100 MHz divided by a whole number.
- A buffer that is not read in time is overwritten: a read then fails with -200279; one that waits in vain with -200284.
"""

from __future__ import annotations

import itertools
import math
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.adc import codes_from_volts, volts_from_codes
from benchctl_instruments.simulated.machines import SINGLE_READING_S, AnalogInputs

DEVICE, PRODUCT, SERIAL = "Dev1", "USB-6343", 0x01A2B3C4
CLOCK, TIME_BASE_HZ = f"/{DEVICE}/ai/SampleClock", 100e6
TERMINALS = {"ai": 32, "ctr": 4}
RANGES_V = (0.2, 1.0, 5.0, 10.0)
ROUNDING = 1e-6  # in scan intervals: the delay after its instant at which a scan counts as past

RESERVED = (-50103, "The specified resource is reserved. The operation could not be completed as specified.")
NO_DEVICE = (-200220, "Device identifier is invalid.")
NO_CHANNEL = (-200170, "Physical channel specified does not exist on this device.")
OVERWRITTEN = (-200279, "The application is not able to keep up with the hardware acquisition.")
TIMED_OUT = (-200284, "Some or all of the samples requested have not yet been acquired.")
BAD_VALUE = (-200077, "Requested value is not a supported value for this property.")

X4, DEGREES, FINITE = 10092, 10146, 10178  # constants of NI-DAQmx; below, its attributes
VERSION = {0x1272: 24, 0x1923: 8, 0x2F22: 0}  # of the driver: major, minor, update
AVAILABLE, CLOCK_RATE, TASK_NAME, CHANNELS = 0x1223, 0x1344, 0x1276, 0x1823
PRODUCT_TYPE, SERIAL_NUMBER = 0x631, 0x632
ANALOG_KIND, COUNTER_KIND = {0x187F: 10100, 0x695: 10322}, {0x187F: 10131, 0x18A0: 10360}


class RefusedError(Exception):
    """NI-DAQmx answers with an error; the arguments are its code and text."""


@dataclass(slots=True)
class Task:
    """A task: what its channels return for scans, its clock, and the samples not yet read, one row a channel."""

    names: list[str] = field(default_factory=list)
    channels: list[Callable[[FloatArray, FloatArray, FloatArray], FloatArray]] = field(default_factory=list)
    is_counter: bool = False
    zero: float = 0.0  # count at its start
    rate_hz: float = 1000.0
    source: str = ""
    finite: bool = False
    buffer_scans: int = 10_000
    running: bool = False
    overwritten: bool = False
    first_s: float = 0.0
    taken: int = 0
    samples: FloatArray = field(default_factory=lambda: np.empty((0, 0)))


class SimulatedNiDaqmx:
    """An NI device `Dev1` at `address`, while it is entered.

    Parameters
    ----------
    inputs
        The signals at its terminals.
    encoder_channel, gyro_ain, thermistor_ain
        The wiring: a counter and two analog inputs; other inputs read 0 V, other counters do not move.

    `calls` are the calls so far: each name, and its message.
    """

    def __init__(
        self, inputs: AnalogInputs, *, encoder_channel: int = 0, gyro_ain: int = 0, thermistor_ain: int = 1
    ) -> None:
        self.calls: list[tuple[str, Any]] = []
        self._inputs = inputs
        self._counter, self._gyro, self._thermistor = encoder_channel, gyro_ain, thermistor_ain
        self._tasks: dict[str, Task] = {}
        self._numbers = itertools.count()
        self._lock = threading.RLock()
        self._server: Any = None
        self._port = 0
        self._answers: dict[str, Callable[[Any, Task], Any]] = {  # by the names of nidaqmx.proto
            "GetSystemInfoAttributeUInt32": lambda request, _: VERSION[request.attribute_raw],
            "GetDeviceAttributeString": lambda request, _: {PRODUCT_TYPE: PRODUCT}[request.attribute_raw],
            "GetDeviceAttributeUInt32": lambda request, _: {SERIAL_NUMBER: SERIAL}[request.attribute_raw],
            "GetTaskAttributeString": lambda request, _: {TASK_NAME: request.task.name}[request.attribute_raw],
            "GetReadAttributeString": lambda request, task: {CHANNELS: ", ".join(task.names)}[request.attribute_raw],
            "GetReadAttributeUInt32": lambda request, task: {AVAILABLE: task.samples.shape[1]}[request.attribute_raw],
            "GetTimingAttributeDouble": lambda request, task: {CLOCK_RATE: task.rate_hz}[request.attribute_raw],
            "GetChanAttributeInt32": self._kind,
            "CreateTask": self._create,
            "CreateAIVoltageChan": self._add_analog,
            "CreateCIAngEncoderChan": self._add_encoder,
            "CfgSampClkTiming": self._set_clock,
            "StartTask": lambda _, task: self._begin(task),
            "StopTask": lambda _, task: self._end(task),
            "ClearTask": lambda request, _: self._end(self._tasks.pop(request.task.name)),
            "ReadAnalogF64": self._read,
            "ReadCounterF64Ex": self._read,
        }

    @property
    def address(self) -> str:
        """`daqmx://HOST:PORT/Dev1`."""
        return f"daqmx://127.0.0.1:{self._port}/{DEVICE}"

    def __enter__(self) -> Self:
        try:
            import grpc
            from nidaqmx._stubs import nidaqmx_pb2 as messages
        except ImportError as err:
            raise UsageError(
                "the simulated NI device needs NI's package nidaqmx, which is not installed: pip install"
                " 'benchctl[daqmx]'"
            ) from err
        handlers = {
            name: grpc.unary_unary_rpc_method_handler(
                self._handler(name, getattr(messages, f"{name}Response"), grpc.StatusCode.UNKNOWN),
                request_deserializer=getattr(messages, f"{name}Request").FromString,
                response_serializer=getattr(messages, f"{name}Response").SerializeToString,
            )
            for name in self._answers
        }
        self._server = grpc.server(ThreadPoolExecutor(4))
        self._server.add_generic_rpc_handlers((grpc.method_handlers_generic_handler("nidaqmx_grpc.NiDAQmx", handlers),))
        self._port = self._server.add_insecure_port("127.0.0.1:0")
        self._server.start()
        return self

    def __exit__(self, *exc: object) -> None:
        self._server.stop(None).wait()
        self._inputs.hold_history(None)

    def _handler(self, name: str, response: Any, failed: Any) -> Callable[[Any, Any], Any]:
        def handle(request: Any, context: Any) -> Any:
            self.calls.append((name, request))
            try:
                if getattr(request, "device_name", DEVICE) != DEVICE:
                    raise RefusedError(*NO_DEVICE)
                if name.startswith("Read"):
                    self._wait(request)
                with self._lock:
                    self._take()
                    task = self._tasks[request.task.name] if hasattr(request, "task") else Task()
                    answer = self._answers[name](request, task)
            except RefusedError as err:
                code, text = err.args
                context.set_trailing_metadata((("ni-error", str(code)),))
                context.abort(failed, text)
            return response(**(answer if isinstance(answer, dict) else {} if answer is None else {"value": answer}))

        return handle

    def _kind(self, request: Any, task: Task) -> dict[str, int]:
        return {"value_raw": (COUNTER_KIND if task.is_counter else ANALOG_KIND)[request.attribute_raw]}

    def _create(self, request: Any, _: Task) -> dict[str, Any]:
        name = request.session_name or f"_unnamedTask<{next(self._numbers)}>"
        self._tasks[name] = Task()
        return {"task": {"name": name}, "new_session_initialized": True}

    def _add_analog(self, request: Any, task: Task) -> None:
        terminal = _terminal(request.physical_channel, "ai")
        range_v = min((each for each in RANGES_V if each >= max(-request.min_val, request.max_val)), default=0.0)
        if not range_v:
            raise RefusedError(*BAD_VALUE)

        def volts(_: FloatArray, gyro_v: FloatArray, thermistor_v: FloatArray) -> FloatArray:
            wired = {self._gyro: gyro_v, self._thermistor: thermistor_v}.get(terminal, np.zeros_like(gyro_v))
            return volts_from_codes(codes_from_volts(wired, range_v=range_v), range_v=range_v)

        task.names.append(request.physical_channel)
        task.channels.append(volts)

    def _add_encoder(self, request: Any, task: Task) -> None:
        wired = _terminal(request.counter, "ctr") == self._counter
        if request.units_raw != DEGREES or request.decoding_type_raw != X4 or request.zidx_enable:
            raise RefusedError(*BAD_VALUE)

        def degrees(count: FloatArray, *_: FloatArray) -> FloatArray:
            ticks = ((count - task.zero) * wired + (1 << 31)) % (1 << 32) - (1 << 31)
            return ticks * (90.0 / float(request.pulses_per_rev)) + float(request.initial_angle)

        task.names, task.channels, task.is_counter = [request.counter], [degrees], True

    def _set_clock(self, request: Any, task: Task) -> None:
        if not 0.0 < request.rate <= TIME_BASE_HZ:
            raise RefusedError(*BAD_VALUE)
        task.rate_hz, task.source = TIME_BASE_HZ / round(TIME_BASE_HZ / request.rate), request.source
        task.finite, task.buffer_scans = request.sample_mode_raw == FINITE, request.samps_per_chan

    def _begin(self, task: Task) -> None:
        if any(other.running and other.is_counter == task.is_counter for other in self._tasks.values()):
            raise RefusedError(*RESERVED)
        task.first_s, task.taken, task.overwritten, task.running = self._inputs.now(), 0, False, True
        task.samples = np.empty((len(task.channels), 0))
        if task.is_counter:
            task.zero = float(self._inputs.sample(task.first_s, SINGLE_READING_S, 1)[0][0])
        else:
            self._inputs.hold_history(task.first_s)
            self._take()

    def _end(self, task: Task) -> None:
        """Stop a task; what its clock latched into another one can still be read."""
        task.running = False
        if not task.is_counter:
            self._inputs.hold_history(None)

    def _wait(self, request: Any) -> None:
        """Start a task that does not run, and wait for its samples, at most for the timeout that the call states."""
        with self._lock:
            task = self._tasks[request.task.name]
            if not task.running:
                self._begin(task)
            self._take()
            missing = request.num_samps_per_chan - task.samples.shape[1]
        if missing > 0 and not task.is_counter:
            self._inputs.wait_until(task.first_s + (task.taken + missing - 1) / task.rate_hz, request.timeout)

    def _read(self, request: Any, task: Task) -> dict[str, Any]:
        """Return samples, those of one channel after those of the other."""
        scans = request.num_samps_per_chan
        if task.overwritten:
            raise RefusedError(*OVERWRITTEN)
        if task.samples.shape[1] < scans:
            raise RefusedError(*TIMED_OUT)
        samples, task.samples = task.samples[:, :scans], task.samples[:, scans:]
        return {"read_array": samples.ravel().tolist(), "samps_per_chan_read": scans}

    def _take(self) -> None:
        """Sample what is due since the last call, for the analog inputs and the counter that their clock latches."""
        analog = next((task for task in self._tasks.values() if task.running and not task.is_counter), None)
        if analog is None:
            return
        due = math.floor((self._inputs.now() - analog.first_s) * analog.rate_hz + ROUNDING) + 1
        due = min(due, analog.buffer_scans) if analog.finite else due
        if due <= analog.taken:
            return
        scans = self._inputs.sample(analog.first_s, 1.0 / analog.rate_hz, due - analog.taken, start=analog.taken)
        columns = [np.asarray(each, np.float64) for each in scans]
        for task in self._tasks.values():
            if task is analog or (task.running and task.source == CLOCK):
                fresh = np.stack([channel(*columns) for channel in task.channels])
                task.samples = np.concatenate([task.samples, fresh], axis=1)
                task.overwritten |= task.samples.shape[1] > task.buffer_scans
        analog.taken = due
        self._inputs.hold_history(analog.first_s + due / analog.rate_hz)


def _terminal(physical_channel: str, kind: str) -> int:
    device, _, name = physical_channel.partition("/")
    if device != DEVICE:
        raise RefusedError(*NO_DEVICE)
    number = name.removeprefix(kind)
    if not name.startswith(kind) or not number.isdecimal() or int(number) >= TERMINALS[kind]:
        raise RefusedError(*NO_CHANNEL)
    return int(number)


Twin = SimulatedNiDaqmx
