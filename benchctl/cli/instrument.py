"""`benchctl instrument`: ask an unknown device what it is, and write the start of a driver."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from benchctl.cli.output import JsonOption, QuietOption, Result, result_of

if TYPE_CHECKING:
    from benchctl_instruments.probe import Inquiry

_MOST_SHOWN = 48
_WIDEST = 40


def instrument() -> None:
    """Ask an unknown device which drivers recognise it, or write a package with a new driver to fill in.

    Example: `benchctl instrument probe serial:///dev/ttyUSB0?baud=9600`, `benchctl instrument new chamber acme_9000`
    """


def probe(
    address: Annotated[
        str,
        typer.Argument(metavar="ADDRESS", help="As in bench.toml: tcp://host:502 or serial:///dev/ttyUSB0?baud=9600."),
    ],
    timeout_s: Annotated[
        float, typer.Option("--timeout", metavar="SECONDS", min=0.01, help="Time limit of each answer.")
    ] = 1.0,
    unit: Annotated[int, typer.Option("--unit", metavar="N", min=1, max=247, help="Number of the Modbus unit.")] = 1,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Ask an unknown device which drivers recognise it; read only.

    It listens, asks `*IDN?` and the identification queries of all drivers, and reads Modbus registers. It shows each
    question and answer, and the lines of bench.toml for the drivers that match, best first. A serial address without a
    speed is tried at the speed of each driver. Exit status 0: recognised; 2: it answers, and no driver recognises it;
    3: nothing answers.

    Example: `benchctl instrument probe serial:///dev/ttyUSB0?baud=9600`
    """
    with result_of("instrument", json_to, quiet) as result:
        _probe(result, address, timeout_s, unit)


def new(
    kind: Annotated[str, typer.Argument(metavar="KIND", help="The kind of instrument: chamber.")],
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the driver, such as acme_9000.")],
    protocol: Annotated[
        Literal["modbus", "lines"], typer.Option(help="Modbus by a profile, or lines of ASCII in Python.")
    ] = "modbus",
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FOLDER", help="The folder to write; default: NAME.")
    ] = None,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Write a package with a new driver to fill in.

    It contains a driver, its simulated instrument, a test that passes without changes, and the entry points by which
    benchctl finds both after `pip install -e NAME`. For a Modbus controller only the profile, a TOML file, is to be
    filled in.

    Example: `benchctl instrument new chamber acme_9000`
    """
    with result_of("instrument", json_to, quiet) as result:
        _new(result, kind, name, Path(name) if output is None else output, protocol)


COMMANDS = (probe, new)


def _probe(result: Result, address: str, timeout_s: float, unit: int) -> None:
    from benchctl.app import probe as app

    shown_at = ""

    def show(exchange: Inquiry) -> None:
        nonlocal shown_at
        if exchange.address != shown_at:
            shown_at = exchange.address
            result.say(shown_at)
        result.say(f"  {exchange.question:<{_WIDEST}}  {exchange.answer}")
        for mark, data in ((">", exchange.sent), ("<", exchange.received)):
            if data:
                result.say(f"  {'':<{_WIDEST}}    {mark} {_shown(data)}")

    probed = app.probe(address, unit_id=unit, timeout_s=timeout_s, tell=show)
    result.values["exchanges"] = [
        {
            "address": each.address,
            "question": each.question,
            "answer": each.answer,
            "sent": each.sent.hex(" "),
            "received": each.received.hex(" "),
        }
        for each in probed.exchanges
    ]
    result.values["matches"] = [
        {
            "kind": match.kind,
            "model": match.model,
            "certainty": match.certainty,
            "device": match.device,
            "address": match.address,
            "bench_toml": "\n".join(app.bench_lines(match)),
        }
        for match in probed.matches
    ]
    probed.require_match(address)
    for match in probed.matches:
        result.say(f"\n{match.model} ({match.kind.replace('_', ' ')}), {match.certainty}: {match.device}")
        for line in app.bench_lines(match):
            result.say(f"  {line}")


def _shown(data: bytes) -> str:
    """Return bytes as text if they are lines of ASCII, otherwise in hexadecimal."""
    shown, more = data[:_MOST_SHOWN], len(data) - _MOST_SHOWN
    is_text = shown.isascii() and shown.decode("ascii").replace("\r", "").replace("\n", "").isprintable()
    return (repr(shown)[1:] if is_text else shown.hex(" ")) + (f" and {more} bytes more" if more > 0 else "")


def _new(result: Result, kind: str, name: str, folder: Path, protocol: Literal["modbus", "lines"]) -> None:
    from benchctl.app.new_instrument import new_instrument

    paths = new_instrument(kind, name, folder, protocol)
    result.values |= {"folder": folder, "files": paths}
    to_fill = folder / name / (f"{name}.toml" if protocol == "modbus" else "driver.py")
    result.say(f"wrote {folder}: fill in {to_fill} from the manual")
    steps = {
        f"pytest {folder}": "passes without changes, over a real connection to its simulated instrument",
        f"pip install -e {folder}": f'then model = "{name}" under [{kind}] of bench.toml',
        "benchctl help new_driver": "from the manual to a campaign",
    }
    width = max(map(len, steps))
    for command, purpose in steps.items():
        result.say(f"{command:<{width}}  # {purpose}")
