"""What is expected of every driver in every fault. A driver or a fault without an entry fails the tests."""

from __future__ import annotations

from collections.abc import Mapping

from tests.instruments.faults.cells import GAP, IMPOSSIBLE, RECOVERED, STOPPED

BOTH_RECOVER, BOTH_STOP, NEITHER = (RECOVERED, RECOVERED), (STOPPED, STOPPED), (IMPOSSIBLE, IMPOSSIBLE)

LINK: Mapping[str, tuple[str, str]] = {
    "silence": BOTH_RECOVER,
    "lost request": BOTH_RECOVER,
    "late answer": BOTH_RECOVER,
    "slow answer": BOTH_RECOVER,
    "another unit's answer": BOTH_RECOVER,
    "CRC error": BOTH_RECOVER,
    "junk before": BOTH_RECOVER,
    "junk in": BOTH_RECOVER,
    "junk after": BOTH_RECOVER,
    "split": BOTH_RECOVER,
    "cut": BOTH_RECOVER,
    "half a float": BOTH_RECOVER,
    "refusal": BOTH_STOP,
    "pulled cable, 0.1 s": BOTH_RECOVER,
    "restart, 0.1 s": BOTH_RECOVER,
}
"""At a question and at a command, for every driver of which nothing else is said below."""

LINES = {"another unit's answer": NEITHER, "CRC error": NEITHER, "half a float": NEITHER}
"""Lines of text have no units, no checksums and no registers."""

LINK_OF: Mapping[str, Mapping[str, tuple[str, str]]] = {
    "watlow_f4t": {"CRC error": NEITHER},
    "espec_p300": {**LINES, "refusal": BOTH_RECOVER},  # CHB NOT READY asks to wait
    "weiss_simserv": LINES,
    "weiss_ascii2": {**LINES, "refusal": NEITHER},
    "thermotron_3800": {**LINES, "refusal": NEITHER},
    "thermotron_8800": {**LINES, "refusal": NEITHER},  # a refusing code cannot be told from a temperature
    "acutrol3000": {**LINES, "restart, 0.1 s": BOTH_STOP},
    "aerotech_ensemble": {
        **LINES,
        "refusal": (RECOVERED, STOPPED),
        "restart, 0.1 s": BOTH_STOP,
    },
    "newport_esp301": {
        **LINES,
        "refusal": NEITHER,
        "lost request": (RECOVERED, STOPPED),
        "pulled cable, 0.1 s": (RECOVERED, STOPPED),
        "restart, 0.1 s": BOTH_STOP,
    },
    "watlow_f4t_scpi": {**LINES, "refusal": NEITHER},
    "keithley_daq6510": {**LINES, "refusal": NEITHER},
    "keysight_34970a": {**LINES, "refusal": NEITHER},
    "keysight_daq970a": {**LINES, "refusal": NEITHER},
    "ni_daqmx": dict.fromkeys(LINK, NEITHER),  # NI's own wire, which the simulated one does not play faults on
    "labjack_t7": {"CRC error": NEITHER, "restart, 0.1 s": BOTH_STOP},
}

MACHINE: Mapping[str, str] = {
    "stuck reading": STOPPED,
    "over-range sensor": STOPPED,
    "stalls short of the set point": STOPPED,
    "interlock opened by hand": STOPPED,
    "following error": STOPPED,
    "velocity trip": STOPPED,
    "encoder jump": STOPPED,
    "clock drift, 20 ppm": RECOVERED,
}
"""In a short campaign, whichever the driver is."""

STREAM: Mapping[str, str] = {
    "stream gap": GAP,
    "overrun and auto-recovery": GAP,
    "stream cut": GAP,
    "stream junk": RECOVERED,
    "stream stalls, 0.5 s": RECOVERED,
    "stream ends": GAP,  # a campaign starts it anew
}

FRAMES: Mapping[str, str] = {
    "frame lost": GAP,
    "frame cut": GAP,
    "frame with a bad checksum": GAP,
    "junk before a frame": RECOVERED,
    "junk in a frame": GAP,
    "junk after a frame": RECOVERED,
    "frames end": STOPPED,
}
"""In a short campaign, whichever the gyro is."""


def of_link(model: str, fault: str) -> tuple[str, str]:
    """What is expected at a question and at a command."""
    return LINK_OF.get(model, {}).get(fault, LINK[fault])
