from pathlib import Path

from benchctl.bench import template
from benchctl.doctor.examine import examine
from benchctl.doctor.finding import Finding


def _of_bench(tmp_path: Path, old: str, new: str) -> dict[tuple[str, str], Finding]:
    assert old in template()
    path = tmp_path / "bench.toml"
    path.write_text(template().replace(old, new, 1), encoding="utf-8")
    return {(finding.where, finding.what): finding for finding in examine(str(path), tmp_path)}


def test_addresses_that_nobody_looks_at_are_told(tmp_path: Path) -> None:
    old = '# address = "tcp://192.168.1.60:502"'
    found = _of_bench(tmp_path, old, old.removeprefix("# "))
    assert found["bench", "addresses"].verdict == "look"
    assert "the addresses of chamber only select the kind of simulated line" in found["bench", "addresses"].message
    assert found["chamber", "identity"].verdict == "ok"
    assert ("chamber", "connection") not in found


def test_a_certificate_that_has_expired_is_told(tmp_path: Path) -> None:
    found = _of_bench(tmp_path, "# calibrated_until = 2027-01-31", "calibrated_until = 2020-01-31")
    assert found["bench", "certificate"].verdict == "look"
    assert "its certificate expired on 2020-01-31" in found["bench", "certificate"].message


def test_a_simulated_bench_that_cannot_be_wired_as_it_says_is_the_inputs_fault(tmp_path: Path) -> None:
    found = _of_bench(tmp_path, "[digitizer]", "[chamber.options]\nunit = 3\n[digitizer]")
    wrong = found["bench", "simulation"]
    assert (wrong.verdict, wrong.unusable) == ("bad", True)
    assert "chamber.options: watlow_f4t has no option 'unit': did you mean unit_id?" in wrong.message


def test_without_a_bench_only_this_machine_is_looked_at(tmp_path: Path) -> None:
    assert {finding.where for finding in examine(None, tmp_path)} == {"machine", "results", "ports"}
