import os
import signal
import sys
from collections.abc import Iterator

import pytest

from benchctl.campaign.stop import StoppedError, StopRequest, stop_on_signals

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGHUP")


@pytest.fixture(autouse=True)
def _handlers() -> Iterator[None]:
    """The handlers of the tests' own process, whatever becomes of them."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize(
    ("number", "says"), [(signal.SIGINT, "Ctrl-C"), (signal.SIGTERM, "SIGTERM"), (signal.SIGHUP, "SIGHUP")]
)
def test_a_signal_is_noted_and_heeded_later(number: signal.Signals, says: str) -> None:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # the tests may run under nohup
    with stop_on_signals() as request:
        request.heed()
        os.kill(os.getpid(), number)
        with pytest.raises(StoppedError, match=f"stopped by {says}"):
            request.heed()


def test_the_first_reason_stays() -> None:
    request = StopRequest()
    request.ask("Ctrl-C")
    request.ask("SIGTERM")
    assert request.reason == "Ctrl-C"


def test_who_has_asked_once_changes_nothing_by_asking_again_until_the_program_has_ended() -> None:
    with stop_on_signals() as request:
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGTERM)
        assert request.reason == "Ctrl-C"
    os.kill(os.getpid(), signal.SIGINT)
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_IGN


def test_a_caller_that_goes_on_hears_signals_again() -> None:
    before = signal.getsignal(signal.SIGINT)
    with stop_on_signals(deaf_after=False) as request:
        os.kill(os.getpid(), signal.SIGINT)
        assert request.reason == "Ctrl-C"
    assert signal.getsignal(signal.SIGINT) is before


def test_a_run_under_nohup_goes_on_when_its_terminal_goes() -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with stop_on_signals() as request:
        os.kill(os.getpid(), signal.SIGHUP)
        assert request.reason == ""


def test_handlers_are_put_back() -> None:
    before = signal.getsignal(signal.SIGTERM)
    with stop_on_signals():
        assert signal.getsignal(signal.SIGTERM) is not before
    assert signal.getsignal(signal.SIGTERM) is before
