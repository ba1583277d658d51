"""`benchctl instrument`: ask an unknown device what it is, and write the start of a driver."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from benchctl.cli.output import JsonOption, QuietOption, Result, result_of

if TYPE_CHECKING:
    from benchctl_instruments.probe import Inquiry

_MOST_SHOWN = 48
_WIDEST = 40


def instrument(
    action: Annotated[
        Literal["probe", "new"],
        typer.Argument(metavar="ACTION", help="probe: ask a device what it is; new: write the start of a driver."),
    ],
    words: Annotated[
        list[str],
        typer.Argument(
            metavar="WORD",
            help="probe: the ADDRESS as in bench.toml, tcp://host:502 or serial:///dev/ttyUSB0?baud=9600. "
            "new: KIND and NAME, chamber acme_9000.",
        ),
    ],
    timeout: Annotated[
        float | None,
        typer.Option("--timeout", metavar="SECONDS", min=0.01, help="probe: for each answer.  [default: 1]"),
    ] = None,
    unit: Annotated[
        int | None,
        typer.Option("--unit", metavar="N", min=1, max=247, help="probe: number of the Modbus unit.  [default: 1]"),
    ] = None,
    protocol: Annotated[
        Literal["modbus", "lines"] | None,
        typer.Option(help="new: Modbus by a profile, or lines of ASCII in Python.  [default: modbus]"),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FOLDER", help="new: the folder to write.  [default: NAME]")
    ] = None,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Ask an unknown device which drivers recognise it, or write a package with a new driver to fill in.

    `probe` only reads: it listens, asks `*IDN?` and the identification queries of all drivers, and reads Modbus
    registers; it shows each question and answer, and the lines of bench.toml for the drivers that match, best first.
    A serial address without a speed is tried at the speed of each driver. Exit status 0: recognised; 2: it answers,
    and no driver recognises it; 3: nothing answers.

    `new chamber NAME` writes a driver, its simulated instrument, a test that passes without changes, and the entry
    points by which benchctl finds both after `pip install -e NAME`. For a Modbus controller only the profile, a TOML
    file, is to be filled in.

    Example: `benchctl instrument probe serial:///dev/ttyUSB0?baud=9600`, `benchctl instrument new chamber acme_9000`
    """
    from benchctl_instruments.errors import UsageError

    with result_of("instrument", json_to, quiet) as result:
        owners: dict[str, tuple[str, Any]] = {
            "--timeout": ("probe", timeout),
            "--unit": ("probe", unit),
            "--protocol": ("new", protocol),
            "--output": ("new", output),
        }
        for name, (owner, given) in owners.items():
            if given is not None and owner != action:
                raise UsageError(f"{name}: is for instrument {owner}; leave it out of instrument {action}")
        match action, words:
            case "probe", [address]:
                _probe(result, address, 1.0 if timeout is None else timeout, unit or 1)
            case "new", [kind, name]:
                _new(result, kind, name, Path(name) if output is None else output, protocol or "modbus")
            case _:
                expected = "one ADDRESS" if action == "probe" else "KIND and NAME, for example chamber acme_9000"
                raise UsageError(f"instrument {action} {' '.join(words)}: expected {expected}")


def _probe(result: Result, address: str, timeout_s: float, unit: int) -> None:
    from benchctl.app.probe import bench_lines, probe

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

    probed = probe(address, unit_id=unit, timeout_s=timeout_s, tell=show)
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
            "bench_toml": "\n".join(bench_lines(match)),
        }
        for match in probed.matches
    ]
    probed.require_match(address)
    for match in probed.matches:
        result.say(f"\n{match.model} ({match.kind.replace('_', ' ')}), {match.certainty}: {match.device}")
        for line in bench_lines(match):
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
