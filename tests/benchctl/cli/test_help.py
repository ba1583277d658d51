"""`--help` is quick because heavy imports wait until they are needed."""

import subprocess
import sys

import pytest

VERBS = (
    "apply", "check", "compare", "diagnose", "export", "fit", "import", "init", "paper", "procedures", "prove",
    "recover", "run", "show", "sim", "simulate", "verify",
)  # fmt: skip


def test_help_imports_nothing_heavy() -> None:
    heavy = ("numpy", "scipy", "h5py", "matplotlib", "pymodbus", "pydantic", "serial", "jinja2")
    code = f"import benchctl.cli, sys; print([name for name in {heavy!r} if name in sys.modules])"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "[]"


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_explains_itself_with_an_example(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    from benchctl.cli.app import run_verb

    assert run_verb([verb, "--help"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert f"benchctl {verb}" in text
    assert "Example" in text


def test_the_help_of_import_explains_the_map_by_example(capsys: pytest.CaptureFixture[str]) -> None:
    from benchctl.cli.app import run_verb

    assert run_verb(["import", "--help"]) == 0
    text = capsys.readouterr().out
    assert "[channels.encoder_deg]" in text
    assert "counts_per_rev" in text


def test_the_version_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    import benchctl
    from benchctl.cli.app import run_verb

    assert run_verb(["--version"]) == 0
    assert capsys.readouterr().out == f"benchctl {benchctl.__version__}\n"
