"""What was stated of a campaign, found where the CLI leaves it, and only where it is of this campaign."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchctl.app.accept import accept
from benchctl.app.diagnose import Diagnosed
from benchctl.app.fit import fit
from benchctl.dashboard.data import documents
from benchctl.dashboard.data.documents import KINDS, Kind, document, is_there, report_of
from benchctl.metrology.limit_file import limits_of_text
from benchctl.recordings.importing import import_recording
from benchctl.recordings.model import Step
from benchctl.recordings.reader import open_recording
from benchctl.recordings.writer import write_recording
from benchctl.reports.results import results_folder
from benchctl_instruments.errors import UsageError
from tests.benchctl.diagnosis import example
from tests.benchctl.recordings import made
from tests.benchctl.recordings.open_folder import write_open

LIMITS = '[limits.bias_stability]\nhigh = 3\nunit = "deg/h"\n'


@pytest.fixture(scope="module")
def stated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording with all that the CLI states of one, beside it."""
    folder = tmp_path_factory.mktemp("stated")
    rows = [f"{rate},{0.1 + 0.02 * rate - 1e-8 * rate**3},0.002" for rate in range(-50, 51, 10)]
    (folder / "points.csv").write_text("\n".join(["rate_dps,gyro_v_mean,gyro_v_std", *rows, ""]))
    path = folder / "points.h5"
    import_recording(folder / "points.csv", None, path)
    fit([path], out=folder)
    with open_recording(path) as recording:
        digest, meta, infos = recording.digest, recording.meta, recording.infos
    diagnosed = Diagnosed(diagnosis=example.pair(), meta=meta, infos=infos, digest=digest, unit="V")
    diagnosed.write(results_folder(path))
    at_rest = made.step(1, rows=3000, kind="static", rate_dps=None)
    still = Step(at_rest.info, {**at_rest.channels, "encoder_deg": np.full(3000, 90.0)})
    write_recording(folder / "rest.h5", made.meta(), [still])
    limits = limits_of_text(LIMITS, folder / "limits.toml")
    accepted = accept(folder / "rest.h5", limits)
    accepted.write(results_folder(folder / "rest.h5", "acceptance"))
    return folder


@pytest.fixture
def here(stated: Path, tmp_path: Path) -> Path:
    """A copy of it to spoil."""
    return Path(shutil.copytree(stated, tmp_path / "lab"))


def _recording(folder: Path, kind: Kind) -> Path:
    return folder / ("rest.h5" if kind == "acceptance" else "points.h5")


def test_a_calibration_is_told_in_its_main_numbers(here: Path) -> None:
    found = document(here / "points.h5", "calibration")
    assert found is not None
    assert found["K0_v_per_dps"] == pytest.approx(0.02, rel=0.01)
    assert {"U0_v", "stages", "valid", "convention"} <= set(found)
    assert "covariance" not in json.dumps(found)
    assert "source" not in found  # where files lie is nobody's business
    json.dumps(found, allow_nan=False)


def test_a_diagnosis_is_told_with_its_findings_and_the_map(here: Path) -> None:
    found = document(here / "points.h5", "diagnosis")
    assert found is not None
    assert found["verdict"] == "missing-physics"
    assert [one["effect"] for one in found["findings"]] == [one.effect for one in example.pair().findings]
    first, drawn = found["map"][0], example.pair().slices[0]
    assert first["coordinate"] == drawn.coordinate
    assert first["edges"] == pytest.approx(drawn.edges.tolist(), rel=1e-5)
    assert len(first["before"]) == len(first["after"]) == len(first["standard_error"]) == len(drawn.before)
    assert first["threshold"] == pytest.approx(drawn.threshold)


def test_an_acceptance_is_told_test_by_test(here: Path) -> None:
    found = document(here / "rest.h5", "acceptance")
    assert found is not None
    assert found["verdict"] == "INCONCLUSIVE"
    assert {"bias_stability"} <= {test["name"] for test in found["tests"]}
    assert "recording" not in found
    assert "text" not in found["limits"]


@pytest.mark.parametrize("kind", KINDS)
def test_the_report_is_the_stored_page(here: Path, kind: Kind) -> None:
    found = report_of(_recording(here, kind), kind)
    assert found is not None
    assert found.lstrip().lower().startswith(b"<!doctype html>")


@pytest.mark.parametrize("kind", KINDS)
def test_what_was_stated_of_another_recording_does_not_count(here: Path, kind: Kind) -> None:
    path = _recording(here, kind)
    with open_recording(path) as recording:
        assert is_there(path, kind, recording.digest)
    write_recording(path, made.meta(), made.steps(1))
    assert document(path, kind) is None
    assert report_of(path, kind) is None
    assert not is_there(path, kind, "0" * 64)


@pytest.mark.parametrize("kind", KINDS)
def test_where_nothing_was_stated_there_is_nothing(tmp_path: Path, kind: Kind) -> None:
    path = made.recording(tmp_path)
    assert document(path, kind) is report_of(path, kind) is None
    assert not is_there(path, kind, "")


def test_in_a_campaigns_folder_everything_lies_in_it(tmp_path: Path) -> None:
    folder = tmp_path / "campaign"
    folder.mkdir()
    write_recording(folder / "recording.h5", made.meta(), made.steps(1))
    content: dict[str, Any] = {"schema": "benchctl-coefficients/1", "K0_v_per_dps": float("nan"), "stages": []}
    (folder / "coefficients.json").write_text(json.dumps(content))
    for path in (folder, folder / "recording.h5"):
        assert document(path, "calibration") == {"K0_v_per_dps": None, "stages": []}


def test_what_was_stated_of_an_open_recording_is_known_by_the_digests_of_its_files(tmp_path: Path) -> None:
    folder = write_open(tmp_path / "open")
    content = {"schema": "benchctl-coefficients/1", "U0_v": 1.0, "source": [{"digest": "0" * 64}]}
    (folder / "coefficients.json").write_text(json.dumps(content))
    assert document(folder, "calibration") is None


@pytest.mark.parametrize("text", ["{", "[]", '{"schema": "other"}', "\xff"])
def test_a_document_that_cannot_be_read_is_one_line(tmp_path: Path, text: str) -> None:
    path = made.recording(tmp_path)
    (tmp_path / "coefficients.json").write_text(text, encoding="latin-1")
    with pytest.raises(UsageError) as told:
        document(path, "calibration")
    assert "\n" not in str(told.value)
    assert not is_there(path, "calibration", "")


def test_a_report_that_is_larger_than_any_is_refused(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(documents, "MOST_REPORT_BYTES", 1000)
    with pytest.raises(UsageError, match="larger than"):
        report_of(here / "points.h5", "calibration")
