"""The help: quick, for nothing heavy is imported for it, and with examples that can be typed."""

from __future__ import annotations

import shlex
import subprocess
import sys

import pytest

from benchctl.cli.app import run_verb
from benchctl.cli.command import command_of, examples, named_command, option_names
from benchctl.cli.output import parameters
from benchctl.cli.verbs import EXAMPLES, GROUPS, SYNONYMS, VERBS, overview
from benchctl.plan.find import find_procedure
from tests.slowness import slowness

HEAVY = (
    "numpy", "scipy", "h5py", "matplotlib", "pymodbus", "pydantic", "serial", "jinja2", "rich", "pint", "fastapi",
    "pygments",
)  # fmt: skip


def test_no_help_imports_anything_heavy() -> None:
    code = (
        "import io, sys; from contextlib import redirect_stdout; from benchctl.cli.app import run_verb\n"
        "from benchctl.cli.verbs import VERBS\n"
        "for arguments in [['--help'], ['--version'], *([verb, '--help'] for verb in VERBS)]:\n"
        "    with redirect_stdout(io.StringIO()) as said:\n"
        "        status = run_verb(arguments)\n"
        f"    found = [name for name in {HEAVY!r} if name in sys.modules]\n"
        "    if status or found or not said.getvalue(): sys.exit(f'{arguments}: exit {status}, imported {found}')\n"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr


@pytest.mark.parametrize("module", ["benchctl", "benchctl.cli", "benchctl.cli.verbs"])
def test_the_overview_does_without_typer_too(module: str) -> None:
    code = f"import {module}, sys; print([name for name in ('typer', *{HEAVY!r}) if name in sys.modules])"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "[]"


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no getrusage")
@pytest.mark.parametrize(("arguments", "most_s"), [(["--help"], 0.15), (["run", "--help"], 0.3)])
def test_the_help_takes_little_time(arguments: list[str], most_s: float) -> None:
    import resource

    def cpu_s() -> float:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, "-m", "benchctl", *arguments], capture_output=True, check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    assert min(cpu_s() for _ in range(5)) < most_s * slowness()


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_explains_itself(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_verb([verb, "--help"]) == 0
    text = capsys.readouterr().out
    assert text.startswith(f"Usage: benchctl {verb} ")
    assert "\nExamples:\n  benchctl " in text
    assert "--help" in text
    assert run_verb([verb, "-h"]) == 0
    assert capsys.readouterr().out == text


def commands(lines: tuple[str, ...]) -> list[list[str]]:
    """The words of each command in lines of examples."""
    return [shlex.split(part, comments=True) for line in lines for part in line.split(" && ")]


def parsed(words: list[str]) -> dict[str, object]:
    program, verb, *arguments = words
    assert program == "benchctl"
    command, rest = named_command(verb, arguments)
    return command.make_context(verb, rest).params


@pytest.mark.parametrize("verb", VERBS)
def test_every_example_can_be_typed(verb: str) -> None:
    lines = examples(command_of(verb).help)
    assert lines
    assert lines[0].startswith(f"benchctl {verb}")
    for words in commands(lines):
        found = parsed(words)
        if isinstance(found.get("procedure"), str) and not str(found["procedure"]).endswith(".py"):
            texts = found.get("parameter")
            assert find_procedure(str(found["procedure"])).expand(parameters(texts)).steps  # type: ignore[arg-type]


def test_the_overviews_examples_can_be_typed() -> None:
    for words in commands(EXAMPLES):
        if "--help" not in words:
            parsed(words)
    assert all(f"  {line}" in overview() for line in EXAMPLES)


def test_the_overview_has_all_verbs_in_the_order_of_who_needs_them(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_verb(["--help"]) == 0
    text = capsys.readouterr().out
    places = [text.index(f"\n{group}:\n") for group in GROUPS]
    assert places == sorted(places)
    assert next(iter(GROUPS)) == "In the lab"
    for verb, says in VERBS.items():
        assert f"  {verb} " in text
        assert says in text
    assert max(map(len, text.splitlines())) <= 120


def test_benchctl_alone_says_the_same_but_is_no_success(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_verb([]) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.strip() == overview().strip()


def test_what_other_programs_call_a_verb_leads_to_ours() -> None:
    for name, ours in SYNONYMS.items():
        assert name not in VERBS
        verb, *options = ours.split()
        assert set(options) <= set(option_names(command_of(verb)))


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["fti"], "there is no verb fti: did you mean fit?"),
        (["RUN"], "there is no verb RUN: did you mean run?"),
        (["calibrate"], "there is no verb calibrate: did you mean fit?"),
        (["xyzzy"], "there is no verb xyzzy: benchctl --help lists them"),
        (["--hlep"], "there is no option --hlep before a verb: did you mean --help?"),
        (["--bench", "simulated"], "there is no option --bench before a verb: a verb comes first"),
        (["run", "static", "--bnech", "simulated"], "run: there is no option --bnech: did you mean --bench?"),
        (["run", "static", "--xyzzy"], "run: there is no option --xyzzy: benchctl run --help explains it"),
        (["run", "static", "--seed"], "--seed' requires an argument; benchctl run --help explains it"),
        (["run", "static", "--seed", "x"], "run: --seed: "),
        (["export", "x.h5", "--to", "cvs"], "export: --to: 'cvs' is not one of "),
        (["export", "x.h5", "--to", "cvs"], ": did you mean csv?"),
        (["accept"], "accept: RECORDING is needed: A recording, a campaign's folder"),
        (["simulate", "static"], "simulate: --output / -o is needed: the recording to write"),
        (["fleet"], "fleet: expected fit or diagnose or accept; benchctl fleet --help explains it"),
        (["fleet", "fits", "a"], "fleet: there is no command fits: did you mean fit?"),
        (["instrument", "probe", "tcp://a:1", "-o", "x"], "instrument probe: there is no option -o"),
        (["show", "a", "b"], "show: Got unexpected extra argument(s) (b); benchctl show --help explains it"),
        (["allan", "x.csv", "--rate-hz", "5 m"], "--rate-hz: expected a number in Hz"),
        (["run", "sttaic", "--bench", "simulated"], "there is no procedure 'sttaic': did you mean static?"),
        (["run", "static", "--bench", "simulated", "-p", "duraton_s=5"], "did you mean duration_s?"),
        (["run", "static", "--bench", "simulated", "-p", "duration_s=5 m"], "expected a number in s"),
    ],
)
def test_what_cannot_be_used_is_one_line_that_says_what_would_do(
    arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_verb(arguments) == 2
    told = capsys.readouterr()
    assert told.out == ""
    (line,) = told.err.splitlines()
    assert line.startswith("benchctl: ")
    assert says in line


def test_the_help_of_import_explains_the_map_by_example(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_verb(["import", "--help"]) == 0
    text = capsys.readouterr().out
    assert "[channels.encoder_deg]" in text
    assert "counts_per_rev" in text


def test_the_help_of_run_explains_the_file_of_answers(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_verb(["run", "--help"]) == 0
    assert '"close the chamber\'s door" = "done"' in capsys.readouterr().out


def test_the_version_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    import benchctl

    assert run_verb(["--version"]) == 0
    assert capsys.readouterr().out == f"benchctl {benchctl.__version__}\n"
