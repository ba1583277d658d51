"""At which TCP ports the models answer as delivered, for a hint where a connection is refused."""

from __future__ import annotations

_USUAL_PORTS: dict[str, tuple[int, ...]] = {
    "acutrol3000": (9888, 9878),
    "aerotech_ensemble": (8000,),
    "newport_esp301": (5001,),
    "labjack_t7": (502, 702),
    "watlow_f4t": (502,),
    "espec_p300": (10001,),
    "binder_mb2": (10001,),
}
"""From their makers' documents, or from published drivers: see the docstrings of our own."""


def usual_ports(model: str) -> str:
    """The ports of a model in words; empty where none is known."""
    ports = _USUAL_PORTS.get(model, ())
    return f"{model} usually answers at port {' or '.join(map(str, ports))}" if ports else ""
