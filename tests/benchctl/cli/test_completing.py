"""Completion: what may stand at each place of the command line, and the shells themselves, where they are there."""

from __future__ import annotations

import os
import shlex
import shutil
import struct
import subprocess
import sys
import time
from importlib.resources import files
from pathlib import Path

import pytest

from benchctl.cli.app import run_verb
from benchctl.cli.completing import SHELLS, candidates
from benchctl.cli.verbs import VERBS
from benchctl.plan.find import procedure_names

_LONGEST_S = 20.0

OWN = """
from benchctl.plan import Static, procedure

@procedure()
def own(rest_s: float = 5.0, points_c: tuple[float, ...] = (1.0, 2.0)):
    yield Static(duration_s=rest_s)

open("it_ran", "w").close()
"""


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a procedure, a bench, a campaign, a recording and other things."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.py").write_text(OWN)
    (tmp_path / "results" / "first").mkdir(parents=True)
    for name in ("bench.toml", "a recording.h5", "notes.txt", ".hidden.h5", "results/first/recording.h5"):
        (tmp_path / name).write_text("")
    return tmp_path


def script_text(shell: str) -> str:
    """The script of a shell as its file holds it."""
    return files("benchctl.cli").joinpath(f"completion/benchctl.{SHELLS[shell]}").read_text(encoding="utf-8")


def texts(*line: str) -> list[str]:
    *before, word = line
    return [text for text, _ in candidates(before, word)]


def test_verbs_come_first_and_options_of_benchctl_where_a_dash_is_typed() -> None:
    assert texts("") == list(VERBS)
    assert texts("ru") == ["run"]
    assert texts("--v") == ["--version"]
    assert texts("nonsense", "") == []


def test_options_are_those_of_the_verb_less_what_stands_there() -> None:
    assert "--resume" in texts("run", "--")
    assert texts("run", "static", "--be") == ["--bench"]
    assert texts("run", "--bench", "simulated", "--be") == []
    assert texts("run", "-p", "a=1", "--para") == ["--parameter"]  # as often as one likes
    assert "--no-generic" in texts("prove", "--")


def test_procedures_and_files_that_may_hold_one(lab: Path) -> None:
    assert [name for name in texts("run", "") if name in procedure_names()] == list(procedure_names())
    assert texts("check", "o") == ["own.py"]
    assert texts("simulate", "two") == ["two_stage"]


def test_parameters_of_the_procedure_that_stands_there(lab: Path) -> None:
    found = dict(candidates(["run", "two_stage", "--bench", "simulated", "-p"], "po"))
    assert found == {"points=": "number of set points"}
    assert texts("run", "two_stage", "-p", "points=") == ["points=20"]
    assert texts("run", "-p", "points=5", "two_stage", "-p", "po") == []


def test_a_procedures_file_is_read_for_its_parameters_and_not_run(lab: Path) -> None:
    assert texts("run", "own.py", "-p", "") == ["rest_s=", "points_c="]
    assert texts("run", "own.py", "-p", "points_c=") == ["points_c=1.0, 2.0"]
    assert not (lab / "it_ran").exists()


def test_files_are_of_the_kind_that_is_wanted(lab: Path) -> None:
    assert texts("run", "static", "--bench", "") == ["simulated", "bench.toml", "results/"]
    assert texts("run", "static", "--bench=s") == ["--bench=simulated"]
    assert texts("show", "") == ["a recording.h5", "results/"]
    assert texts("show", "results/") == ["results/first"]
    assert texts("show", ".h") == [".hidden.h5"]
    assert texts("run", "--resume", "results/f") == ["results/first"]
    assert texts("fit", "results/first", "a") == ["a recording.h5"]
    assert texts("show", "results/first", "a") == []  # it takes one


def test_words_that_there_are_a_few_of() -> None:
    assert texts("export", "x.h5", "--to", "c") == ["csv", "c-header"]
    assert texts("diagnose", "--part", "") == ["gyro", "drive", "chamber"]
    assert texts("--show-completion", "") == list(SHELLS)


def completed(word: str, *before: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "benchctl", *before],
        env={**os.environ, "_BENCHCTL_COMPLETE": "zsh", "_BENCHCTL_WORD": word, **environment},
        capture_output=True,
        text=True,
        timeout=150,
    )


@pytest.mark.parametrize(
    "line",
    [
        ("run", "nosuch", "-p", ""),
        ("run", "nosuch.py", "-p", ""),
        ("run", "broken.py", "-p", ""),
        ("nonsense", "--x", ""),
        ("run", "--bench", "--", "-p", ""),
        ("show", "/root/nothing/\x01/"),
        ("accept", "--limits", "~nobody/"),
    ],
)
def test_whatever_stands_there_no_error_is_printed(lab: Path, line: tuple[str, ...]) -> None:
    (lab / "broken.py").write_text("def (:")
    *before, word = line
    ran = completed(word, *before)
    assert (ran.returncode, ran.stdout, ran.stderr) == (0, "", "")


@pytest.mark.parametrize(
    ("line", "answer"),
    [
        ("benchctl ru", "run \n"),
        ("benchctl run two_stage -p po", "points=\n"),
        ("benchctl run two_stage -p points=", "20 \n"),  # for bash, `=` ends a word
        ("benchctl run static --bench=s", "simulated \n"),
        ("benchctl show a", "a\\ recording.h5 \n"),
        ("benchctl show 'a", "a recording.h5 \n"),
        ("benchctl show res", "results/\n"),
        ("benchctl show 'a\\", ""),
    ],
)
def test_bash_is_answered_in_its_own_words(lab: Path, line: str, answer: str) -> None:
    ran = completed("", _BENCHCTL_COMPLETE="bash", _BENCHCTL_LINE=line)
    assert (ran.returncode, ran.stdout, ran.stderr) == (0, answer, "")


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in ("XDG_DATA_HOME", "XDG_CONFIG_HOME", "ZDOTDIR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    (tmp_path / "home").mkdir()
    return tmp_path / "home"


@pytest.mark.skipif(sys.platform == "win32", reason="shells of POSIX")
@pytest.mark.parametrize(
    ("shell", "start"), [("bash", ".bashrc"), ("zsh", ".zshrc"), ("fish", ".config/fish/completions/benchctl.fish")]
)
def test_installing_twice_is_as_installing_once(
    home: Path, shell: str, start: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (home / ".bashrc").write_text("alias mine=yes")
    for _ in range(2):
        assert run_verb(["--install-completion", shell]) == 0
    said = capsys.readouterr().out
    assert f"completion for {shell} installed in " in said
    text = (home / start).read_text()
    assert text.count("benchctl") == (script_text(shell).count("benchctl") if shell == "fish" else 1)
    assert (home / ".bashrc").read_text().startswith("alias mine=yes")


@pytest.mark.skipif(sys.platform == "win32", reason="$SHELL is of POSIX")
def test_the_shell_is_the_users_unless_it_is_named(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SHELL", "/usr/bin/fish")
    assert run_verb(["--install-completion"]) == 0
    assert (home / ".config/fish/completions/benchctl.fish").is_file()


@pytest.mark.parametrize("shell", SHELLS)
def test_what_would_be_installed_is_shown(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_verb(["--show-completion", shell]) == 0
    assert capsys.readouterr().out.strip() == script_text(shell).strip()


def test_powershell_is_told_by_its_own_completer() -> None:
    script = script_text("powershell")
    assert "Register-ArgumentCompleter -Native -CommandName benchctl" in script
    assert "[System.Management.Automation.CompletionResult]::new(" in script
    assert "ExecutionPolicy" not in script  # nobody's safety is loosened for a Tab
    assert script.count("{") == script.count("}")
    assert script.count("(") == script.count(")")


@pytest.mark.parametrize(
    ("shell", "says"),
    [("bsah", "did you mean bash?"), ("ksh", "shell 'ksh': "), ("tcsh", "benchctl --install-completion")],
)
def test_a_shell_that_is_none_of_them_is_one_line(shell: str, says: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_verb(["--install-completion", shell]) == 2
    assert says in capsys.readouterr().err


@pytest.mark.skipif(sys.platform == "win32" or os.geteuid() == 0, reason="root may write anywhere")
def test_a_place_that_may_not_be_written_to_is_one_line(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    home.chmod(0o500)
    assert run_verb(["--install-completion", "bash"]) == 2
    assert "--show-completion bash prints what to install" in capsys.readouterr().err


def test_without_its_powershell_the_profile_cannot_be_asked_for(
    home: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", str(home))
    assert run_verb(["--install-completion", "pwsh"]) == 2
    assert "pwsh" in capsys.readouterr().err


@pytest.mark.skipif(sys.platform == "win32", reason="a pty is a thing of POSIX")
@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_in_the_shell_itself_tab_completes(lab: Path, home: Path, shell: str) -> None:
    program = shutil.which(shell)
    if program is None:
        pytest.skip(f"{shell} is not installed")
    (home / "bin").mkdir()
    (home / "bin" / "benchctl").write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -m benchctl "$@"\n')
    (home / "bin" / "benchctl").chmod(0o755)
    assert run_verb(["--install-completion", shell]) == 0
    keys = "benchctl ru\ttwo_s\t-p poi\t5 --out res\tx\x01printf '<%s>' \r"
    said = typed(program, keys, "/x>", home)
    assert "<benchctl><run><two_stage><-p><points=5><--out><results/x>" in said.replace("\r\n", "")


def typed(program: str, keys: str, last: str, home: Path) -> str:
    """What a shell says on its terminal to some keys, until it has said its last."""
    import fcntl
    import pty
    import termios

    ours, theirs = pty.openpty()
    environment = {**os.environ, "HOME": str(home), "PATH": f"{home / 'bin'}:{os.environ['PATH']}", "TERM": "xterm"}
    with (home / ".bashrc").open("a") as start:
        start.write("PS1='$ '\n")  # a system's own file may have set another
    (home / ".config/fish").mkdir(parents=True, exist_ok=True)
    (home / ".config/fish/config.fish").write_text("function fish_prompt; printf '$ '; end\n")
    environment |= {"PS1": "$ ", "COLUMNS": "300", "LINES": "50", "INPUTRC": "/dev/null"}
    fcntl.ioctl(ours, termios.TIOCSWINSZ, struct.pack("HHHH", 50, 300, 0, 0))
    with subprocess.Popen(
        [program, "-i"],
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        env=environment,
        start_new_session=True,
        preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
    ) as process:
        os.close(theirs)
        os.set_blocking(ours, False)
        try:
            said = _until(ours, "$ ")
            os.write(ours, keys.encode())
            said += _until(ours, last)
        finally:
            process.kill()
    os.close(ours)
    return said


def _until(terminal: int, words: str) -> str:
    """What comes until these words have; at most for a while."""
    said, end_s = b"", time.monotonic() + _LONGEST_S
    while words.encode() not in said and time.monotonic() < end_s:
        try:
            said += os.read(terminal, 65536)
        except BlockingIOError:
            time.sleep(0.02)
        except OSError:  # the shell has ended
            break
    return said.decode(errors="replace")
