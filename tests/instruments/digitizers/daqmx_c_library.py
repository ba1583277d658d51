"""A stand-in for NI's C library, for `nidaqmx` on a computer without it: its functions, over a simulated device."""

from __future__ import annotations

import ctypes
import threading
from types import SimpleNamespace
from typing import Any

from benchctl_instruments.simulated.ni_daqmx import SimulatedNiDaqmx

ARGUMENTS = {  # NIDAQmx.h, by the names of nidaqmx.proto
    "CreateTask": "session_name out",
    "CreateCIAngEncoderChan": "task counter name decoding_type_raw zidx_enable zidx_val zidx_phase_raw units_raw"
    " pulses_per_rev initial_angle scale",
    "CreateAIVoltageChan": "task physical_channel name terminal_config_raw min_val max_val units_raw scale",
    "CfgSampClkTiming": "task source rate active_edge_raw sample_mode_raw samps_per_chan",
    "StartTask": "task",
    "StopTask": "task",
    "ClearTask": "task",
    "ReadAnalogF64": "task num_samps_per_chan timeout fill_mode_raw array size out reserved",
    "ReadCounterF64Ex": "task num_samps_per_chan timeout fill_mode_raw array size out reserved",
    "GetSystemInfoAttribute": "attribute_raw out",
    "GetDeviceAttribute": "device_name attribute_raw out size",
    "GetTaskAttribute": "task attribute_raw out size",
    "GetReadAttribute": "task attribute_raw out size",
    "GetTimingAttribute": "task attribute_raw out",
}


class RefusedError(Exception):
    """NI-DAQmx returns a negative code."""


class CLibrary:
    """What `ctypes` would load; an attribute is a function that takes what `nidaqmx` passes, and returns a code."""

    def __init__(self, twin: SimulatedNiDaqmx) -> None:
        self._twin = twin
        self._names: dict[int, str] = {}  # of tasks, by their handles
        self._code, self._text = 0, ""

    def __getattr__(self, name: str) -> Any:
        def function(*arguments: Any) -> int:
            return self._call(name.removeprefix("DAQmx"), arguments)

        function.argtypes, function.arg_lock = None, threading.Lock()  # type: ignore[attr-defined]
        return function

    def set_trailing_metadata(self, pairs: Any) -> None:
        ((_, code),) = pairs
        self._code = int(code)

    def abort(self, _: Any, text: str) -> None:
        self._text = text
        raise RefusedError

    def _call(self, name: str, arguments: tuple[Any, ...]) -> int:
        if name == "GetExtendedErrorInfo":
            arguments[0].value = f"{self._text}\n\nTask Name: _unnamedTask<0>\n\nStatus Code: {self._code}".encode()
            return 0
        if name == "SetRuntimeEnvironment":
            return 0
        if name == "InternalGetLastCreatedChan":
            return _text_into(*arguments, "the channel")
        fields = dict(zip(ARGUMENTS[name].split(), arguments, strict=False))
        out = fields.pop("out", None)
        if "task" in fields:
            fields["task"] = SimpleNamespace(name=self._names[fields["task"].value])
        if name.endswith("Attribute"):
            kind = {ctypes.c_uint32: "UInt32", ctypes.c_double: "Double"}.get(
                type(getattr(out, "_obj", None)), "String"
            )
            name += kind
        try:
            answer = self._twin._handler(name, dict, None)(SimpleNamespace(**fields), self)
        except RefusedError:
            return self._code
        if name == "CreateTask":
            out._obj.value = len(self._names) + 1
            self._names[out._obj.value] = answer["task"]["name"]
        elif "array" in fields:
            fields["array"].reshape(-1)[:] = answer["read_array"]
            out._obj.value = answer["samps_per_chan_read"]
        elif name.endswith("String"):
            return _text_into(out, fields["size"], answer["value"])
        elif out is not None:
            out._obj.value = answer["value"]
        return 0


def _text_into(buffer: Any, size: int, text: str) -> int:
    """Return the size that a text needs, or write it into a buffer."""
    if not size:
        return len(text) + 1
    buffer.value = text.encode()
    return 0
