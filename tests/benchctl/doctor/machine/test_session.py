import sys

import pytest

from benchctl.doctor.machine.session import session_finding, session_findings


@pytest.mark.parametrize(
    ("environment", "terminal", "ignored", "verdict", "says"),
    [
        ({"SSH_CONNECTION": "1.2.3.4 5 6.7.8.9 22"}, True, False, "look", "over SSH"),
        ({"SSH_TTY": "/dev/pts/1", "TMUX": "/tmp/x,1,0"}, True, False, "ok", "inside tmux"),
        ({"STY": "1.pts-0.lab"}, True, False, "ok", "inside screen"),
        ({"SSH_CONNECTION": "x"}, True, True, "ok", "nohup"),
        ({}, True, False, "look", "window is closed"),
        ({}, False, False, "ok", "no terminal"),
    ],
)
def test_what_the_end_of_a_session_would_do_is_told(
    environment: dict[str, str], terminal: bool, ignored: bool, verdict: str, says: str
) -> None:
    finding = session_finding(environment, terminal, ignored)
    assert (finding.verdict, says in finding.says) == (verdict, True)
    assert bool(finding.do) == (verdict == "look")


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no hang-ups")
def test_a_session_over_ssh_is_seen_in_its_environment() -> None:
    assert next(session_findings({"SSH_CONNECTION": "x", "TMUX": "y"})).says.startswith("inside tmux")
