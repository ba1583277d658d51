"""The shells' halves of completion: scripts that ask benchctl, printed or installed. `completing` answers them."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable
from pathlib import Path

from benchctl.closeness import meant
from benchctl_instruments.errors import UsageError

_BASH = r"""# completion of benchctl for bash
_benchctl_complete() {
    local reply
    COMPREPLY=()
    while IFS= read -r reply; do
        COMPREPLY+=("$reply")
    done < <(_BENCHCTL_COMPLETE=bash _BENCHCTL_LINE="${COMP_LINE:0:COMP_POINT}" "$1" 2>/dev/null)
    [[ ${#COMPREPLY[@]} -gt 0 ]] || compopt +o nospace 2>/dev/null
}
complete -o default -o nospace -F _benchctl_complete benchctl
"""

_ZSH = r"""# completion of benchctl for zsh
_benchctl() {
    local line text says
    local -a whole part
    for line in "${(@f)$(_BENCHCTL_COMPLETE=zsh _BENCHCTL_WORD="${(Q)PREFIX}" \
        "${words[1]}" "${(@Q)words[2,CURRENT-1]}" 2>/dev/null)}"; do
        [[ -n $line ]] || continue
        text=${line%%$'\t'*} says=${line#*$'\t'}
        text=${text//:/\\:}
        [[ -z $says ]] || says=:$says
        if [[ $text == */ || $text == *= ]]; then part+=("$text$says"); else whole+=("$text$says"); fi
    done
    (( $#whole + $#part )) || { _files; return }
    (( ! $#whole )) || _describe -V benchctl whole
    (( ! $#part )) || _describe -V benchctl part -S ''
}
(( $+functions[compdef] )) || { autoload -Uz compinit && compinit -i }
compdef _benchctl benchctl
"""

_FISH = r"""# completion of benchctl for fish
function __benchctl_complete
    set -l word (commandline -ct)
    set -l found (env _BENCHCTL_COMPLETE=fish _BENCHCTL_WORD="$word" (commandline -opc) 2>/dev/null)
    if set -q found[1]
        printf '%s\n' $found
    else
        __fish_complete_path "$word"
    end
end
complete --command benchctl --no-files --keep-order --arguments '(__benchctl_complete)'
"""

_POWERSHELL = r"""# completion of benchctl for PowerShell
Register-ArgumentCompleter -Native -CommandName benchctl -ScriptBlock {
    param($wordToComplete, $commandAst, $cursorPosition)
    $words = @($commandAst.CommandElements | Select-Object -Skip 1 |
        Where-Object { $_.Extent.EndOffset -lt $cursorPosition } |
        ForEach-Object {
            if ($_ -is [System.Management.Automation.Language.StringConstantExpressionAst]) { $_.Value }
            else { $_.ToString() }
        })
    $env:_BENCHCTL_COMPLETE = 'powershell'
    $env:_BENCHCTL_WORD = $wordToComplete
    try {
        benchctl @words 2>$null | ForEach-Object {
            $text, $says = $_ -split "`t", 2
            if (-not $says) { $says = $text }
            $typed = if ($text -match '[\s''"$;&|(){}]') { "'" + $text.Replace("'", "''") + "'" } else { $text }
            [System.Management.Automation.CompletionResult]::new($typed, $text, 'ParameterValue', $says)
        }
    } finally {
        Remove-Item Env:_BENCHCTL_COMPLETE, Env:_BENCHCTL_WORD -ErrorAction SilentlyContinue
    }
}
"""

SHELLS = {"bash": _BASH, "zsh": _ZSH, "fish": _FISH, "powershell": _POWERSHELL, "pwsh": _POWERSHELL}


def script(shell: str = "") -> str:
    """What completes benchctl in a shell, by default the user's; `UsageError` for a shell that is none of `SHELLS`."""
    return SHELLS[_known(shell)].rstrip()


def install(shell: str = "") -> str:
    """Put the script where the shell finds it; says where, and from when on it works.

    Raises
    ------
    UsageError
        A shell that is none of `SHELLS`, a file that cannot be written, a PowerShell that cannot be asked.
    """
    name = _known(shell)
    try:
        places = _INSTALLERS[name](name)
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


def _home(variable: str, otherwise: str) -> Path:
    return Path(os.environ.get(variable) or Path.home() / otherwise)


def _write(name: str, ending: str) -> Path:
    file = _home("XDG_DATA_HOME", ".local/share") / "benchctl" / f"completion.{ending}"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(SHELLS[name], encoding="utf-8")
    return file


def _add_line(file: Path, line: str) -> None:
    text = file.read_text(encoding="utf-8") if file.exists() else ""
    if line not in text.splitlines():
        file.parent.mkdir(parents=True, exist_ok=True)
        with file.open("a", encoding="utf-8") as appended:
            appended.write(f"{'' if not text or text.endswith(chr(10)) else chr(10)}{line}\n")


def _for_bash(name: str) -> list[Path]:
    script_file, start = _write(name, "bash"), Path.home() / ".bashrc"
    _add_line(start, f"source '{script_file}'")
    return [script_file, start]


def _for_zsh(name: str) -> list[Path]:
    script_file, start = _write(name, "zsh"), _home("ZDOTDIR", "") / ".zshrc"
    _add_line(start, f"source '{script_file}'")
    return [script_file, start]


def _for_fish(name: str) -> list[Path]:
    file = _home("XDG_CONFIG_HOME", ".config") / "fish" / "completions" / "benchctl.fish"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(SHELLS[name], encoding="utf-8")
    return [file]


def _for_powershell(name: str) -> list[Path]:
    asking = [name, "-NoProfile", "-Command", "$PROFILE"]
    asked = subprocess.run(asking, capture_output=True, text=True, check=False)  # noqa: S603 - a shell named in SHELLS
    if asked.returncode or not asked.stdout.strip():
        raise UsageError(f"--install-completion {name}: {name} does not say where its profile is; add the script to it")
    script_file, start = _write(name, "ps1"), Path(asked.stdout.strip())
    _add_line(start, f". '{script_file}'")
    return [script_file, start]


_INSTALLERS: dict[str, Callable[[str], list[Path]]] = {
    "bash": _for_bash,
    "zsh": _for_zsh,
    "fish": _for_fish,
    "powershell": _for_powershell,
    "pwsh": _for_powershell,
}
