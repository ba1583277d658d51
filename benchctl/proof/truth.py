"""What a trial conceals, and its seal."""

from __future__ import annotations

import hashlib
import json
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from benchctl.bench import Bench
from benchctl.diagnosis.result import Verdict
from benchctl.proof.classes import CLASSES, ClassName
from benchctl.proof.unit import TrialUnit
from benchctl_instruments.physics.effects.effect import DescribedEffect, PhysicalEffect
from benchctl_instruments.physics.effects.making import make_effects
from benchctl_instruments.physics.effects.registry import effect

Effects = Mapping[str, Mapping[str, float]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Sealed(ABC):
    """What any trial conceals.

    Attributes
    ----------
    index
        Its number in the proof, from 0.
    kind
        Its class.
    seed
        Seed of the noise.
    effects
        What is missing in the lab's model: parameters by effect of the vocabulary.
    withheld
        Hypotheses that the diagnosis does not receive.
    lives_in
        Coordinates in which an effect that cannot be named may correctly be located.
    nonce
        Random text that prevents guessing the truth from the digest.
    """

    index: int
    kind: ClassName
    seed: int
    effects: Effects = field(default_factory=dict)
    withheld: tuple[str, ...] = ()
    lives_in: tuple[str, ...] = ()
    nonce: str

    @property
    def verdict(self) -> Verdict:
        """The correct verdict of a diagnosis."""
        return CLASSES[self.kind].verdict

    @property
    def nameable(self) -> frozenset[str]:
        """The effects that a diagnosis should name: all for which it has hypotheses."""
        return frozenset(self.effects) - frozenset(self.withheld)

    @abstractmethod
    def kind_of(self, name: str) -> type[DescribedEffect]:
        """Return the effect of this name."""

    @abstractmethod
    def as_json(self) -> dict[str, Any]:
        """Return the truth as JSON data."""

    def digest(self) -> str:
        """Return the SHA-256 of the truth as JSON."""
        text = json.dumps(self.as_json(), sort_keys=True, ensure_ascii=False)
        return hashlib.sha256(text.encode()).hexdigest()


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth(Sealed):
    """What a trial of a gyro conceals.

    Attributes
    ----------
    unit
        The gyro and the bench.
    moved
        Whether the lab's parameters are outdated.
    gain
        Joint gain of the effects in twice the log likelihood, as planned; None if it is not known.
    """

    unit: TrialUnit
    moved: bool = False
    gain: float | None = None

    def kind_of(self, name: str) -> type[DescribedEffect]:
        """Return the effect of this name."""
        return effect(name)

    def made(self) -> tuple[PhysicalEffect, ...]:
        """Return the effects as objects of the simulated bench."""
        circumstances = {
            "T0_c": self.unit.gyro.T0_c,
            "range_dps": self.unit.range_dps,
            "adc_step_v": self.unit.adc_step_v,
            "noise_v_rms": self.unit.noise_v,
            "seed": self.seed,
        }
        return make_effects(self.effects, circumstances)

    def sealed_bench(self) -> Bench:
        """Return the bench with its concealed effects; only the recording process uses it."""
        return self.unit.public_bench().model_copy(
            update={"physics": self.unit.physics(self.seed), "effects": {k: dict(v) for k, v in self.effects.items()}}
        )

    def as_json(self) -> dict[str, Any]:
        """Return the truth as JSON data."""
        return {
            "index": self.index,
            "class": self.kind,
            "effects": {name: dict(values) for name, values in self.effects.items()},
            "moved": self.moved,
            "gain": self.gain,
            "withheld": list(self.withheld),
            "lives_in": list(self.lives_in),
            "seed": self.seed,
            "physics": self.unit.physics(self.seed),
            "nonce": self.nonce,
        }
