"""Real drives: a motor bench that turns one way a run, and a pendulum on a hobby servo."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest

from benchctl.diagnosis.diagnose import diagnose
from benchctl.diagnosis.result import Diagnosis
from benchctl.proof.injection import Injection, Untouched
from benchctl.recordings.importing import import_recording
from benchctl.recordings.reader import join, open_recording
from benchctl.recordings.writer import write_recording
from tests.shared import SHARED, needs_shared

MAPS = Path(__file__).parents[1] / "benchctl" / "recordings" / "maps"
FORWARD = ("idf_pos_0.065_1", "idf_pos_0.065_2", "idf_pos_0.065_3", "idf_pos_0.06_3")
BACKWARD = ("idf_neg_0.045_1", "idf_neg_0.04_2", "idf_neg_0.04_3")
PAIRS = [
    pytest.param(*pair, marks=() if number == 0 else pytest.mark.slow)
    for number, pair in enumerate(itertools.product(FORWARD, BACKWARD))
]


def diagnosed(folder: Path, *names: str) -> Diagnosis:
    recordings = []
    for name in names:
        import_recording(SHARED / "data" / "table_drive" / f"{name}.mat", MAPS / "drive.toml", folder / f"{name}.h5")
        recordings.append(open_recording(folder / f"{name}.h5"))
    found = diagnose(join(recordings), part="drive")
    for recording in recordings:
        recording.close()
    return found


def excluded(found: Diagnosis) -> set[str]:
    return {one.effect for one in found.not_found}


@needs_shared("data/table_drive")
@pytest.mark.parametrize(("forward", "backward"), PAIRS)
def test_any_two_directions_of_the_motor_bench_tell_dry_friction_from_an_offset(
    forward: str, backward: str, tmp_path: Path
) -> None:
    found = diagnosed(tmp_path, forward, backward)
    parameters = {one.effect: one.parameters for one in found.findings}
    assert set(parameters) == {"coulomb_friction", "torque_offset"}
    assert 0.032 < parameters["coulomb_friction"]["coulomb_nm"].value < 0.038
    assert 0.005 < parameters["torque_offset"]["offset_nm"].value < 0.009
    assert found.fit.noise == pytest.approx(0.003, abs=0.0005)
    assert found.fit.after < 1.1 * found.fit.noise
    assert found.fit.heldout_after < 0.5 * found.fit.heldout_before
    assert not excluded(found) & {"coulomb_friction", "torque_offset"}


@needs_shared("data/table_drive")
@pytest.mark.parametrize("name", [FORWARD[0], BACKWARD[1]])
def test_one_direction_of_the_motor_bench_gives_both_names_and_asks_for_the_other_direction(
    name: str, tmp_path: Path
) -> None:
    found = diagnosed(tmp_path, name)
    (finding,) = found.findings
    named = {finding.effect, *(one.effect for one in finding.alternatives)}
    assert named == {"coulomb_friction", "torque_offset"}
    assert not excluded(found) & named
    assert "the other direction of rotation" in found.next_experiment.says
    assert set(found.next_experiment.separates) == named


@needs_shared("data/table_drive")
@pytest.mark.parametrize("drag_nm_s2", [9.9e-7, 5.1e-7])
def test_dry_friction_and_a_drag_that_warming_up_would_stand_for_are_found_together(
    drag_nm_s2: float, tmp_path: Path
) -> None:
    """An effect of known size, added to the torque of a real run, flattens what the friction's absence would bend.

    Beside the weaker one a drift would be stated that held-out steps contradict, and with it the warming.
    """
    file = tmp_path / "run.h5"
    import_recording(SHARED / "data" / "table_drive" / f"{FORWARD[0]}.mat", MAPS / "drive.toml", file)
    drag = Injection(index=0, effect="quadratic_drag", parameters={"drag_nm_s2": drag_nm_s2}, share=1.0, nonce="")
    with open_recording(file) as run:
        dragged = Untouched(run, diagnose(run, part="drive").as_json()).with_it(drag)
        write_recording(tmp_path / "dragged.h5", run.meta, dragged)
    with open_recording(tmp_path / "dragged.h5") as run:
        found = {one.effect: one for one in diagnose(run, part="drive").findings}
    assert set(found) == {"coulomb_friction", "quadratic_drag"}
    assert found["quadratic_drag"].parameters["drag_nm_s2"].value == pytest.approx(drag_nm_s2, abs=1.9e-7)


@needs_shared("data/pendulum")
@pytest.mark.slow
def test_a_pendulum_is_pulled_by_gravity_and_rubs(tmp_path: Path) -> None:
    file = tmp_path / "pendulum.h5"
    import_recording(SHARED / "data" / "pendulum" / "servo_pendulum.csv", MAPS / "pendulum.toml", file)
    with open_recording(file) as recording:
        found = diagnose(recording, part="drive")
    named = {one.effect: one for one in found.findings}
    assert "gravity" in named
    assert abs((named["gravity"].parameters["hangs_at_deg"].value + 180.0) % 360.0 - 180.0) < 3.0
    assert "gear_friction" in named  # lifting takes more than lowering gives back, and rests hold all between
    assert found.fit.unit == "count"
    assert named["gravity"].parameters["moment_nm"].unit == "count"
    assert "N·m" not in "".join(one.says for one in found.findings)
    assert found.baseline["viscous_nm_s"].low > 0.0
    assert found.fit.after < 70.0
    assert found.fit.heldout_after < 70.0 < found.fit.heldout_before
    assert found.not_found == ()
