"""The file of an effect that a structure becomes keeps the contract of effects, and does what was found."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import pytest

from benchctl.diagnosis.result import Estimate, StructureModel
from benchctl.diagnosis.structures.effect_file import effect_source
from benchctl_instruments.physics.effect_contract import check_effect
from benchctl_instruments.physics.structure_shapes import SHAPES
from benchctl_instruments.physics.structures import structure_named

PLACES = {
    "at": 27.7,
    "at_2": 40.0,
    "width": 2.0,
    "length": 8.0,
    "period": 30.0,
    "tau": 400.0,
    "low": 5.0,
    "high": 55.0,
    "exponent": 0.5,
}


def loaded(source: str, name: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    (folder / f"{name}.py").write_text(source, encoding="utf-8")
    monkeypatch.syspath_prepend(str(folder))
    return importlib.import_module(name).ModeHop


@pytest.mark.parametrize(
    "shape",
    [
        # of twelve values there are thousands of combinations of bounds; that of six is made by the same function
        pytest.param(shape, marks=pytest.mark.slow if shape == "spline12" else ())
        for shape in SHAPES
        if shape != "exponential"
    ],
)
def test_it_keeps_the_contract_of_effects(shape: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    over = "gyro_temp_rate" if shape in ("negative", "positive", "either") else "gyro_temp"
    identifier = f"{shape}_of_scale_over_{over}"
    kind = structure_named(identifier)
    assert kind is not None
    values = {name: PLACES.get(name, 2e-5) for name in kind.parameters}
    found = StructureModel(
        identifier=identifier,
        stage="scale",
        coordinates=(over,),
        shape=shape,
        formula="",
        parameters={name: Estimate(value=one, low=one, high=one, unit="1") for name, one in values.items()},
        explains=1.0,
        says=kind.make(values).says(),
    )
    made = loaded(effect_source("mode_hop", found), f"of_a_{shape}", tmp_path, monkeypatch)
    check_effect(made)
    assert made(**values).says() == kind.make(values).says()
