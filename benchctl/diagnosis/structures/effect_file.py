"""Export of a structure as the Python source of an effect. The user then adds a name and a description."""

from __future__ import annotations

from benchctl.diagnosis.result import StructureModel
from benchctl_instruments.physics.effects.effect import Parameter
from benchctl_instruments.physics.structures import structure_named

WRITTEN = ("scale", "bias", "sampling")
"""Stages whose structures can be exported. Encoder and noise structures can only be written to a model file."""
_ROOM = 3.0
"""Factor between the fitted value of a size or a width and its bounds."""


def effect_source(identifier: str, found: StructureModel) -> str:
    """Return the Python source of the effect `identifier` that reproduces a structure, with bounds around its values.

    The effect passes `benchctl_instruments.physics.effect_contract.check_effect`. Raises `ValueError` if `identifier`
    is not a valid Python name or `found` is not a structure of one of the stages `WRITTEN`.
    """
    kind = structure_named(found.identifier)
    if kind is None or kind.acts_on not in WRITTEN or not identifier.isidentifier():
        raise ValueError(f"no effect {identifier!r} can be made of {found.identifier!r}")
    values = {name: estimate.value for name, estimate in found.parameters.items()}
    name = "".join(part.capitalize() for part in identifier.split("_"))
    parameters = "".join(
        _PARAMETER.format(name=one, **_about(kind.parameters[one], value)) for one, value in values.items()
    )
    return _SOURCE.format(
        identifier=identifier,
        name=name,
        sentence=found.says,
        fields="\n".join(f"    {one}: float" for one in values),
        stage=kind.stage,
        coordinate=kind.coordinate,
        pointwise=kind.pointwise,
        timeless=kind.timeless,
        momentary=kind.momentary,
        equation=kind.equation,
        excited_by=kind.excited_by,
        hints="; ".join(found.hints) or "none known",
        parameters=parameters.rstrip("\n"),
        structure=found.identifier,
    )


def _about(parameter: Parameter, value: float) -> dict[str, object]:
    """Return the fields of a parameter (bounds, scan, role, …) around a value."""
    wide = _ROOM * max(abs(value), 1e-12)
    low, high = (value / _ROOM, value * _ROOM) if parameter.logarithmic else (-wide, wide)
    if parameter.role == "assumed":
        low, high = value - 1e-6 * max(abs(value), 1.0), value + 1e-6 * max(abs(value), 1.0)
    scan = (1e-3 * abs(value),) if parameter.role == "size" else (value,)
    return {
        "unit": parameter.unit,
        "meaning": parameter.meaning,
        "low": low,
        "high": high,
        "role": parameter.role,
        "scan": scan,
        "zero": 0.0 if parameter.role == "size" else None,
        "logarithmic": parameter.logarithmic,
    }


_PARAMETER = """\
        "{name}": Parameter(
            unit="{unit}",
            meaning="{meaning}",
            low={low!r},
            high={high!r},
            role="{role}",
            scan={scan!r},
            zero={zero!r},
            logarithmic={logarithmic!r},
        ),
"""

_SOURCE = '''"""{sentence}

Written by benchctl diagnose --write-effect. Complete the words and the look-alikes; list the class among the entry
points "benchctl.effects" of your package, as {identifier}; check it with
benchctl_instruments.physics.effect_contract.check_effect. Causes of this kind: {hints}.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.effects.effect import Parameter, PhysicalEffect
from benchctl_instruments.physics.structures import Structure, structure_named


@dataclass(frozen=True, slots=True, kw_only=True)
class {name}(PhysicalEffect):
    """{sentence}"""

{fields}

    identifier: ClassVar[str] = "{identifier}"
    stage: ClassVar[Stage] = "{stage}"
    pointwise: ClassVar[bool] = {pointwise}
    timeless: ClassVar[bool] = {timeless}
    momentary: ClassVar[bool] = {momentary}
    words: ClassVar[str] = "{sentence}"
    equation: ClassVar[str] = "{equation}"
    coordinate: ClassVar[str] = "{coordinate}"
    excited_by: ClassVar[str] = "{excited_by}"
    look_alikes: ClassVar[tuple[str, ...]] = ()
    parameters: ClassVar[Mapping[str, Parameter]] = {{
{parameters}
    }}

    @property
    def _structure(self) -> Structure:
        kind = structure_named("{structure}")
        assert kind is not None
        return kind.make(self.values)

    def apply(self, signals: Signals) -> Signals:
        """The signals with the effect."""
        return self._structure.apply(signals)

    def says(self) -> str:
        """The finding in one sentence."""
        return self._structure.says()
'''
