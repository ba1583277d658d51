"""Recordings from other benches through the command line; the figures are those that others found in the same data."""

import gzip
import json
from pathlib import Path

import pytest

from tests.benchctl.cli.processes import benchctl, without_a_process
from tests.shared import SHARED, needs_shared

EXAMPLES = SHARED / "recordings" / "examples"
MAPS = Path(__file__).resolve().parents[1] / "recordings" / "maps"


@pytest.mark.slow
@needs_shared("recordings/examples")
@pytest.mark.timeout(300)
@pytest.mark.parametrize("name", ["single", "null", "pair"])
def test_an_open_recording_imports_fits_and_exports_with_every_digit(name: str, tmp_path: Path) -> None:
    imported = benchctl("import", EXAMPLES / name, "-o", tmp_path / "r.h5")
    assert imported.returncode == 0, imported.stderr
    fitted = benchctl("fit", tmp_path / "r.h5", "--json", tmp_path / "fit.json")
    assert fitted.returncode == 0, fitted.stderr
    errors = json.loads((tmp_path / "fit.json").read_text())["error_percent"]
    assert errors["joint"] < errors["raw"] / 10
    exported = benchctl("export", tmp_path / "r.h5", "--to", "open", "-o", tmp_path / "back")
    assert exported.returncode == 0, exported.stderr
    theirs = gzip.decompress((EXAMPLES / name / "samples.csv.gz").read_bytes())
    assert gzip.decompress((tmp_path / "back" / "samples.csv.gz").read_bytes()) == theirs
    assert json.loads((tmp_path / "back" / "recording.json").read_text()) == json.loads(
        (EXAMPLES / name / "recording.json").read_text()
    )


@needs_shared("data/vg910")
@pytest.mark.slow
def test_the_points_of_a_real_vg910_follow_the_sine_law(tmp_path: Path) -> None:
    source = SHARED / "data" / "vg910" / "unit1_static_points.csv"
    assert benchctl("import", source, "-o", tmp_path / "points.h5").returncode == 0
    fitted = benchctl("fit", tmp_path / "points.h5", "--json", tmp_path / "fit.json")
    assert fitted.returncode == 0, fitted.stderr
    result = json.loads((tmp_path / "fit.json").read_text())
    misfit = result["misfit_percent_of_full_scale"]
    assert 3.5 < misfit["line_largest"] < 6.0
    assert misfit["sine_largest"] < 0.5
    assert misfit["sine"] < misfit["line"] / 10
    low, high = result["S_rad_per_dps"]["ci95"]
    assert low < 0.0043 < high
    assert result["points_at_rest"]["offset_dps"] == pytest.approx(0.5, abs=0.15)


@needs_shared("data/uiuc_encoder_imu")
@pytest.mark.slow
def test_scale_factor_and_delay_of_a_real_gyro_are_found_together_against_its_encoder(tmp_path: Path) -> None:
    source = SHARED / "data" / "uiuc_encoder_imu" / "raw_yaw_slow.mat"
    imported = benchctl("import", source, "--map", MAPS / "uiuc.toml", "-o", tmp_path / "uiuc.h5")
    assert imported.returncode == 0, imported.stderr
    assert "26 samples are missing in 26 gaps" in imported.stdout
    fitted = benchctl("fit", tmp_path / "uiuc.h5", "--json", tmp_path / "fit.json")
    assert fitted.returncode == 0, fitted.stderr
    motion = json.loads((tmp_path / "fit.json").read_text())["free_motion"]
    assert motion["scale_v_per_dps"]["value"] == pytest.approx(1.0060, abs=2e-4)
    assert motion["delay_s"]["value"] == pytest.approx(12.0e-3, abs=0.3e-3)
    assert motion["angle_residual_deg"]["after"] == pytest.approx(0.14, abs=0.015)
    assert motion["angle_residual_deg"]["before"] > 0.5


def test_a_table_with_a_fault_names_file_row_and_column_and_leaves_nothing(tmp_path: Path) -> None:
    folder = tmp_path / "open"
    folder.mkdir()
    (folder / "recording.json").write_text(json.dumps(_DESCRIPTION))
    rows = [f"{i / 10:.1f},10.0,0.01,{'nan' if i == 5 else '20.0'},20.0" for i in range(20)]
    header = "time_s,encoder_deg,gyro_v,gyro_temp_c,chamber_temp_c"
    (folder / "samples.csv").write_text("\n".join([header, *rows]) + "\n")
    ran = without_a_process("import", folder, "-o", tmp_path / "out.h5")
    assert ran.returncode == 2
    assert len(ran.stderr.splitlines()) == 1
    assert "samples.csv" in ran.stderr
    assert "7" in ran.stderr
    assert "gyro_temp_c" in ran.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["open"]


_DESCRIPTION = {
    "format": "open-recording/1",
    "unit": {"serial": "x", "range_dps": 100.0},
    "bench": {
        "sample_rate_hz": 10.0,
        "encoder_counts_per_rev": 1000,
        "adc_bits": 16,
        "adc_range_v": 10.0,
        "latitude_deg": 50.0,
    },
    "simulation": {
        "K0_v_per_dps": 0.02,
        "U0_v": 0.0,
        "T0_c": 20.0,
        "k_T": [],
        "k_omega": [],
        "noise_v_rms": 0.001,
        "output_limit_v": 5.0,
    },
    "steps": [{"name": "rest", "kind": "static", "t_start": 0.0, "t_end": 2.0, "chamber_setpoint_c": 20.0}],
}
