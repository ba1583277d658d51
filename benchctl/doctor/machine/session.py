"""Whether the end of this session would end a run: an SSH connection that is lost, a window that is closed."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator, Mapping

from benchctl.doctor.asked import answer, properties
from benchctl.doctor.finding import MACHINE, Finding, look, ok

_KEEP = "begin long runs inside tmux (tmux new -s bench), or with nohup benchctl run … &"


def session_findings(environment: Mapping[str, str] = os.environ) -> Iterator[Finding]:
    """What a logout, or a lost connection, would do."""
    if sys.platform == "win32":
        yield look(
            MACHINE,
            "session",
            "a run ends with its window, and with a logout (not tried on Windows by those who wrote this)",
            "leave the window open and the user logged in; lock the screen instead",
        )
        return
    ignored = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    yield session_finding(environment, sys.stdin.isatty() if sys.stdin else False, ignored)
    login = properties(answer("loginctl", "show-session", "-p", "KillUserProcesses"))
    if login.get("KillUserProcesses") == "yes":
        do = "loginctl enable-linger, and begin runs with: systemd-run --user --scope tmux new -s bench"
        yield look(MACHINE, "logout", "ends all programs of the user, tmux and nohup too (KillUserProcesses=yes)", do)


def session_finding(environment: Mapping[str, str], terminal: bool, hangup_ignored: bool) -> Finding:
    """What happens to a run that is begun here; `terminal`: someone sits at it."""
    remote = "SSH_CONNECTION" in environment or "SSH_TTY" in environment
    if hangup_ignored:
        return ok(MACHINE, "session", "hang-ups are ignored (nohup): a logout ends no run")
    if "TMUX" in environment or "STY" in environment:
        return ok(MACHINE, "session", f"inside {'tmux' if 'TMUX' in environment else 'screen'}: a logout ends no run")
    if remote:
        return look(
            MACHINE, "session", "over SSH: where the connection is lost, a run is brought to rest and ends", _KEEP
        )
    if terminal:
        return look(
            MACHINE, "session", "a terminal: a run is brought to rest and ends when its window is closed", _KEEP
        )
    return ok(MACHINE, "session", "no terminal, and no SSH: no logout ends a run")
