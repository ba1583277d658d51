"""Shell completion: print the candidates for the word being typed, and print or install the shell scripts.

The scripts in `completion/` run benchctl with the preceding words as arguments, and with the shell's name in
`_BENCHCTL_COMPLETE` and the word being typed in `_BENCHCTL_WORD`. bash splits words at `=` and `:`, so its script
passes the complete line in `_BENCHCTL_LINE` instead. The output has one line per candidate: text, tab, description.
Without candidates the shell completes file names. On any error the output is empty and no error is printed.
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
    from benchctl.cli.command import VerbCommand, VerbGroup

_OPTIONS = {
    "--help": "what the verbs are",
    "--version": "the version",
    "--install-completion": "complete by Tab",
    "--show-completion": "print what completes by Tab",
}
_ONE_LINE = re.compile(r"\s+")
_TO_QUOTE = re.compile(r"([^\w@%+=:,./~-])")


def complete(shell: str, arguments: Sequence[str]) -> int:
    """Print the candidates for the word being typed; the exit status is always 0."""
    with contextlib.suppress(Exception), contextlib.redirect_stderr(None):
        if shell == "bash":
            sys.stdout.write(_for_bash(os.environ["_BENCHCTL_LINE"]))
        else:
            found = candidates(arguments, os.environ.get("_BENCHCTL_WORD", ""))
            sys.stdout.write("".join(f"{text}\t{_ONE_LINE.sub(' ', hint).strip()}\n" for text, hint in found))
        sys.stdout.flush()
    return 0


def candidates(before: Sequence[str], word: str) -> list[Candidate]:
    """Return the candidates for `word` after the words in `before`, which does not contain the program's name."""
    if not before:
        return _beginning({**VERBS, **(_OPTIONS if word.startswith("-") else {})}.items(), word)
    verb, *given = before
    if verb in ("--install-completion", "--show-completion"):
        return _beginning(((shell, "") for shell in SHELLS), word)
    if verb not in VERBS:
        return []
    from benchctl.cli.command import VerbGroup, named_command

    command, given = named_command(verb, given)
    if isinstance(command, VerbGroup) and not (given or word.startswith("-")):
        return _beginning(((name, one.get_short_help_str()) for name, one in command.commands.items()), word)
    return _of_verb(command, given, word)


def _of_verb(command: VerbCommand | VerbGroup, given: Sequence[str], word: str) -> list[Candidate]:
    import typer

    context = typer.Context(command, help_option_names=["-h", "--help"])
    options = _options(command, context)
    arguments = [param for param in command.params if param.param_type_name == "argument"]
    awaited, positions = None, list[str]()
    for one in given:  # not parsed by typer, which would import the modules that check the values
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
        return [(f"{name}={text}", hint) for text, hint in _of_value(option, context, value)]
    if word.startswith("-"):
        used = {id(options[one]) for one in given if one in options}
        free = ((one, it) for one, it in options.items() if id(it) not in used or it.multiple)
        return _beginning(((one, it.help or "") for one, it in free), word)
    if len(positions) < len(arguments):
        return _of_value(arguments[len(positions)], context, word)
    return _of_value(arguments[-1], context, word) if arguments and arguments[-1].nargs == -1 else []


def _of_value(param: Any, context: Any, word: str) -> list[Candidate]:
    return [(item.value, item.help or "") for item in param.shell_complete(context, word)]


def _options(command: VerbCommand | VerbGroup, context: Any) -> dict[str, Any]:
    params = command.get_params(context)
    named = ((name, param) for param in params for name in (*param.opts, *param.secondary_opts))
    return {name: param for name, param in named if name.startswith("-")}


def _with_value(option: Any) -> Any:
    """Return the option if it takes a value; None for a flag or for no option."""
    return None if option is None or option.is_flag else option


def _beginning(known: Iterable[Candidate], word: str) -> list[Candidate]:
    return [(text, hint) for text, hint in known if text.startswith(word)]


def _for_bash(line: str) -> str:
    """Return the candidates for bash: without the part that bash takes for an earlier word; a space ends complete ones.

    bash splits words at `=` and `:`.
    """
    *before, word = _words(line)
    cut = 1 + max(word.rfind(sign) for sign in "=:") if word else 0
    found = (text[cut:] for text, _ in candidates(before[1:], word))
    found = found if _open_quote(line) else (_TO_QUOTE.sub(r"\\\1", text) for text in found)
    return "".join(f"{text}{'' if text[-1:] in ('/', '=') else ' '}\n" for text in found)


def _words(line: str) -> list[str]:
    """Return the words of an incomplete line; the last one is being typed and may be empty."""
    open_quote = _open_quote(line)
    words = shlex.split(line + open_quote)
    ended = not open_quote and line[-1:].isspace() and not line.endswith("\\ ")
    return [*words, ""] if ended else words


def _open_quote(line: str) -> str:
    """Return the quotation mark that is still open, or an empty string."""
    for mark in ("", "'", '"'):
        with contextlib.suppress(ValueError):
            shlex.split(line + mark)
            return mark
    return ""


SHELLS = {"bash": "bash", "zsh": "zsh", "fish": "fish", "powershell": "ps1", "pwsh": "ps1"}
"""The supported shells, and the file name extension of each one's script."""


def script(shell: str = "") -> str:
    """Return the completion script for a shell, by default the user's.

    Raises `UsageError` if the shell is not in `SHELLS`.
    """
    return _text(_known(shell)).rstrip()


def _text(name: str) -> str:
    return files("benchctl.cli").joinpath(f"completion/benchctl.{SHELLS[name]}").read_text(encoding="utf-8")


def install(shell: str = "") -> str:
    """Install the completion script for a shell; return a message that names the files.

    Raises
    ------
    UsageError
        If the shell is not in `SHELLS`, a file cannot be written, or PowerShell does not report its profile.
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
        problem = f"shell {name!r}" if name else "the shell is not known"
        raise UsageError(f"{problem}: {meant(name, SHELLS)}; name it: benchctl --install-completion bash")
    return name


def _installed(name: str) -> list[Path]:
    """Write the script and, for shells that need it, add the line that loads it to the shell's start file."""
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

    command = [name, "-NoProfile", "-Command", "$PROFILE"]
    ran = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - a shell named in SHELLS
    if ran.returncode or not ran.stdout.strip():
        raise UsageError(f"--install-completion {name}: {name} does not say where its profile is; add the script to it")
    return Path(ran.stdout.strip())
