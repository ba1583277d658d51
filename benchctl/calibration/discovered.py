"""Structures that a diagnosis found but could not name, subtracted from the output before a law is fitted or applied.

    V = U0 + (U − f_b − U0)/(1 + f_s)

is the output of the law. f_s, of structures of the scale factor, and f_b [V], of those of the bias, are functions of
quantities that are known for a gyro in use: its temperature, its output, and the rate, which results from the law.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TypeGuard

import numpy as np

from benchctl.limits import listed
from benchctl.model_file import Model
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.effects.effect import PhysicalEffect
from benchctl_instruments.physics.effects.making import make_effects
from benchctl_instruments.physics.structure_places import direction
from benchctl_instruments.physics.structures import Structure, structure_named

TURNS, PLAIN_TURNS, FEWEST_TURNS = 200, 20, 2
"""Maximum number of iterations for the rate, the number of undamped ones among them, and the minimum number."""
CONVERGED = 1e-12
"""Largest change in the last iteration, relative to a rate of at least 1 °/s."""
MEASURED = ("gyro_temp", "rate", "abs_rate", "rate_sign", "output")
"""Coordinates that are known while a gyro is in use."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Discovered:
    """Structures of the scale factor and of the bias by name; `U0_v` is the output at zero rate.

    `left` are the names of the model's further structures, which cannot be subtracted.
    """

    U0_v: float = 0.0
    structures: Mapping[str, Structure] = field(default_factory=dict)
    left: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        """Whether there is anything to subtract."""
        return bool(self.structures)

    @property
    def needs_temperature(self) -> bool:
        """Whether a structure depends on the temperature."""
        return any("gyro_temp" in (one.over, one.times) for one in self.structures.values())

    def volts(self, law_v: FloatArray, rate_dps: FloatArray, celsius: FloatArray) -> FloatArray:
        """Return the output [V] for the law's output `law_v` at sensed rates and temperatures; arrays of shape (n,)."""
        scale, _ = self._changes(rate_dps, celsius, law_v)
        scaled = self.U0_v + (law_v - self.U0_v) * scale
        return scaled + self._changes(rate_dps, celsius, scaled)[1]

    def taken_off(self, volts: FloatArray, rate_dps: FloatArray, celsius: FloatArray) -> FloatArray:
        """Return the law's output for known rates; arrays of one shape (n,)."""
        before = law_v = volts
        for _ in range(PLAIN_TURNS if any(one.over == "output" for one in self.structures.values()) else 1):
            before, law_v = self._taken_off(volts, rate_dps, celsius, before)
        return law_v

    def rate_dps(
        self, volts: FloatArray, celsius: FloatArray, law: Callable[[FloatArray, FloatArray], FloatArray]
    ) -> FloatArray:
        """Return sensed rates [°/s] of outputs [V] at temperatures [°C], all (n,), by a `law` of corrected outputs.

        A dependence on the rate is evaluated at the rate of the previous iteration, at first at rest. If an output
        belongs to two rates, or to none, as is possible within a step over the rate, the result is one nearby.
        """
        rate, before, left = np.zeros_like(volts), volts.copy(), np.arange(volts.size)
        with np.errstate(all="ignore"):
            for turn in range(TURNS):
                before[left], law_v = self._taken_off(volts[left], rate[left], celsius[left], before[left])
                following = law(law_v, celsius[left])
                moved = np.abs(following - rate[left]) > CONVERGED * (1.0 + np.abs(following))
                rate[left] = following if turn < PLAIN_TURNS else 0.5 * (rate[left] + following)
                left = left[moved] if turn + 1 >= FEWEST_TURNS else left
                if not left.size:
                    break
        return rate

    def _taken_off(
        self, volts: FloatArray, rate_dps: FloatArray, celsius: FloatArray, before: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the output without the bias's structures, starting from `before`, and that without all structures."""
        scale, bias_v = self._changes(rate_dps, celsius, before)
        before = volts - bias_v
        return before, self.U0_v + (before - self.U0_v) / scale

    def _changes(
        self, rate_dps: FloatArray, celsius: FloatArray, output_v: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the factor on the scale factor, and the change of the bias [V]."""
        coordinates = {
            "gyro_temp": celsius,
            "rate": rate_dps,
            "abs_rate": np.abs(rate_dps),
            "rate_sign": direction(rate_dps),
            "output": output_v,
        }
        scale, bias_v = np.ones_like(rate_dps), np.zeros_like(rate_dps)
        for one in self.structures.values():
            change = one.value_at(coordinates[one.over])
            if one.times:
                change = change * coordinates[one.times]
            if one.acts_on == "scale":
                scale = scale * (1.0 + change)
            else:
                bias_v = bias_v + change
        return scale, bias_v

    def as_json(self) -> dict[str, object]:
        """Return the structures as in `coefficients.json`."""
        return {"U0_v": self.U0_v, "structures": {name: one.values for name, one in self.structures.items()}}


def discovered_in(U0_v: float, tables: Mapping[str, Mapping[str, float]]) -> Discovered:
    """Create structures from their identifiers and parameters.

    Raises
    ------
    UsageError
        If one is no structure, has other parameters, or cannot be subtracted.
    """
    found = {}
    for name, values in tables.items():
        effect = make_effects({name: values}, where="discovered")[0]
        if not _is_compensable(effect):
            raise UsageError(f"[discovered.{name}] {NOT_TAKEN_OFF}; take it out")
        found[name] = effect
    return Discovered(U0_v=U0_v, structures=found)


def discovered_of(model: Model) -> Discovered:
    """Return the structures of a model that can be subtracted; `left` names those that cannot.

    Raises
    ------
    UsageError
        If none can be, or the model does not state the output at rest.
    """
    found = {
        name: make_effects({name: values}, where="discovered")[0]
        for name, values in model.effects.items()
        if structure_named(name) is not None
    }
    if not found:
        raise UsageError("has no table [discovered.…], of a structure without a name; benchctl diagnose writes it")
    structures = {name: one for name, one in found.items() if _is_compensable(one)}
    left = tuple(name for name in found if name not in structures)
    if not structures:
        raise UsageError(f"{listed(left)}: {NOT_TAKEN_OFF}; fit without it")
    U0_v = (model.simulation or {}).get("U0_v")
    if U0_v is None:
        raise UsageError("[simulation] U0_v is missing, expected the output at rest, from which a scale factor counts")
    return Discovered(U0_v=float(U0_v), structures=structures, left=left)


NOT_TAKEN_OFF = (
    "only a structure of the scale factor or the bias can be taken off, over what is known where a gyro is used "
    f"({', '.join(MEASURED)}) and without memory"
)


def _is_compensable(one: PhysicalEffect) -> TypeGuard[Structure]:
    if not isinstance(one, Structure):
        return False
    known = {one.over, one.times} - {""} <= set(MEASURED)
    of_output = "output" in (one.over, one.times) and one.acts_on == "scale"
    return one.pointwise and one.acts_on in ("scale", "bias") and known and not of_output
