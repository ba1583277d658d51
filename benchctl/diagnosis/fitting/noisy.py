"""Something found of the noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from benchctl.diagnosis.fitting.noise import Whitener


@dataclass(frozen=True, slots=True, kw_only=True)
class Noisy:
    """What was found: its gain in twice the log likelihood, its size, and the error of the size's logarithm.

    The size of a wandering bias is in units of the white noise's deviation; that of noise that grows is the growth of
    its variance up to full rate. `whitener` is the one with it; `rivals` are the losses with
    another process in its place.
    """

    effect: str
    gain: float
    size: float
    log_error: float
    whitener: Whitener
    rivals: Mapping[str, float] = field(default_factory=dict)
