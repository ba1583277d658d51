from pathlib import Path

import pytest

from benchctl.plan.find import find_procedure
from benchctl.plan.written import as_texts, plan_source


@pytest.mark.parametrize("name", ["static", "rate_sweep", "sine_sweep", "temperature_sweep", "two_stage"])
def test_a_plan_that_is_written_down_is_read_back_as_it_was(name: str, tmp_path: Path) -> None:
    plan = find_procedure(name).expand()
    path = tmp_path / "next.py"
    path.write_text(plan_source(plan, 'It\'s what "was" asked\nfor: τ < 5 s.\\'), encoding="utf-8")
    again = find_procedure(str(path))
    assert again.expand().steps == plan.steps
    assert again.says == 'It\'s what "was" asked for: τ < 5 s.\\'
    assert again.name == name


def test_parameters_become_the_texts_that_they_were_read_from() -> None:
    plan = find_procedure("two_stage").expand({"points": "5", "soak_s": "3600"})
    assert find_procedure("two_stage").expand(as_texts(plan.parameters)) == plan
