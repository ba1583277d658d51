"""Model files: what a simulated bench obeys, written by a diagnosis or by hand, played by `benchctl simulate --model`.

    format = "benchctl-model/1"
    recording = "..."              # where it comes from
    [simulation]                   # a lab's model of the gyro, as open recordings bring it
    [effects.thermal_lag]          # physics beside it, by its name in the vocabulary, with its parameters
    tau_s = 312.0
    [discovered.kink_of_scale_over_gyro_temp]   # a structure without a name, by stage, coordinate and shape
    at = 27.7
    above = -4.8e-4
    [physics.table]                # the bench's own parts, as in bench.toml
    [parts.drive]                  # a lab's model of its table's drive, or of its chamber, as diagnosed (`part_models`)

Nothing of this is needed. A file with the tables of `[physics]` at its top level (`[gyro]`, `[table]`, …) is a model
file too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchctl.atomic import whole_file
from benchctl.limits import cut, shown
from benchctl.part_models import check_parts
from benchctl.toml_file import read_text, toml_in_units
from benchctl_instruments.errors import UsageError

FORMAT = "benchctl-model/1"

_PARTS = ("simulation", "effects", "physics", "parts")
_DISCOVERED = "discovered"


@dataclass(frozen=True, slots=True, kw_only=True)
class Model:
    """The content of a model file.

    `simulation` is the gyro's response, None where the gyro of `physics` is meant; `effects` are parameters by effect;
    `parts` are models of the drive and the chamber, which no simulated bench plays; `recording` names what the model
    was made from.
    """

    simulation: Mapping[str, Any] | None = None
    physics: Mapping[str, Any] = field(default_factory=dict)
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    parts: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    recording: str = ""

    @property
    def bench_physics(self) -> dict[str, Any]:
        """The `[physics]` of a simulated bench that obeys the model."""
        return {**self.physics, **({} if self.simulation is None else {"response": self.simulation})}

    def check(self) -> None:
        """Raise a `UsageError` that names the table and field at fault, where there is one."""
        from benchctl_instruments.physics.effects.making import make_effects
        from benchctl_instruments.physics.response_gyro import ResponseParameters
        from benchctl_instruments.simulated.settings import WorldSettings, built

        WorldSettings.from_mapping(self.physics, where="physics")
        if self.simulation is not None:
            built(ResponseParameters, self.simulation, "simulation")
        make_effects(self.effects)
        check_parts(self.parts)


def read_model(path: Path) -> Model:
    """The model of a file, checked.

    Raises
    ------
    UsageError
        One line that names the file and, where it is at fault, the table and the field.
    """
    document = toml_in_units(read_text(path, "model"), f"model {path}")
    try:
        model = _model(document)
        model.check()
    except UsageError as err:
        raise UsageError(f"model {path}: {cut(str(err))}") from err
    return model


def write_model(path: Path, model: Model) -> None:
    """Write a model file that `read_model` reads back as it was; it appears whole or not at all.

    Raises
    ------
    UsageError
        Where the file cannot be written.
    """
    import tomli_w

    document: dict[str, Any] = {"format": FORMAT, "recording": model.recording}
    document |= with_discovered({part: value for part in _PARTS if (value := getattr(model, part))})
    use = f"benchctl simulate PROCEDURE --model {path.name} -o FILE.h5 plays it"
    if model.parts:  # no simulated bench plays these
        use = f"benchctl diagnose FILE.h5 --part {next(iter(model.parts))} --model {path.name} begins with it"
    text = f"# {use}\n{tomli_w.dumps(_plain(document))}"
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def with_discovered(tables: Mapping[str, Any]) -> dict[str, Any]:
    """Tables of a model file with the structures among the effects, which have no name, in `discovered`."""
    from benchctl_instruments.physics.structures import structure_named

    effects = tables.get("effects", {})
    found = {name: values for name, values in effects.items() if structure_named(name) is not None}
    rest = {name: values for name, values in effects.items() if name not in found}
    return {**tables, "effects": rest, **({_DISCOVERED: found} if found else {})} if found else dict(tables)


def _model(document: dict[str, Any]) -> Model:
    stated = document.pop("format", FORMAT)
    if stated != FORMAT:
        raise UsageError(f'format: expected "{FORMAT}", got {shown(stated)}')
    recording = document.pop("recording", "")
    if not isinstance(recording, str):
        raise UsageError(f"recording: expected text, got {shown(recording)}")
    parts = {part: document.pop(part) for part in (*_PARTS, _DISCOVERED) if part in document}
    for part, table in parts.items():
        if not isinstance(table, dict):
            raise UsageError(f"{part}: expected a table [{part}], got {shown(table)}")
    if _DISCOVERED in parts:
        parts["effects"] = {**parts.get("effects", {}), **parts.pop(_DISCOVERED)}
    if document and "physics" in parts:
        raise UsageError(f"{next(iter(document))}: goes into [physics], which this file has; move it there")
    return Model(recording=recording, **{"physics": document, **parts})


def _plain(value: Any) -> Any:
    """Values that TOML knows: dictionaries, lists, and Python's own numbers in place of numpy's."""
    if isinstance(value, Mapping):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return value.item() if hasattr(value, "item") else value
