import os
import signal

import pytest

from benchctl.campaign.stop import StoppedError, StopRequest, stop_on_signals


@pytest.mark.parametrize(("number", "says"), [(signal.SIGINT, "Ctrl-C"), (signal.SIGTERM, "SIGTERM")])
def test_a_signal_is_noted_and_heeded_later(number: signal.Signals, says: str) -> None:
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


def test_handlers_are_put_back() -> None:
    before = signal.getsignal(signal.SIGTERM)
    with stop_on_signals():
        assert signal.getsignal(signal.SIGTERM) is not before
    assert signal.getsignal(signal.SIGTERM) is before
