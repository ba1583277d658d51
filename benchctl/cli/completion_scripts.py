"""The shells' halves of completion: scripts that ask benchctl, printed or installed. `completing` answers them."""

from __future__ import annotations

import os
import subprocess
from importlib.resources import files
from pathlib import Path

from benchctl.closeness import meant
from benchctl_instruments.errors import UsageError

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
    asking = [name, "-NoProfile", "-Command", "$PROFILE"]
    asked = subprocess.run(asking, capture_output=True, text=True, check=False)  # noqa: S603 - a shell named in SHELLS
    if asked.returncode or not asked.stdout.strip():
        raise UsageError(f"--install-completion {name}: {name} does not say where its profile is; add the script to it")
    return Path(asked.stdout.strip())
