"""Coefficients by hand and by hypothesis, and a C compiler's verdict on their headers."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import assume
from hypothesis import strategies as st

from benchctl.calibration.c_header import export_c_header
from benchctl.calibration.compensating import Compensation, read_compensation

FloatArray = npt.NDArray[np.float64]

RATE_DPS, TEMPERATURE_C, T0_C = 150.0, (-40.0, 60.0), 20.0
"""Where the hand-made coefficients are valid: to both sides of 0, and of T0."""

_STRICT = ("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Wdouble-promotion", "-Werror", "-O2")
_PROGRAM = r"""
#include "gyro_compensation.h"
#include <stdio.h>
int main(void)
{
    const char *serial;
    double volts, celsius;
    printf("%d ", gyro_self_test());
    for (serial = GYRO_UNIT_SERIAL; *serial != '\0'; ++serial) {
        printf("%02x", (unsigned)(unsigned char)*serial);
    }
    printf("\n");
    while (scanf("%lf %lf", &volts, &celsius) == 2) {
        const double rate_dps = gyro_rate_dps(volts, celsius);
        printf("%.17g %d\n", rate_dps, gyro_rate_valid(rate_dps, celsius));
    }
    return 0;
}
"""


def made(**changes: Any) -> dict[str, Any]:
    """The content of a file of coefficients as `benchctl fit` writes it: two stages, and a joint fit by the sine."""
    joint = {
        "K0_v_per_dps": 0.05,
        "S_rad_per_dps": 0.0045,
        "g1": -1.3e-4,
        "g2": 2e-6,
        "U0_v": 0.012,
        "c1": 2e-5,
        "c2": -1.5e-7,
        "delay_s": 1.125e-3,
        "encoder_cos1_arcsec": 3.0,
    }
    return {
        "schema": "benchctl-coefficients/1",
        "unit": "VG-7",
        "output_unit": "V",
        "convention": "correction",
        "argument": "indicated",
        "K0_v_per_dps": 0.0498,
        "U0_v": 0.012,
        "T0_c": T0_C,
        "stages": [stage([1.3e-4, -2e-6], [3.02e-6, 5.89e-11], [2e-5]), stage([3e-6], [1.8e-8], [2e-5], 1e-3)],
        "joint": joint_of("sine", joint),
        "valid": {"rate_dps": [-RATE_DPS, RATE_DPS], "temperature_c": list(TEMPERATURE_C)},
        "uncertainty": {
            "k": 2,
            "of": "joint fit, law sine",
            "parameters": {name: {"value": value, "expanded": 1e-3 * abs(value)} for name, value in joint.items()},
        },
        "source": [{"recording": "a.h5", "digest": "ab" * 32}],
        "error_percent": {"stage_2": 0.7, "joint": 0.01},
        "earth_rate_dps": 0.0035,
        **changes,
    }


def stage(
    k_t: Sequence[float], k_omega: Sequence[float], u0_t: Sequence[float] = (), delay_s: float = 0.0
) -> dict[str, Any]:
    return {
        "k_T": {"coefficients": list(k_t)},
        "k_omega": {"coefficients": list(k_omega)},
        "U0_T": list(u0_t),
        "delay_s": delay_s,
    }


def joint_of(law: str, values: dict[str, float]) -> dict[str, Any]:
    return {"law": law, "parameters": {name: {"value": value} for name, value in values.items()}}


def written(folder: Path, **changes: Any) -> Path:
    path = folder / "coefficients.json"
    path.write_text(json.dumps(made(**changes)), encoding="utf-8")
    return path


def _terms(reach: float, power: int, largest: float) -> st.SearchStrategy[list[float]]:
    """0 to 4 coefficients that together change a factor by less than `largest` as far as `reach`."""
    share = st.floats(-largest / 4, largest / 4, allow_subnormal=False)
    return st.lists(share, max_size=4).map(
        lambda shares: [part / reach ** (power * (i + 1)) for i, part in enumerate(shares)]
    )


def _reaches(bent: Sequence[float], *warm: Sequence[float]) -> bool:
    """Whether a correction reaches every valid rate at every valid temperature, and not just before it turns back."""
    dt, x = np.linspace(TEMPERATURE_C[0] - T0_C, TEMPERATURE_C[1] - T0_C, 101), np.linspace(0.0, 2 * RATE_DPS, 601)
    k_t = np.prod([np.min(1.0 + sum(a * dt ** (i + 1) for i, a in enumerate(one))) for one in warm])
    k_omega = 1.0 + sum(b * x ** (2 * i + 2) for i, b in enumerate(bent))
    beyond = np.append(k_t * x * k_omega > RATE_DPS, False)
    first = int(np.argmax(beyond))
    return bool(beyond[first]) and int(np.argmin(beyond[first:])) > 0.15 * first


@st.composite
def contents(draw: st.DrawFn) -> dict[str, Any]:
    """Coefficients of every law, with polynomials of order 0 to 4, either sign of the scale factor."""
    warm, bias = draw(_terms(60.0, 1, 0.1)), [1e-2 * c for c in draw(_terms(60.0, 1, 0.5))]
    bent = draw(_terms(RATE_DPS, 2, 0.15))
    size = draw(st.floats(1e-3, 1.0)) * draw(st.sampled_from([1.0, -1.0]))
    values = {"K0_v_per_dps": size, "U0_v": draw(st.floats(-1.0, 1.0)), "delay_s": draw(st.floats(0.0, 0.01))}
    values |= {f"c{i + 1}": c for i, c in enumerate(bias)}
    law = draw(st.sampled_from(["sine", "polynomial", "response", "stages", "response stage"]))
    if law == "sine":
        values |= {"S_rad_per_dps": draw(st.floats(1e-4, 0.008))} | {f"g{i + 1}": g for i, g in enumerate(warm)}
        return made(joint=joint_of(law, values))
    again = draw(_terms(60.0, 1, 0.1)) if law == "stages" else []
    assume(law not in ("polynomial", "stages") or _reaches(bent, warm, again))
    if law in ("polynomial", "response"):
        values |= {f"a{i + 1}": a for i, a in enumerate(warm)} | {f"b{2 * i + 2}": b for i, b in enumerate(bent)}
        return made(joint=joint_of(law, values))
    common = {"joint": None, "K0_v_per_dps": size, "U0_v": values["U0_v"]}
    if law == "stages":
        return made(**common, stages=[stage(warm, bent, bias), stage(again, [], bias)])
    return made(**common, convention="response", argument="true", stages=[stage(warm, bent, bias)])


def compiler(name: str) -> str:
    """The path of a compiler; the test is skipped where there is none."""
    found = shutil.which(name)
    if found is None:
        pytest.skip(f"there is no {name} on this machine, and so nothing to compile the header with")
    return found


def compiled(path: Path, folder: Path, language: str = "c") -> tuple[Compensation, Path]:
    """Export a file of coefficients as a header and compile a program that uses it, with every warning an error."""
    compensation = read_compensation(path)
    export_c_header(compensation, folder / "gyro_compensation.h")
    return compensation, program_with(folder, language)


def program_with(folder: Path, language: str = "c", text: str = _PROGRAM) -> Path:
    """Compile a program with the header in a folder."""
    source, program = folder / "main.c", folder / "main"
    source.write_text(text)
    how = [compiler("cc"), "-std=c99"] if language == "c" else [compiler("g++"), "-std=c++11", "-x", "c++"]
    ran = subprocess.run(
        [*how, *_STRICT, str(source), "-o", str(program), "-lm"], capture_output=True, text=True, timeout=30
    )
    assert ran.returncode == 0, ran.stderr
    return program


@dataclass(frozen=True, slots=True)
class Answer:
    """What the program says: points that its self-test missed, the unit, rates and whether each is valid."""

    missed: int
    unit: str
    rate_dps: FloatArray
    valid: npt.NDArray[np.bool_]


def asked(program: Path, volts: FloatArray, celsius: FloatArray) -> Answer:
    """Run the program on outputs and temperatures, both of shape (n,)."""
    lines = "".join(f"{u:.17g} {c:.17g}\n" for u, c in zip(volts, celsius, strict=True))
    ran = subprocess.run([program], input=lines.encode(), capture_output=True, timeout=30, check=True)
    first, *rows = ran.stdout.decode("ascii").splitlines()
    missed, _, serial = first.partition(" ")
    found = np.array([[float(word) for word in row.split()] for row in rows]).reshape(-1, 2)
    return Answer(int(missed), bytes.fromhex(serial).decode("utf-8"), found[:, 0], found[:, 1] == 1.0)
