"""A small campaign of the paper through the command line, over the simulated bench's wires."""

import json
from pathlib import Path
from typing import Any

import h5py
import pytest
import xarray as xr

from benchctl.calibration.coefficients import read_coefficients
from tests.benchctl.cli.processes import benchctl, without_a_process

SMALL = ("-p", "points=4", "-p", "sweep_rates=6", "-p", "rates=2", "-p", "run_s=6", "-p", "zero_s=10")


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any], str]:
    """Its folder, its JSON, and what it said."""
    folder = tmp_path_factory.mktemp("run")
    ran = benchctl(
        "run", "two_stage", "--bench", "simulated", *SMALL, "--seed", "5",
        "--out", folder / "campaign", "--json", folder / "run.json",
    )  # fmt: skip
    assert ran.returncode == 0, ran.stderr
    assert ran.stderr == ""
    return folder / "campaign", json.loads((folder / "run.json").read_text()), ran.stdout


def test_the_result_has_the_keys_that_scripts_rely_on(campaign: tuple[Path, dict[str, Any], str]) -> None:
    folder, result, said = campaign
    assert result["schema"] == "benchctl-run/1"
    assert result["ok"] is True
    assert result["campaign"] == str(folder)
    assert result["recording"] == str(folder / "recording.h5")
    assert result["status"] == "complete"
    assert result["steps"]["planned"] == result["steps"]["whole"] > 40
    assert result["samples"] > 100_000
    assert result["bench_time_s"] > 5 * 3600
    assert result["wall_time_s"] < 60
    assert result["coefficients"] == str(folder / "coefficients.json")
    assert {"raw", "stage_1", "stage_2", "joint"} <= set(result["error_percent"])
    assert "complete:" in said


def test_the_error_falls_as_the_paper_has_it_and_further(campaign: tuple[Path, dict[str, Any], str]) -> None:
    errors = campaign[1]["error_percent"]
    assert 8.0 <= errors["raw"] <= 10.0
    assert errors["stage_2"] <= 0.7
    assert errors["joint"] <= 0.1


def test_the_coefficients_keep_to_the_letter_of_their_format(campaign: tuple[Path, dict[str, Any], str]) -> None:
    content = read_coefficients(campaign[0] / "coefficients.json")
    assert content["schema"] == "benchctl-coefficients/1"
    assert content["convention"] in ("correction", "response")
    assert content["argument"] in ("indicated", "true")
    for key in ("K0_v_per_dps", "U0_v", "T0_c"):
        assert isinstance(content[key], float)
    for stage in content["stages"]:
        for part in ("k_T", "k_omega"):
            count = len(stage[part]["coefficients"])
            assert [len(row) for row in stage[part]["covariance"]] == [count] * count
        assert {"K0_v_per_dps", "U0_v", "delay_s"} <= set(stage)
        assert set(stage["error_percent"]) == {"before", "after"}
    assert {"rate_dps", "temperature_c"} <= set(content["valid"])
    assert content["uncertainty"]["k"] == 2
    assert [len(source["digest"]) for source in content["source"]] == [64]


def test_the_simulated_truth_lies_near_the_stated_intervals(campaign: tuple[Path, dict[str, Any], str]) -> None:
    parameters = read_coefficients(campaign[0] / "coefficients.json")["uncertainty"]["parameters"]
    for name, truth in {"K0_v_per_dps": 0.05, "S_rad_per_dps": 0.0045, "g1": -1.315e-4, "g2": 2.066e-6}.items():
        low, high = parameters[name]["ci95"]
        assert abs(parameters[name]["value"] - truth) < 2 * (high - low), name


def test_the_recording_opens_without_this_package(campaign: tuple[Path, dict[str, Any], str]) -> None:
    path = campaign[0] / "recording.h5"
    with xr.open_dataset(path, group="steps/0002", engine="h5netcdf") as step:
        assert step["gyro_v"].attrs["units"] == "V"
        assert step["gyro_v"].dims == ("time_s",)
    with h5py.File(path) as file:
        assert file.attrs["status"] == "complete"
        assert "two_stage" in file.attrs["provenance_procedure_source"]
        assert "simulated = true" in file.attrs["provenance_bench_toml"]


def test_show_and_verify_find_it_whole(campaign: tuple[Path, dict[str, Any], str], tmp_path: Path) -> None:
    assert benchctl("verify", campaign[0]).returncode == 0
    shown = without_a_process("show", campaign[0], "--json", "-")
    document = json.loads(shown.stdout)
    assert document["schema"] == "benchctl-show/1"
    assert document["digest_ok"] is True
    assert {"status", "steps", "channels", "provenance"} <= set(document)
    assert {"name", "kind", "whole", "samples", "t_start", "t_end"} <= set(document["steps"][0])
    assert {"name", "unit", "rate_hz"} <= set(document["channels"][0])


def test_a_changed_sample_is_found_and_named_with_exit_status_one(
    campaign: tuple[Path, dict[str, Any], str], tmp_path: Path
) -> None:
    copy = tmp_path / "copy.h5"
    copy.write_bytes((campaign[0] / "recording.h5").read_bytes())
    with h5py.File(copy, "r+") as file:
        file["steps/0003/gyro_v"][7] += 1e-9
    verified = without_a_process("verify", copy, "--json", tmp_path / "v.json")
    assert verified.returncode == 1
    assert "gyro_v" in verified.stderr
    assert json.loads((tmp_path / "v.json").read_text())["ok"] is False


def test_a_changed_recording_is_not_fitted(campaign: tuple[Path, dict[str, Any], str], tmp_path: Path) -> None:
    copy = tmp_path / "copy.h5"
    copy.write_bytes((campaign[0] / "recording.h5").read_bytes())
    with h5py.File(copy, "r+") as file:
        file.attrs["unit_serial"] = "another"
    fitted = without_a_process("fit", copy)
    assert fitted.returncode == 2
    assert "changed since it was written, and so not fitted" in fitted.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["copy.h5"]


@pytest.mark.slow
def test_a_fit_of_the_finished_recording_gives_the_same_coefficients_again(
    campaign: tuple[Path, dict[str, Any], str], tmp_path: Path
) -> None:
    fitted = benchctl("fit", campaign[0], "--out", tmp_path, "--json", tmp_path / "fit.json")
    assert fitted.returncode == 0, fitted.stderr
    document = json.loads((tmp_path / "fit.json").read_text())
    assert {"coefficients", "error_percent", "K0_v_per_dps", "U0_v"} <= set(document)
    first = read_coefficients(campaign[0] / "coefficients.json")
    again = read_coefficients(tmp_path / "coefficients.json")
    assert again["stages"] == first["stages"]
    assert (tmp_path / "report.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


@pytest.mark.slow
def test_two_recordings_of_one_unit_are_fitted_together(
    campaign: tuple[Path, dict[str, Any], str], tmp_path: Path
) -> None:
    fitted = benchctl("fit", campaign[0], campaign[0] / "recording.h5", "--out", tmp_path)
    assert fitted.returncode == 0, fitted.stderr
    both = read_coefficients(tmp_path / "coefficients.json")
    assert len(both["source"]) == 2
    assert both["K0_v_per_dps"] == pytest.approx(0.05, rel=0.01)
