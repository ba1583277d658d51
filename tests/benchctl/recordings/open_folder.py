"""A small open recording on disk, to be spoilt by tests."""

from __future__ import annotations

import gzip
import json
from pathlib import Path
from typing import Any

RATE_HZ = 10.0
HEADER = "time_s,encoder_deg,gyro_v,gyro_temp_c,chamber_temp_c"


def description(**changes: Any) -> dict[str, Any]:
    """What `recording.json` says: two steps over 4 s, rows of the last second belong to none."""
    return {
        "format": "open-recording/1",
        "unit": {"serial": "DUT-1", "range_dps": 150.0},
        "bench": {
            "sample_rate_hz": RATE_HZ,
            "encoder_counts_per_rev": 65536,
            "adc_bits": 16,
            "adc_range_v": 5.0,
            "latitude_deg": 58.5,
        },
        "simulation": {
            "K0_v_per_dps": 0.016,
            "U0_v": 0.012,
            "T0_c": 23.0,
            "k_T": [1e-4],
            "k_omega": [3.02e-06, 5.89e-11],
            "noise_v_rms": 0.0005,
            "output_limit_v": 4.0,
        },
        "steps": [
            {"name": "rest", "kind": "static", "t_start": 0.0, "t_end": 1.0, "chamber_setpoint_c": 23.0},
            {
                "name": "turn",
                "kind": "constant_rate",
                "t_start": 1.0,
                "t_end": 3.0,
                "chamber_setpoint_c": 23.0,
                "rate_dps": 20.0,
            },
        ],
    } | changes


def rows(count: int = 40) -> list[str]:
    """Rows of samples, as text."""
    return [f"{k / RATE_HZ:.6f},{(2.0 * k) % 360:.7f},{0.001 * k:.6f},23.{k % 10:03d},23.00" for k in range(count)]


def write_open(folder: Path, *, header: str = HEADER, body: list[str] | None = None, **changes: Any) -> Path:
    """Write the folder; `changes` replace keys of `recording.json`."""
    folder.mkdir(exist_ok=True)
    (folder / "recording.json").write_text(json.dumps(description(**changes)))
    text = "\n".join([header, *(rows() if body is None else body)]) + "\n"
    (folder / "samples.csv.gz").write_bytes(gzip.compress(text.encode(), mtime=0))
    return folder
