"""Model files: the physics of a simulated bench, written by a diagnosis or manually; see `benchctl simulate --model`.

    format = "benchctl-model/1"
    recording = "..."              # the source of the model
    [simulation]                   # a lab's model of the gyro, as in open recordings
    [effects.thermal_lag]          # an additional effect, by its name in the vocabulary, with its parameters
    tau_s = 312.0
    [discovered.kink_of_scale_over_gyro_temp]   # an unnamed structure, by stage, coordinate and shape
    at = 27.7
    above = -4.8e-4
    [physics.table]                # the parts of the bench, as in bench.toml
    [parts.drive]                  # a lab's model of its table's drive, or of its chamber, as diagnosed (`part_models`)

All parts are optional. A file with the tables of `[physics]` at its top level (`[gyro]`, `[table]`, …) is a model
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

    `simulation` is the gyro's response; if None, the gyro of `physics` is used. `effects` are parameters by effect.
    `parts` are models of the drive and the chamber, which simulated benches do not use. `recording` names the source of
    the model.
    """

    simulation: Mapping[str, Any] | None = None
    physics: Mapping[str, Any] = field(default_factory=dict)
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    parts: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    recording: str = ""

    @property
    def bench_physics(self) -> dict[str, Any]:
        """The `[physics]` of a simulated bench with this model."""
        return {**self.physics, **({} if self.simulation is None else {"response": self.simulation})}

    def check(self) -> None:
        """Raise a `UsageError` that names the table and the field if one is invalid."""
        from benchctl_instruments.physics.effects.making import make_effects
        from benchctl_instruments.physics.response_gyro import ResponseParameters
        from benchctl_instruments.simulated.settings import WorldSettings, built

        WorldSettings.from_mapping(self.physics, where="physics")
        if self.simulation is not None:
            built(ResponseParameters, self.simulation, "simulation")
        make_effects(self.effects)
        check_parts(self.parts)


def read_model(path: Path) -> Model:
    """Read and check a model file.

    Raises
    ------
    UsageError
        One line that names the file and, if applicable, the invalid table and field.
    """
    document = toml_in_units(read_text(path, "model"), f"model {path}")
    try:
        model = _model(document)
        model.check()
    except UsageError as err:
        raise UsageError(f"model {path}: {cut(str(err))}") from err
    return model


def write_model(path: Path, model: Model) -> None:
    """Write a model file atomically; `read_model` returns an equal model.

    Raises
    ------
    UsageError
        If the file cannot be written.
    """
    import tomli_w

    document: dict[str, Any] = {"format": FORMAT, "recording": model.recording}
    document |= with_discovered({part: value for part in _PARTS if (value := getattr(model, part))})
    use = f"benchctl simulate PROCEDURE --model {path.name} -o FILE.h5 plays it"
    if model.parts:  # simulated benches do not use these
        use = f"benchctl diagnose FILE.h5 --part {next(iter(model.parts))} --model {path.name} begins with it"
    text = f"# {use}\n{tomli_w.dumps(_plain(document))}"
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def with_discovered(tables: Mapping[str, Any]) -> dict[str, Any]:
    """Return the tables of a model file with the unnamed structures moved from `effects` to `discovered`."""
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
    """Convert to types supported by TOML: dictionaries, lists, and Python numbers instead of numpy numbers."""
    if isinstance(value, Mapping):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return value.item() if hasattr(value, "item") else value
