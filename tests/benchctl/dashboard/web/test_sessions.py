from benchctl.dashboard.web.sessions import IDLE_S, MOST_SESSIONS, Sessions


class Clock:
    """A clock that is set by hand."""

    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def test_a_session_is_found_by_its_secret_and_no_other() -> None:
    sessions = Sessions()
    secret, session = sessions.begin("viewer")
    other, _ = sessions.begin("operator")
    assert sessions.find(secret) is session
    assert sessions.find(other) is not session
    assert sessions.find("") is None
    assert sessions.find(secret[:-1]) is None


def test_a_session_that_was_ended_is_not_found_again() -> None:
    sessions = Sessions()
    secret, _ = sessions.begin("viewer")
    sessions.end(secret)
    sessions.end(secret)
    assert sessions.find(secret) is None


def test_a_session_is_over_once_it_was_idle_too_long_and_every_look_keeps_it() -> None:
    clock = Clock()
    sessions = Sessions(clock)
    secret, _ = sessions.begin("viewer")
    clock.now_s = 0.9 * IDLE_S
    assert sessions.find(secret) is not None
    clock.now_s = 1.8 * IDLE_S
    assert sessions.find(secret) is not None
    clock.now_s = 2.9 * IDLE_S
    assert sessions.find(secret) is None


def test_of_too_many_sessions_the_one_that_was_idle_for_longest_goes() -> None:
    clock = Clock()
    sessions = Sessions(clock)
    first, _ = sessions.begin("operator")
    second, _ = sessions.begin("viewer")
    clock.now_s = 1.0
    sessions.find(first)
    for _ in range(MOST_SESSIONS - 1):
        sessions.begin("viewer")
    assert sessions.find(first) is not None
    assert sessions.find(second) is None
