"""A table that does at once what is demanded of it, and remembers what that was."""

from __future__ import annotations

from benchctl_instruments.links.serial_port import byte_link
from benchctl_instruments.simulated.machines import TableMotion

HOMING = {
    "aerotech_ensemble": (b"ENABLE @0\n", b"HOME @0\n", b"DISABLE @0\n"),
    "newport_esp301": (b"1MO;1OR1;1WS;1MF;1MD?\r",),
}


def home(model: str, address: str) -> None:
    """Home the axis over its wire, as its operator does after power-up."""
    operator = byte_link(address)
    operator.open(5.0)
    for line in HOMING[model]:
        operator.send(line)
        answer = b""
        while not answer.endswith(b"\n"):
            answer += operator.receive(64, 5.0)
        assert answer.startswith((b"%", b"1")), (line, answer)
    operator.close()


class InstantTable:
    def __init__(self, angle_deg: float = 0.0) -> None:
        self.angle_deg = angle_deg
        self.rate_dps = 0.0
        self.demands: list[tuple[str | float, ...]] = []
        self._limits = (1000.0, 8300.0)

    def motion(self) -> TableMotion:
        return TableMotion(angle_deg=self.angle_deg, rate_dps=self.rate_dps, acceleration_dps2=0.0)

    def close_loop(self) -> None:
        self.demands.append(("close",))

    def open_loop(self) -> None:
        self.rate_dps = 0.0
        self.demands.append(("open",))

    def limits(self) -> tuple[float, float]:
        return self._limits

    def set_limits(self, rate_dps: float, acceleration_dps2: float) -> None:
        self._limits = (rate_dps, acceleration_dps2)

    def demand_rate(self, rate_dps: float) -> None:
        self.rate_dps = rate_dps
        self.demands.append(("rate", rate_dps))

    def demand_angle(self, angle_deg: float) -> None:
        self.rate_dps, self.angle_deg = 0.0, angle_deg
        self.demands.append(("angle", angle_deg))

    def demand_sine(self, amplitude_deg: float, frequency_hz: float, phase_deg: float, slew_deg_per_s: float) -> None:
        self.demands.append(("sine", amplitude_deg, frequency_hz, phase_deg, slew_deg_per_s))


class CountedClock:
    """A clock on which sleeping takes no wall time."""

    chunk_s = 60.0

    def __init__(self) -> None:
        self.elapsed_s = 0.0

    def now(self) -> float:
        return self.elapsed_s

    def sleep(self, seconds: float) -> None:
        self.elapsed_s += seconds
