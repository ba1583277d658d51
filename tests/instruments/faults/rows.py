"""The drivers of the matrix: one line each. A new driver is a new line here, and its outcomes in `outcomes.py`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from benchctl_instruments.catalog import counts_encoder
from benchctl_instruments.links.modbus import Retry
from benchctl_instruments.links.tcp import Reconnect

TIMEOUT_S = 0.25
MODBUS = {"timeout_s": TIMEOUT_S, "retry": Retry(wait_s=0.1)}
LINES = {"timeout_s": TIMEOUT_S, "reconnect": Reconnect(wait_s=0.1)}


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """A driver, and the requests at which faults befall it.

    `asks` and `tells` are patterns over requests as `simulated.faults.wires` shows them: a question that
    the driver asks again and again, and a command that is not the first. `options` are the driver's. One whose link
    is `like` another's is left out of the sweep.
    """

    model: str
    kind: Literal["rate_table", "chamber", "digitizer", "gyro"]
    asks: str = ""
    tells: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)
    like: str = ""

    def __str__(self) -> str:
        return self.model

    @property
    def is_slow(self) -> bool:
        """Whether it is a digitizer without an encoder: it does not see what is stuck."""
        return self.kind == "digitizer" and not counts_encoder(self.model)

    @property
    def has_packets(self) -> bool:
        """Whether it is a digitizer with a stream of packets of its own, which faults can befall."""
        return self.model == "labjack_t7"


RTU = {**MODBUS, "pause_s": 0.0}

ROWS = (
    Row(model="watlow_f4", kind="chamber", asks="^03 00 64", tells="^06 01 2c", options=RTU),
    Row(model="watlow_f4t", kind="chamber", asks="^03 0b 04", tells="^10 0a de", options=MODBUS),
    Row(model="eurotherm_2400", kind="chamber", asks="^03 80 02", tells="^10 80 04", options=RTU, like="watlow_f4"),
    Row(model="eurotherm_3500", kind="chamber", asks="^03 01 21", tells="^10 00 18", options=RTU, like="watlow_f4"),
    Row(model="binder_mb1", kind="chamber", asks="^03 11 a9", tells="^10 15 81", options=RTU, like="watlow_f4"),
    Row(model="binder_mb2", kind="chamber", asks="^03 10 d2", tells="^10 11 4c", options=RTU, like="watlow_f4"),
    Row(model="csz_ezt430i", kind="chamber", asks="^03 00 23", tells="^06 00 24", options=RTU, like="watlow_f4"),
    Row(model="espec_p300", kind="chamber", asks=r"^TEMP\?", tells="^TEMP, S-20", options=LINES, like="acutrol3000"),
    Row(model="weiss_simserv", kind="chamber", asks="^11004", tells=r"^11001.*\.0$", options=LINES, like="acutrol3000"),
    Row(model="weiss_ascii2", kind="chamber", asks=r"^\$01I", tells=r"^\$01E -020", options=LINES, like="acutrol3000"),
    Row(
        model="watlow_f4t_scpi",
        kind="chamber",
        asks=r"PVALUE\?",
        tells="SPOINT -20",
        options=LINES,
        like="acutrol3000",
    ),
    Row(
        model="thermotron_3800", kind="chamber", asks=r"^PVAR1\?", tells="^SETP1,-20", options=LINES, like="acutrol3000"
    ),
    Row(
        model="thermotron_8800", kind="chamber", asks=r"^PVAR1\?", tells="^SETP1,-20", options=LINES, like="acutrol3000"
    ),
    Row(model="acutrol3000", kind="rate_table", asks="^:read", tells="^:dem:rate 1,40", options=LINES),
    Row(
        model="aerotech_ensemble",
        kind="rate_table",
        asks="^PFBKPROG",
        tells="^FREERUN",
        options=LINES,
        like="acutrol3000",
    ),
    Row(model="newport_esp301", kind="rate_table", asks=r"1TP\?", tells="1VA40", options=LINES),
    Row(
        model="labjack_t7",
        kind="digitizer",
        asks="^03 00 00",
        tells="^10 0f a2",
        options={"timeout_s": TIMEOUT_S, "fastest_counts_per_s": 1e6},
    ),
    Row(model="ni_daqmx", kind="digitizer", options={"fastest_counts_per_s": 1e6}),
    Row(model="keithley_daq6510", kind="digitizer", asks="^TRAC:ACT", tells="^ABOR;:TRAC:CLE", options=LINES),
    Row(model="keysight_34970a", kind="digitizer", asks="^DATA:POIN", tells="^ABOR;:INIT", options=LINES),
    Row(
        model="keysight_daq970a",
        kind="digitizer",
        asks="^DATA:POIN",
        tells="^ABOR;:INIT",
        options=LINES,
        like="keysight_34970a",
    ),
)

GYROS = (Row(model="kvh_dsp1760", kind="gyro"), Row(model="sensonor_stim300", kind="gyro"))
"""Digital gyros send by themselves: what befalls them are the faults of their frames, in a short campaign."""
