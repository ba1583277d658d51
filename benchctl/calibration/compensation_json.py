"""`benchctl export --to json`: the compensation for programs that read JSON, without the details of the fit.

| key | what |
|---|---|
| `schema` | `benchctl-compensation/1` |
| `law`, `formula` | `sine`, `polynomial` or `response`, and how a rate comes of it, in words |
| `K0_v_per_dps`, `U0_v`, `T0_c` | scale factor, output at rest, reference of ΔT (null: no temperature plays a part) |
| `U0_T` | coefficients of ΔT, ΔT², … of the bias, V/°C^i |
| `S_rad_per_dps` | of the sine, else null |
| `stages` | list: `k_T` (of ΔT, ΔT², …) and `k_omega` (of ω², ω⁴, …), as the formula uses them |
| `delay_s` | a rate belongs to its output's time less this |
| `earth_rate_dps` | the part of the sensed rate that is the Earth's, where the calibration's latitude was known |
| `valid` | ranges `rate_dps` and `temperature_c` that were measured; null: not written down |
| `uncertainty` | `k`; `expanded` by parameter: `c1` of `U0_T[0]`, `g1` or `a1` of `k_T[0]`, `b2` of `k_omega[0]` |
| `error_percent` | largest residual over largest rate, on runs that were not fitted, or null |
| `unit`, `output_unit` | serial; the output's unit where it is not V, as the names say, but a rate |
| `source`, `coefficients_sha256` | digests of the recordings that were fitted, and of the file |
| `self_test` | `columns`, `points` and `tolerance_dps`: a program that misses a point by more is wrong |
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from benchctl.atomic import whole_file
from benchctl.calibration.compensating import Compensation, self_test_points, tolerance_dps

SCHEMA = "benchctl-compensation/1"

_INDICATED = "x = (U - U0_v - sum of U0_T[i] * dT**(i + 1)) / K0_v_per_dps with dT = T - T0_c"
_FACTORS = "k_T = 1 + sum of stage.k_T[i] * dT**(i + 1)"
_BENT = "k_omega(w) = 1 + sum of stage.k_omega[i] * w**(2 * i + 2)"
FORMULAS = {
    "sine": f"{_INDICATED}; {_FACTORS}; rate = asin(S_rad_per_dps * x / k_T) / S_rad_per_dps",
    "polynomial": f"{_INDICATED}; rate = x; for each stage in turn: {_FACTORS}, {_BENT}, rate = rate * k_T * "
    "k_omega(rate)",
    "response": f"{_INDICATED}; {_FACTORS}; {_BENT}; rate is the solution nearest to 0 of rate * k_omega(rate) = "
    "x / k_T",
}
"""Law -> how a rate comes of an output U at a temperature T [degC]."""


def compensation_json(compensation: Compensation) -> dict[str, Any]:
    """The content; `UsageError` where the law has no output for a rate in `valid`."""
    law = compensation.law
    points = self_test_points(compensation)
    return {
        "schema": SCHEMA,
        "unit": compensation.unit,
        "output_unit": compensation.output_unit,
        "law": law.name,
        "formula": FORMULAS[law.name],
        "rate_is": "sensed, in deg/s: that of the case and the part of the Earth's along the axis",
        "K0_v_per_dps": law.K0_v_per_dps,
        "U0_v": law.U0_v,
        "T0_c": law.T0_c if law.knows_temperature else None,
        "U0_T": list(law.bias),
        "S_rad_per_dps": law.S_rad_per_dps if law.name == "sine" else None,
        "stages": [{"k_T": list(stage.k_t), "k_omega": list(stage.k_omega)} for stage in law.stages],
        "delay_s": law.delay_s,
        "earth_rate_dps": compensation.earth_rate_dps,
        "valid": {
            "rate_dps": list(compensation.valid.rate_dps),
            "temperature_c": [end if math.isfinite(end) else None for end in compensation.valid.temperature_c],
        },
        "uncertainty": {"k": compensation.k, "expanded": dict(compensation.expanded)},
        "error_percent": compensation.error_percent,
        "source": [{"recording": name, "digest": digest} for name, digest in compensation.sources],
        "coefficients_sha256": compensation.sha256,
        "self_test": {
            "columns": ["volts", "celsius", "rate_dps"],
            "points": [[point.volts, point.celsius, point.rate_dps] for point in points],
            "tolerance_dps": tolerance_dps(compensation),
        },
    }


def export_json(compensation: Compensation, path: Path) -> None:
    """Write the file atomically; `UsageError` where the law or the disk refuses."""
    text = json.dumps(compensation_json(compensation), indent=1, ensure_ascii=False, allow_nan=False)
    with whole_file(path) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8", newline="\n")
