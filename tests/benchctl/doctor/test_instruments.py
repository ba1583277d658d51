import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from benchctl.bench import Bench, bench_of_text, template
from benchctl.campaign.opened import simulated_bench
from benchctl.doctor.finding import Finding
from benchctl.doctor.instruments import findings_of_instrument
from benchctl_instruments.catalog import Kind
from benchctl_instruments.links.address import parse_address
from benchctl_instruments.simulated.clock import ScaledClock
from tests.benchctl.doctor.benches import NOBODY, bench_at, server

needs_terminals = pytest.mark.skipif(sys.platform == "win32", reason="a pty is a thing of POSIX")
QUICK = {"options": {"timeout_s": 0.2}}


@contextmanager
def twins(**changes: dict[str, object]) -> Iterator[dict[str, str]]:
    """The simulated instruments, some of them of other models or with other options; their addresses."""
    by_themselves = {role: {"address": None, **changes.get(role, {})} for role in NOBODY}
    with simulated_bench(bench_at({}, **by_themselves), ScaledClock(1.0)) as running:
        yield running.addresses


def _asked(bench: Bench, role: Kind) -> list[Finding]:
    return list(findings_of_instrument(bench, role, parse_address(str(getattr(bench, role).address))))


def test_instruments_that_answer_as_the_bench_says_are_fine() -> None:
    with twins() as addresses:
        bench = bench_at(addresses)
        table, chamber = (_asked(bench, role) for role in ("rate_table", "chamber"))
        identity, stream = _asked(bench, "digitizer")
    assert [finding.verdict for finding in (*table, *chamber, identity, stream)] == ["ok"] * 4
    assert f"answers as watlow_f4t at {addresses['chamber']}: Watlow F4T1L1EAA1D1AAA" in chamber[0].message
    assert "serial 470012345" in identity.message
    assert stream.what == "stream"


def test_another_serial_number_than_the_benchs_is_another_instrument() -> None:
    with twins() as addresses:
        bench = bench_at(addresses, digitizer={"serial": "470099999"})
        identity, _ = _asked(bench, "digitizer")
    assert identity.verdict == "bad"
    assert identity.message.endswith("serial 470012345; the bench expects serial 470099999")
    assert "[digitizer]" in identity.do


def test_a_stream_port_that_refuses_is_found_where_the_other_port_is_fine() -> None:
    with twins() as addresses:
        identity, stream = _asked(bench_at({**addresses, "digitizer_stream": "tcp://127.0.0.1:4"}), "digitizer")
    assert (identity.verdict, stream.verdict) == ("ok", "bad")
    assert "127.0.0.1, port 4: the machine is there and refuses that port" in stream.message
    assert stream.do.endswith("labjack_t7 usually answers at port 502 or 702")


@pytest.mark.slow
def test_who_takes_a_connection_and_says_nothing_is_silent() -> None:
    with server(b"") as address:
        connection, answer = _asked(bench_at({"rate_table": address}, rate_table=QUICK), "rate_table")
    assert (connection.verdict, answer.verdict, answer.what) == ("ok", "bad", "answer")
    assert answer.message.startswith(f"silent: rate table at {address}: sent ':mode? 1', no answer within 0.2 s")
    assert answer.do.startswith("the line works, the instrument is silent: ")


@pytest.mark.slow
def test_rubbish_is_shown_and_taken_for_another_protocol() -> None:
    with server(b"\xde\xad\xbe\xef") as address:
        *_, identity = _asked(bench_at({"chamber": address}, chamber=QUICK), "chamber")
    assert (identity.verdict, identity.what) == ("bad", "identity")
    assert r"the received bytes are not of the protocol of watlow_f4t (b'\xde\xad\xbe\xef" in identity.message
    assert "compare speed, parity, protocol" in identity.do
    assert f"benchctl instrument probe {address} " in identity.do


def test_an_instrument_that_visa_does_not_reach_is_told_apart_from_a_silent_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pytest.importorskip("pyvisa_py", reason="PyVISA-py is not installed: pip install pyvisa-py")
    monkeypatch.setenv("PYVISA_LIBRARY", "@py")
    (answer,) = _asked(bench_at({"rate_table": "visa://GPIB0::7::INSTR"}, rate_table=QUICK), "rate_table")
    assert (answer.verdict, answer.what) == ("bad", "answer")
    assert answer.message.startswith("silent: rate table at visa://GPIB0::7::INSTR: cannot be opened: ")
    assert "that the VISA of this computer serves that interface (pyvisa-info shows it)" in answer.do


def test_a_labjack_at_the_chambers_address_is_named() -> None:
    with twins() as addresses:
        *_, identity = _asked(bench_at({**addresses, "chamber": addresses["digitizer"]}), "chamber")
    assert identity.verdict == "bad"
    assert identity.message.startswith("the device that answers is not watlow_f4t but a LabJack T7, serial 470012345: ")
    assert "are two addresses interchanged?" in identity.do


def test_another_table_of_another_maker_is_named() -> None:
    with twins() as addresses:
        *_, identity = _asked(bench_at(addresses, rate_table={"model": "aerotech_ensemble"} | QUICK), "rate_table")
    assert identity.message.startswith(
        "the device that answers is not aerotech_ensemble but one that answers as acutrol3000 does: "
    )


@needs_terminals
@pytest.mark.slow
def test_a_controller_with_another_unit_number_is_found_by_it() -> None:
    controller = {"model": "watlow_f4", "options": {"unit_id": 7}}
    with twins(chamber=controller) as addresses:
        expected = {"model": "watlow_f4", "options": {"timeout_s": 0.2}}
        (unit,) = _asked(bench_at(addresses, chamber=expected), "chamber")
    assert (unit.verdict, unit.what) == ("bad", "unit")
    assert unit.message.startswith("Modbus unit 1 is silent; unit 7 answers at serial:///dev/")
    assert unit.do == "[chamber.options] unit_id = 7, or set the controller's own address to 1"


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"options": {"unit": 3}}, "chamber.options: watlow_f4t has no option 'unit': did you mean unit_id?"),
        ({"model": "watlow_f4x"}, "there is no 'watlow_f4x': did you mean watlow_f4?"),
    ],
)
def test_a_description_that_no_driver_takes_is_the_inputs_fault(change: dict[str, object], says: str) -> None:
    (finding,) = _asked(bench_at({}, chamber=change), "chamber")
    assert (finding.verdict, finding.unusable, finding.what) == ("bad", True, "description")
    assert says in finding.message


def test_an_option_of_the_wrong_kind_is_the_inputs_fault_however_late_it_shows() -> None:
    with twins() as addresses:
        bench = bench_at(addresses, rate_table={"options": {"reply_terminator": 5}})
        (finding,) = _asked(bench, "rate_table")
    assert finding.verdict == "bad"
    assert "rate_table.options" in f"{finding.message} {finding.do}".replace("[", "").replace("]", "")


@needs_terminals
@pytest.mark.slow
@pytest.mark.parametrize(
    ("there", "said"),
    [
        ("binder_mb1", "binder_mb2"),
        ("binder_mb2", "csz_ezt430i"),
        ("csz_ezt430i", "watlow_f4"),
        ("espec_p300", "watlow_f4t"),
        ("eurotherm_2400", "binder_mb2"),
        ("eurotherm_3500", "eurotherm_2400"),
        ("watlow_f4", "watlow_f4t"),
        ("watlow_f4t", "espec_p300"),
        ("thermotron_3800", "thermotron_8800"),
        ("thermotron_8800", "thermotron_3800"),
        ("weiss_ascii2", "espec_p300"),
        ("weiss_simserv", "weiss_ascii2"),
    ],
)
def test_every_chamber_is_recognised_where_another_is_expected(there: str, said: str) -> None:
    with twins(chamber={"model": there}) as addresses:
        *_, identity = _asked(bench_at(addresses, chamber={"model": said}), "chamber")
    assert identity.verdict == "bad"
    assert f"one that answers as {there} does" in identity.message


@pytest.mark.slow
def test_a_controller_that_was_away_for_a_while_is_told_from_one_of_another_unit() -> None:
    away = '[[faults]]\non = "chamber"\nkind = "pulled_cable"\nfor_s = 1.0\nnth = 1\n'
    bench = bench_of_text(template() + away, "bench.toml")
    with simulated_bench(bench, ScaledClock(1.0)) as running:
        there = bench_at(running.addresses, chamber={"options": {"timeout_s": 0.1}})
        *_, answer = _asked(there, "chamber")
    assert (answer.verdict, answer.what) == ("bad", "answer")
    assert answer.message.startswith("answers now, but did not before: Watlow F4T at ")
    assert "timeout_s" in answer.do
