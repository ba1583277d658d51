"""A unit of three axes that the operator turns: from the questions to the matrix, over the gyro's real line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchctl import api
from benchctl.app.accept import accept
from benchctl.app.run import Watch, play, questions_asked
from benchctl.bench import Bench, bench_of_text, load_bench, template
from benchctl.campaign.check import problems
from benchctl.campaign.operator import Answers
from benchctl.campaign.resume import steps_to_play
from benchctl.campaign.runner import Outcome
from benchctl.metrology.limit_file import limits_of_text, limits_template
from benchctl.plan import ConstantRate, Mount, Soak, Static
from benchctl.recordings.model import AXIS_CHANNELS, AXIS_COMPENSATED
from benchctl.recordings.reader import open_recording
from benchctl.recordings.verify import verify
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.gyro import earth_rate_dps
from benchctl_instruments.physics.three_axes import ThreeAxisParameters
from benchctl_procedures.three_axes import three_axes
from tests.benchctl.recordings.made import info

UNIT = ThreeAxisParameters()
PLAN = three_axes.expand(
    {"soak_s": "60", "rates": "6", "run_s": "2", "zero_s": "2", "rate_dps": "180", "opposite": "false"}
)


def bench(model: str = "kvh_dsp1760") -> Bench:
    return bench_of_text(f'{template()}[gyro]\nmodel = "{model}"\nframe_rate_hz = 250.0\naxes = 3\n', "the bench")


@pytest.fixture(scope="module", params=["kvh_dsp1760", pytest.param("sensonor_stim300", marks=pytest.mark.slow)])
def played(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    stated = bench(request.param)
    asked = questions_asked(PLAN, stated)
    answers = Answers(path=Path("answers.toml"), by_question={one.text: "done" for one in asked})
    return play(PLAN, stated, tmp_path_factory.mktemp("three") / "c", watch=Watch(warn=print), answers=answers)


def test_the_operator_is_asked_to_turn_each_axis_up() -> None:
    says = [one.text for one in questions_asked(PLAN, bench())]
    assert says == [
        f"turn unit SIM-0001 so that its {axis} axis points up, then stand clear of the table" for axis in "xyz"
    ]


def test_each_axis_is_also_turned_down_and_every_set_point_is_kept_in_every_position() -> None:
    steps = three_axes.expand({"set_points_c": "0,40", "rates": "1"}).steps
    mounts = [step.position for step in steps if isinstance(step, Mount)]
    assert mounts == ["x up", "x down", "y up", "y down", "z down", "z up"]
    assert [step.setpoint_c for step in steps if isinstance(step, Soak)] == [0.0, 40.0] * 6
    assert [step.rate_dps for step in steps if isinstance(step, ConstantRate)] == [100.0, -100.0] * 12
    assert sum(isinstance(step, Static) for step in steps) == 24
    assert problems(three_axes.expand({}), bench()) == []


def test_a_bench_without_a_unit_of_three_axes_is_told_what_to_state() -> None:
    (problem,) = problems(PLAN, load_bench("simulated"))
    assert "turns a unit of three axes, and the bench has none; state axes = 3 in the table [gyro]" in problem.message


def test_a_resumed_campaign_has_the_unit_turned_as_it_was() -> None:
    whole = [info(index, kind=step.kind) for index, step in enumerate(PLAN.steps[:4], 1)]
    (index, number, again), *_ = steps_to_play(PLAN, whole, 20.0)
    assert (index, number, again.label) == (len(PLAN.steps) + 1, 5, "mount x up again, before step 5")


def test_every_step_says_how_the_unit_was_turned_and_has_the_rates_of_all_axes(played: Outcome) -> None:
    assert (played.status, played.error, verify(played.recording)) == ("complete", None, [])
    with open_recording(played.recording) as recording:
        turned = [info for info in recording.infos if info.kind in ("static", "constant_rate")]
        assert [info.mounting for info in turned] == ["x up"] * 14 + ["y up"] * 14 + ["z up"] * 14
        for info in turned:
            step = recording.step(info.index, AXIS_CHANNELS)
            rates = np.array([step[name].mean() for name in AXIS_CHANNELS])
            expected = (info.rate_dps or 0.0) * (np.arange(3) == "xyz".index(info.mounting[0]))
            np.testing.assert_allclose(rates, expected, atol=0.6)
            assert info.role == "none"


def test_no_test_of_one_axis_uses_these_steps(played: Outcome) -> None:
    with pytest.raises(UsageError, match="has no complete step at rest or at a constant rate"):
        accept(played.recording, limits_of_text(limits_template(), Path("limits.toml")))


def test_the_fit_finds_the_units_matrix_and_biases(played: Outcome, tmp_path: Path) -> None:
    fitted = api.fit(played, out=tmp_path)
    stated = json.loads((tmp_path / "coefficients.json").read_text())["uncertainty"]["parameters"]
    warmer_c = fitted.coefficients["T0_c"] - UNIT.T0_c
    matrix = np.reshape(UNIT.matrix, (3, 3)) + warmer_c * np.reshape(UNIT.matrix_per_c, (3, 3))
    bias = np.array(UNIT.bias_dps) + warmer_c * np.array(UNIT.bias_dps_per_c)
    for i, output in enumerate("xyz"):
        one = stated[f"bias_{output}_dps"]
        assert abs(one["value"] - bias[i]) < 3.0 * one["expanded"] < 0.01
        for j, about in enumerate("xyz"):
            one = stated[f"matrix_{output}{about}"]
            assert abs(one["value"] - matrix[i, j]) < 3.0 * one["expanded"] < 5e-4
    assert fitted.warnings == ()
    assert (tmp_path / "report.html").read_text().count("<caption>three axes at") == 1
    assert [line.split()[0] for line in str(fitted).splitlines()] == ["three", "output", "x", "y", "z"]
    done = api.apply(played, tmp_path / "coefficients.json", tmp_path / "c.h5")
    with open_recording(done.recording) as recording:
        for info in [info for info in recording.infos if info.kind == "constant_rate"]:
            step = recording.step(info.index, AXIS_COMPENSATED)
            axis = "xyz".index(info.mounting[0])  # all axes up: the rate is the table's and the Earth's
            expected = (info.rate_dps + earth_rate_dps(fitted.coefficients["latitude_deg"])) * (np.arange(3) == axis)
            np.testing.assert_allclose([step[name].mean() for name in AXIS_COMPENSATED], expected, atol=0.02)
    with pytest.raises(UsageError, match=r"three axes has no K0_v_per_dps; read coefficients\['matrix'\]"):
        fitted.K0_v_per_dps  # noqa: B018 - it raises
