from __future__ import annotations

import threading

from benchctl_instruments.links.wirelog import WireEntry, WireLog


def test_only_the_last_entries_are_kept_oldest_first() -> None:
    log = WireLog(size=3)
    for number in range(5):
        log.sent(b"%d" % number)

    assert [entry.data for entry in log.last(10)] == [b"2", b"3", b"4"]
    assert [entry.data for entry in log.last(1)] == [b"4"]
    assert log.last(0) == []


def test_of_a_long_packet_the_beginning_and_the_length_are_kept() -> None:
    log = WireLog(entry_bytes=4)
    log.received(b"abcdefgh")

    (entry,) = log.last(1)
    assert (entry.data, entry.length) == (b"abcd", 8)
    assert str(entry).endswith("< b'abcd' and 4 bytes more")


def test_a_tail_is_one_line_that_shows_directions() -> None:
    log = WireLog()
    log.note("connected")
    log.sent(b":mode? 1\r\n")
    log.received(b"00000001Rate\r\n")

    tail = log.tail(3)
    assert "\n" not in tail
    assert tail.index("- connected") < tail.index(r"> b':mode? 1\r\n'") < tail.index(r"< b'00000001Rate\r\n'")


def test_an_empty_log_says_so() -> None:
    assert WireLog().tail() == "nothing yet"


def test_the_sink_sees_every_entry_even_those_that_the_ring_forgets() -> None:
    seen: list[WireEntry] = []
    log = WireLog(size=1, sink=seen.append)
    log.sent(b"a")
    log.received(b"b")

    assert [(entry.direction, entry.data) for entry in seen] == [("sent", b"a"), ("received", b"b")]
    assert seen[0].time_s <= seen[1].time_s


def test_threads_lose_no_entry() -> None:
    seen: list[WireEntry] = []
    log = WireLog(size=10, sink=seen.append)

    def write() -> None:
        for _ in range(200):
            log.sent(b"x")

    threads = [threading.Thread(target=write) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()

    assert len(seen) == 800
    assert len(log.last(100)) == 10
