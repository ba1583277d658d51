"""What the process that knows leaves behind."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchctl.plan import Plan
from benchctl.plan.find import find_procedure
from benchctl.proof import seal
from benchctl.proof.draw import draw
from benchctl.proof.unit import TrialUnit
from benchctl.recordings.reader import open_recording

SHORT = {"set_points_c": "23", "run_s": "1", "sine_s": "1", "zero_s": "4", "frequencies_hz": "4"}


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """A procedure of seconds in place of an hour's."""

    def plan(unit: TrialUnit) -> Plan:
        return find_procedure("diagnostic").expand({**unit.parameters, **SHORT})

    monkeypatch.setattr("benchctl.proof.seal.plan_of", plan)


@pytest.mark.usefixtures("short")
def test_the_digest_is_told_first_and_the_recording_says_nothing_of_the_truth(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ["--seed", "1", "--index", "6", "--class", "triple", "--out", str(tmp_path / "c")]
    assert seal.main(asked) == 0
    first, last = (json.loads(line) for line in capsys.readouterr().out.splitlines())
    truth = draw(1, 6, "triple")
    assert first == {"digest": truth.digest()}
    assert last["without"] == []
    with open_recording(Path(last["recording"])) as recording:
        assert recording.meta.provenance["instruments_reached"] == "simulated, over their wires"
        assert sum(info.samples for info in recording.infos) == last["rows"] > 1000
        assert recording.meta.simulation == truth.unit.belief.model_dump(mode="json")
        told = json.dumps([dict(recording.meta.provenance), recording.meta.simulation, recording.meta.extra])
    numbers = [value for values in truth.effects.values() for value in values.values() if value != round(value)]
    assert numbers
    for secret in (*truth.effects, *map(str, numbers), str(truth.seed), truth.nonce, "arw_deg_per_sqrt_h"):
        assert secret not in told


@pytest.mark.usefixtures("short")
def test_the_concealed_effect_is_in_the_volts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("benchctl.proof.draw.DRAWN", ("saturation",))
    truth = draw(1, 3, "single")
    seal.record(truth, tmp_path / "c")
    with open_recording(tmp_path / "c") as recording:
        volts = [recording.step(info.index)["gyro_v"] for info in recording.infos if info.samples]
    limit_v = truth.effects["saturation"]["limit_v"]
    assert limit_v < truth.unit.full_scale_v
    assert max(np.abs(part).max() for part in volts) == pytest.approx(limit_v, abs=6 * truth.unit.noise_v)


@pytest.mark.usefixtures("short")
def test_a_folder_that_is_taken_is_one_line_and_no_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "taken").write_text("")
    assert seal.main(["--seed", "1", "--index", "0", "--class", "nothing", "--out", str(tmp_path)]) == 2
    assert "already and not empty" in capsys.readouterr().err
