"""Foreign recordings whose truth is beside them: the right names, none made up, and their sizes."""

import json

import pytest

from benchctl.app.diagnose import diagnose
from tests.golden.stored import compare
from tests.shared import SHARED, needs_shared

_SMALL = {"bias_temperature": {"c2_v_per_c2"}}
"""Parameters that are drawn so small that the recording does not show them."""


@pytest.mark.slow
@pytest.mark.timeout(900)
@needs_shared("recordings/opened")
@pytest.mark.parametrize("name", ["null", "bias_temperature", "outliers", "saturation_and_cubic"])
def test_an_opened_recording_is_diagnosed_as_its_truth_says(name: str) -> None:
    folder = SHARED / "recordings" / "opened" / name
    truth = json.loads((folder / "truth.json").read_text())["effects"]
    diagnosis = diagnose([folder]).diagnosis
    assert {one.effect for one in diagnosis.findings} == set(truth)
    assert not diagnosis.unexplained.significant
    assert (diagnosis.verdict == "missing-physics") == bool(truth)
    for one in diagnosis.findings:
        for parameter, value in truth[one.effect].items():
            if parameter not in _SMALL.get(one.effect, set()):
                assert one.parameters[parameter].value == pytest.approx(value, rel=0.1), (one.effect, parameter)
    compare(f"diagnose_opened_{name}", diagnosis.as_json(), folder)
