"""The output that a model predicts for the gyro of a recording."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from benchctl.diagnosis.gyro.frame import Frame
from benchctl.diagnosis.gyro.problem import gyro_problem
from benchctl.recordings.reader import Recording
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.effects.kinds import NoiseEffect
from benchctl_instruments.physics.effects.making import make_effects


def predict(recording: Recording, model: Mapping[str, Any]) -> tuple[Frame, FloatArray]:
    """Return the recording's samples and the output [V] that a model predicts for each, shape (n,).

    `model` has the layout of a model file: `simulation`, the lab's model, and `effects`. Random parts of effects, noise
    and faults of the data, are left out.

    Raises `UsageError` if the model has no `simulation`, or the recording no usable scans.
    """
    if not model.get("simulation"):
        raise UsageError("this model has no [simulation], which defines the output of the gyro; add the table")
    simulation = {"k_T": (), "k_omega": (), **model["simulation"]}
    problem = gyro_problem(recording, model=simulation, whole_steps=True)
    effects = make_effects(model.get("effects", {}), problem.circumstances)
    volts = problem.predict(problem.baseline_start, [one for one in effects if not isinstance(one, NoiseEffect)])
    return problem.frame, volts.copy()  # a copy, which the caller may modify; nothing else keeps it
