"""Completion: what the shell's script asks for when Tab is pressed, and the scripts, printed or installed.

The scripts in `completion/` run benchctl with the words before the one that is being typed as arguments, and
`_BENCHCTL_COMPLETE` the shell's name, `_BENCHCTL_WORD` that word. bash, which takes `=` and `:` for ends of words,
passes the whole line in `_BENCHCTL_LINE` instead. An answer is a line a candidate: the text, a tab, a word on it; none
leaves it to the shell, which then completes files. Whatever goes wrong, the answer is empty and no error is printed.
"""

from __future__ import annotations

import contextlib
import os
import re
import shlex
import sys
from collections.abc import Iterable, Sequence
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchctl.cli.verbs import VERBS
from benchctl.closeness import meant
from benchctl_instruments.errors import UsageError

if TYPE_CHECKING:
    from benchctl.cli.candidates import Candidate
    from benchctl.cli.command import VerbCommand

_OPTIONS = {
    "--help": "what the verbs are",
    "--version": "the version",
    "--install-completion": "complete by Tab",
    "--show-completion": "print what completes by Tab",
}
_ONE_LINE = re.compile(r"\s+")
_TO_QUOTE = re.compile(r"([^\w@%+=:,./~-])")


def complete(shell: str, arguments: Sequence[str]) -> int:
    """Print the candidates for the word that is being typed; the exit status is always 0."""
    with contextlib.suppress(Exception), contextlib.redirect_stderr(None):
        if shell == "bash":
            sys.stdout.write(_for_bash(os.environ["_BENCHCTL_LINE"]))
        else:
            found = candidates(arguments, os.environ.get("_BENCHCTL_WORD", ""))
            sys.stdout.write("".join(f"{text}\t{_ONE_LINE.sub(' ', says).strip()}\n" for text, says in found))
        sys.stdout.flush()
    return 0


def candidates(before: Sequence[str], word: str) -> list[Candidate]:
    """What a word may become after the words before it, that of the program left out."""
    if not before:
        return _beginning({**VERBS, **(_OPTIONS if word.startswith("-") else {})}.items(), word)
    verb, *given = before
    if verb in ("--install-completion", "--show-completion"):
        return _beginning(((shell, "") for shell in SHELLS), word)
    if verb not in VERBS:
        return []
    from benchctl.cli.command import command_of

    return _of_verb(command_of(verb), given, word)


def _of_verb(command: VerbCommand, given: Sequence[str], word: str) -> list[Candidate]:
    import typer

    context = typer.Context(command, help_option_names=["-h", "--help"])
    options = _options(command, context)
    arguments = [param for param in command.params if param.param_type_name == "argument"]
    awaited, positions = None, list[str]()
    for one in given:  # not parsed: that would import what checks the values
        if awaited is not None:
            context.params.setdefault(awaited.name, []).append(one)
            awaited = None
        elif one.startswith("-"):
            awaited = _with_value(options.get(one))
        else:
            positions.append(one)
    context.params |= {param.name: one for param, one in zip(arguments, positions, strict=False)}
    name, equals, value = word.partition("=")
    if awaited is not None:
        return _of_value(awaited, context, word)
    if equals and (option := _with_value(options.get(name))) is not None:
        return [(f"{name}={text}", says) for text, says in _of_value(option, context, value)]
    if word.startswith("-"):
        used = {id(options[one]) for one in given if one in options}
        free = ((one, it) for one, it in options.items() if id(it) not in used or it.multiple)
        return _beginning(((one, it.help or "") for one, it in free), word)
    if len(positions) < len(arguments):
        return _of_value(arguments[len(positions)], context, word)
    return _of_value(arguments[-1], context, word) if arguments and arguments[-1].nargs == -1 else []


def _of_value(param: Any, context: Any, word: str) -> list[Candidate]:
    return [(item.value, item.help or "") for item in param.shell_complete(context, word)]


def _options(command: VerbCommand, context: Any) -> dict[str, Any]:
    params = command.get_params(context)
    named = ((name, param) for param in params for name in (*param.opts, *param.secondary_opts))
    return {name: param for name, param in named if name.startswith("-")}


def _with_value(option: Any) -> Any:
    """An option that is followed by a value; None for a flag, or none."""
    return None if option is None or option.is_flag else option


def _beginning(known: Iterable[Candidate], word: str) -> list[Candidate]:
    return [(text, says) for text, says in known if text.startswith(word)]


def _for_bash(line: str) -> str:
    """The candidates as bash wants them: less what it takes for an earlier word, and a space behind what is whole."""
    *before, word = _words(line)
    cut = 1 + max(word.rfind(sign) for sign in "=:") if word else 0
    found = (text[cut:] for text, _ in candidates(before[1:], word))
    found = found if _open_quote(line) else (_TO_QUOTE.sub(r"\\\1", text) for text in found)
    return "".join(f"{text}{'' if text[-1:] in ('/', '=') else ' '}\n" for text in found)


def _words(line: str) -> list[str]:
    """The words of a line as far as it is typed; the last one is the one that is being typed, maybe empty."""
    open_quote = _open_quote(line)
    words = shlex.split(line + open_quote)
    ended = not open_quote and line[-1:].isspace() and not line.endswith("\\ ")
    return [*words, ""] if ended else words


def _open_quote(line: str) -> str:
    """The quotation mark that is not closed yet, if there is one."""
    for mark in ("", "'", '"'):
        with contextlib.suppress(ValueError):
            shlex.split(line + mark)
            return mark
    return ""


SHELLS = {"bash": "bash", "zsh": "zsh", "fish": "fish", "powershell": "ps1", "pwsh": "ps1"}
"""The shells, and what the name of each one's script ends in."""


def script(shell: str = "") -> str:
    """What completes benchctl in a shell, by default the user's; `UsageError` for a shell that is none of `SHELLS`."""
    return _text(_known(shell)).rstrip()


def _text(name: str) -> str:
    return files("benchctl.cli").joinpath(f"completion/benchctl.{SHELLS[name]}").read_text(encoding="utf-8")


def install(shell: str = "") -> str:
    """Put the script where the shell finds it; says where, and from when on it works.

    Raises
    ------
    UsageError
        A shell that is none of `SHELLS`, a file that cannot be written, a PowerShell that cannot be asked.
    """
    name = _known(shell)
    try:
        places = _installed(name)
    except OSError as err:
        raise UsageError(
            f"--install-completion {name}: {err.filename}: {err.strerror or err}; benchctl --show-completion {name} "
            "prints what to install"
        ) from err
    return f"completion for {name} installed in {' and '.join(map(str, places))}; open a new terminal to use it"


def _known(shell: str) -> str:
    name = shell or ("powershell" if os.name == "nt" else Path(os.environ.get("SHELL", "")).name)
    if name not in SHELLS:
        told = f"shell {name!r}" if name else "the shell is not known"
        raise UsageError(f"{told}: {meant(name, SHELLS)}; name it: benchctl --install-completion bash")
    return name


def _installed(name: str) -> list[Path]:
    """Write the script, and into the shell's start file, where it needs that, the line that loads it."""
    match name:
        case "fish":
            return [_write(name, _home("XDG_CONFIG_HOME", ".config") / "fish" / "completions" / "benchctl.fish")]
        case "bash":
            start, loads = Path.home() / ".bashrc", "source"
        case "zsh":
            start, loads = _home("ZDOTDIR", "") / ".zshrc", "source"
        case _:
            start, loads = _powershell_profile(name), "."
    file = _write(name, _home("XDG_DATA_HOME", ".local/share") / "benchctl" / f"completion.{SHELLS[name]}")
    _add_line(start, f"{loads} '{file}'")
    return [file, start]


def _home(variable: str, otherwise: str) -> Path:
    return Path(os.environ.get(variable) or Path.home() / otherwise)


def _write(name: str, file: Path) -> Path:
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(_text(name), encoding="utf-8")
    return file


def _add_line(file: Path, line: str) -> None:
    text = file.read_text(encoding="utf-8") if file.exists() else ""
    if line not in text.splitlines():
        file.parent.mkdir(parents=True, exist_ok=True)
        with file.open("a", encoding="utf-8") as appended:
            appended.write(f"{'' if not text or text.endswith(chr(10)) else chr(10)}{line}\n")


def _powershell_profile(name: str) -> Path:
    import subprocess

    asking = [name, "-NoProfile", "-Command", "$PROFILE"]
    asked = subprocess.run(asking, capture_output=True, text=True, check=False)  # noqa: S603 - a shell named in SHELLS
    if asked.returncode or not asked.stdout.strip():
        raise UsageError(f"--install-completion {name}: {name} does not say where its profile is; add the script to it")
    return Path(asked.stdout.strip())
