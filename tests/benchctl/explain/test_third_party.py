"""An effect of another package is explained, listed and drawn with nothing added here."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

MODULE = '''
"""A gyro that hears its neighbour."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.effects.effect import Parameter, PhysicalEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class AcmeCrosstalk(PhysicalEffect):
    """U + v·sin(3·ω/1 °/s)."""

    v: float

    identifier: ClassVar[str] = "acme_crosstalk"
    stage: ClassVar[Stage] = "bias"
    words: ClassVar[str] = "The neighbouring axis is heard: a ripple over the rate, the same at every temperature."
    equation: ClassVar[str] = "U → U + v·sin(3·ω)"
    coordinate: ClassVar[str] = "rate"
    excited_by: ClassVar[str] = "many rates"
    look_alikes: ClassVar[tuple[str, ...]] = ("adc_nonlinearity",)
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "v": Parameter(unit="V", meaning="peak of the ripple", low=-1.0, high=1.0, role="size", scan=(1e-6,), zero=0.0)
    }

    def apply(self, signals: Signals) -> Signals:
        """The output with the ripple."""
        ripple = self.v * np.sin(np.radians(3.0 * signals.rate_dps))
        return replace(signals, output_v=signals.output_v + ripple)

    def says(self) -> str:
        """The finding."""
        return f"A ripple of {self.v:.3g} V over the rate."
'''


@pytest.fixture
def installed(tmp_path: Path) -> dict[str, str]:
    """The environment of a process that has the package."""
    site = tmp_path / "site"
    (site / "acme-1.0.dist-info").mkdir(parents=True)
    (site / "acme_effects.py").write_text(MODULE, encoding="utf-8")
    (site / "acme-1.0.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: acme\nVersion: 1.0\n")
    points = "[benchctl.effects]\nacme_crosstalk = acme_effects:AcmeCrosstalk\n"
    (site / "acme-1.0.dist-info" / "entry_points.txt").write_text(points)
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(site), os.environ.get("PYTHONPATH", "")])}


def test_it_is_explained_and_listed(installed: dict[str, str], tmp_path: Path) -> None:
    told = tmp_path / "told.json"
    asked = ["explain", "Acme Crosstalk", "--json", str(told)]
    code = f"from benchctl.cli.app import run_verb; run_verb({asked!r}); run_verb(['explain'])"
    ran = subprocess.run([sys.executable, "-c", code], env=installed, capture_output=True, text=True)
    assert (ran.returncode, ran.stderr) == (0, "")
    assert "peak of the ripple" in ran.stdout
    assert "\n  acme_crosstalk " in ran.stdout
    values = json.loads(told.read_text(encoding="utf-8"))
    assert values["equation"] == "U → U + v·sin(3·ω)"
    assert values["parameters"][0]["usual"] is None
    assert {"label": "Shown by", "says": "benchctl run rate_sweep; benchctl run diagnostic"} in values["facts"]
