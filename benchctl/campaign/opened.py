"""Open the instruments of a bench.toml: real ones, simulated ones over their protocols, or simulated ones without."""

from __future__ import annotations

import inspect
import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, cast

import tomli_w

from benchctl.bench import Bench
from benchctl.bench_instruments import InstrumentEntry
from benchctl.campaign.operator import NoOperator, Operator, SimulatedOperator, operator_at_terminal, request_turn
from benchctl.campaign.reserved import reserved
from benchctl.closeness import meant
from benchctl.processors import on_one_processor
from benchctl_instruments.catalog import Kind, counts_encoder, driver
from benchctl_instruments.digitizers.table_angle import TableAngleDigitizer
from benchctl_instruments.errors import BenchError, BenchNotReadyError, UsageError
from benchctl_instruments.interfaces import Chamber, Clock, Digitizer, Gyro, Identity, Instrument, RateTable
from benchctl_instruments.physics.effects.effect import PhysicalEffect
from benchctl_instruments.physics.effects.making import make_effects
from benchctl_instruments.physics.three_axes import ThreeAxisParameters
from benchctl_instruments.rate_tables.manual import ManualTable, WatchedDigitizer
from benchctl_instruments.simulated.bench import SimulatedBench, twin_keywords
from benchctl_instruments.simulated.clock import ScaledClock, VirtualClock
from benchctl_instruments.simulated.direct import DirectChamber, DirectDigitizer, DirectRateTable
from benchctl_instruments.simulated.sensor import sensor_of
from benchctl_instruments.simulated.settings import WorldSettings
from benchctl_instruments.simulated.world import World

FASTEST = 2.0
"""A change of the encoder's count that is faster than this multiple of the bench's rate limit is not motion."""

NO_OPERATOR = NoOperator()


@dataclass(frozen=True, slots=True, kw_only=True)
class OpenBench:
    """A bench whose instruments have answered.

    `epoch_s` is the clock at the start of the recording, `elapsed_s` the time in the recording at which the digitizer's
    own counter was at zero; `reached` states how the instruments were reached. `simulated` are the servers, if they run
    in this process. `gyro` is the digital gyro, if the bench has one. `operator` performs the operator actions.
    """

    bench: Bench
    table: RateTable
    chamber: Chamber
    digitizer: Digitizer
    clock: Clock
    epoch_s: float
    reached: str
    identities: Mapping[str, Identity]
    elapsed_s: float = 0.0
    simulated: SimulatedBench | None = None
    gyro: Gyro | None = None
    operator: Operator = NO_OPERATOR


@contextmanager
def open_bench(
    bench: Bench, *, wires: bool = True, elapsed_s: float = 0.0, purpose: str = "benchctl"
) -> Iterator[OpenBench]:
    """Open every instrument of a bench, and close them all at the end.

    `wires=False` opens the simulated instruments without their protocols: the same physics, for fast simulations. With
    wires they take turns with this thread, which is kept on one processor meanwhile, if Linux allows it. `elapsed_s` is
    the bench time since the start of a recording that is resumed. Instruments at addresses are reserved for this
    process meanwhile; `purpose` is shown to other processes. Opening does not command any instrument.

    Raises
    ------
    BenchInUseError
        Another process has an instrument; nothing has been sent to any instrument.
    BenchNotReadyError
        Lists every instrument that did not answer, and why.
    """
    with ExitStack() as stack:
        simulated: SimulatedBench | None = None
        abandoned: frozenset[str] = frozenset()
        if not bench.simulated:
            reached = "at their addresses"
            abandoned = stack.enter_context(reserved(bench, purpose))
            clock: Clock = ScaledClock(bench.time_factor)
            operator = operator_at_terminal(bench)
            instruments = drivers_at(bench, clock, {})
        elif wires:
            reached = "simulated, over their wires"
            virtual = VirtualClock()
            stack.enter_context(on_one_processor())
            simulated = stack.enter_context(simulated_bench(bench, virtual))
            clock, instruments = virtual, drivers_at(bench, virtual, simulated.addresses)
            operator = SimulatedOperator(simulated.world)
        else:
            if bench.gyro is not None:
                raise UsageError("gyro: it sends over a wire, and this simulation does without; leave [gyro] out")
            if bench.faults:
                raise UsageError("faults: they happen on wires, and this simulation does without; leave [[faults]] out")
            reached = "simulated, without wires"
            virtual = VirtualClock()
            settings = world_settings(bench)
            world = World(virtual, settings, effects_of(bench, settings))
            clock, operator = virtual, SimulatedOperator(world)
            instruments = {
                "rate_table": DirectRateTable(world),
                "chamber": DirectChamber(world),
                "digitizer": DirectDigitizer(world, adc_range_v=bench.digitizer.adc_range_v),
            }
            if bench.by_hand:
                instruments |= _turned_by_hand(bench, clock, instruments["digitizer"])
        if isinstance(table := instruments["rate_table"], ManualTable):
            table.operator = partial(operator.turn, meanwhile=lambda: None) if bench.simulated else request_turn
        identities = _open_all(stack, instruments, bench)
        if "digitizer" in abandoned:
            instruments["digitizer"].stop_stream()  # left streaming by a killed run on this machine
        yield OpenBench(
            bench=bench,
            table=instruments["rate_table"],
            chamber=instruments["chamber"],
            digitizer=instruments["digitizer"],
            clock=clock,
            epoch_s=clock.now() - elapsed_s,
            reached=reached,
            identities=identities,
            elapsed_s=elapsed_s,
            simulated=simulated,
            gyro=instruments.get("gyro"),
            operator=operator,
        )


def simulated_bench(bench: Bench, clock: VirtualClock | ScaledClock, **options: Any) -> SimulatedBench:
    """Return the simulated twin of a bench, not yet started: wired as its drivers expect, with further `options`."""
    settings = world_settings(bench)
    return SimulatedBench(
        settings,
        clock,
        rate_table=bench.rate_table.model,
        chamber=bench.chamber.model,
        chamber_profile=bench.chamber_profile,
        digitizer=bench.digitizer.model,
        effects=effects_of(bench, settings),
        options=_wired(bench, options),
        faults=bench.faults,
        gyro=None if bench.gyro is None else bench.gyro.model,
    )


def _wired(bench: Bench, more: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    kinds: tuple[Kind, ...] = ("rate_table", "chamber", "digitizer", *(("gyro",) if bench.gyro else ()))
    found: dict[str, dict[str, Any]] = {}
    for kind in kinds:
        entry: InstrumentEntry = getattr(bench, kind)
        profile = bench.chamber_profile if kind == "chamber" else ""
        wired = twin_keywords(kind, entry.model, options=entry.options, address=entry.address, profile=profile)
        found[kind] = wired | more.get(kind, {})
    if bench.gyro is not None:
        found["gyro"]["rate_hz"] = bench.gyro.frame_rate_hz
    return found


def world_settings(bench: Bench) -> WorldSettings:
    """Return the settings of the simulated world: `[physics]`, made consistent with the bench's other tables."""
    settings = WorldSettings.from_mapping(bench.physics, where="physics")
    if bench.gyro is not None and bench.gyro.axes == 3 and settings.three_axes is None:
        settings = replace(settings, three_axes=ThreeAxisParameters())
    entry, site = bench.digitizer, bench.site
    stated = {name: getattr(settings.encoder, name) for name in bench.physics.get("encoder", {})}
    known = {**stated, "counts_per_rev": entry.encoder_counts_per_rev, "sign": entry.encoder_sign}
    drawn = settings.drawn(settings.seed)
    return replace(
        drawn,
        encoder=replace(drawn.encoder, **known),
        latitude_deg=settings.latitude_deg if site.latitude_deg is None else site.latitude_deg,
        thermistor_v_per_c=1.0 / entry.thermistor_c_per_v,
        thermistor_offset_v=-entry.thermistor_c_at_0v / entry.thermistor_c_per_v,
    )


_ENCODER_PHASES = ("eccentricity_phase_deg", "ellipticity_phase_deg")
"""How the encoder is mounted; drawn from the seed if bench.toml does not state it."""


def another_day(bench: Bench, days: int) -> Bench:
    """Return the same simulated bench, unit and encoder, with new noise drawn from seed + days."""
    world = world_settings(bench)
    mounted = {**bench.physics.get("encoder", {}), **{name: getattr(world.encoder, name) for name in _ENCODER_PHASES}}
    physics = {**bench.physics, "seed": world.seed + days, "encoder": mounted}
    return bench.model_copy(update={"physics": physics})


def as_drawn(bench: Bench, physics: Mapping[str, Any]) -> Bench:
    """Return a simulated bench with the seed of other physics, and their encoder mounting unless it states its own."""
    there = {name: phase for name, phase in physics.get("encoder", {}).items() if name in _ENCODER_PHASES}
    mounted = there | bench.physics.get("encoder", {})
    drawn = {**({"seed": physics["seed"]} if "seed" in physics else {}), **({"encoder": mounted} if mounted else {})}
    return bench.model_copy(update={"physics": {**bench.physics, **drawn}})


def effects_of(bench: Bench, settings: WorldSettings) -> tuple[PhysicalEffect, ...]:
    """Return the bench's `[effects]`, set up with values from its world and its other tables."""
    entry, sensor = bench.digitizer, sensor_of(settings)
    circumstances = {
        "T0_c": sensor.T0_c,
        "range_dps": bench.unit.range_dps,
        "noise_v_rms": sensor.white_v(1.0 / entry.sample_rate_hz),
        "adc_step_v": entry.adc_step_v,
        "seed": settings.seed,
    }
    return make_effects(bench.effects, circumstances)


def drivers_at(bench: Bench, clock: Clock, addresses: Mapping[str, str]) -> dict[str, Any]:
    """Return the drivers of a bench, not yet opened, at these or their own addresses; `UsageError` for bad options."""
    wired = [name for name in bench.entries if name != "rate_table" or not bench.by_hand]
    found: dict[str, Any] = {kind: driver_at(bench, cast("Kind", kind), clock, addresses) for kind in wired}
    if bench.by_hand:
        return found | _turned_by_hand(bench, clock, found["digitizer"])
    if not counts_encoder(bench.digitizer.model):
        found["digitizer"] = TableAngleDigitizer(
            found["digitizer"], found["rate_table"], clock=clock, degrees_per_count=bench.digitizer.degrees_per_count
        )
    return found


def _turned_by_hand(bench: Bench, clock: Clock, digitizer: Digitizer) -> dict[str, Any]:
    """Return the driver of a manual table, and the digitizer that measures its motion."""
    watched = WatchedDigitizer(digitizer, clock=clock, degrees_per_count=bench.digitizer.degrees_per_count)
    table = _driver("rate_table", bench.rate_table, clock, {}, {"encoder": watched})
    return {"rate_table": table, "digitizer": watched}


def driver_at(bench: Bench, kind: Kind, clock: Clock, addresses: Mapping[str, str]) -> Any:
    """Return one driver of a bench, not yet opened, as `drivers_at` does."""
    more: dict[str, Any] = {}
    if kind == "digitizer":
        entry = bench.digitizer
        more = {"range_v": entry.adc_range_v}
        if counts_encoder(entry.model):
            more["fastest_counts_per_s"] = FASTEST * bench.limits.rate_dps / 360.0 * entry.encoder_counts_per_rev
        stream = addresses.get("digitizer_stream", entry.stream_address)
        if stream is not None:
            more["stream_address"] = stream
    profile = bench.chamber_profile if kind == "chamber" else ""
    if kind == "gyro" and bench.gyro is not None:
        model, asked_hz = bench.gyro.model, bench.gyro.frame_rate_hz
        rates_hz: tuple[float, ...] = getattr(driver(kind, model), "RATES_HZ", ())
        if rates_hz and asked_hz not in rates_hz:
            known = ", ".join(f"{rate_hz:g}" for rate_hz in rates_hz)
            raise UsageError(f"gyro.frame_rate_hz = {asked_hz:g}: expected a rate of a {model}, {known} Hz")
    return _driver(kind, getattr(bench, kind), clock, addresses, more, profile)


def _driver(
    kind: Kind,
    entry: InstrumentEntry,
    clock: Clock,
    addresses: Mapping[str, str],
    more: Mapping[str, Any],
    profile: str = "",
) -> Any:
    make: Callable[..., Any] = driver(kind, entry.model, profile)
    takes = inspect.signature(make).parameters
    if not any(each.kind is each.VAR_KEYWORD for each in takes.values()):
        known = [
            name for name, each in takes.items() if each.kind is each.KEYWORD_ONLY and name not in ("clock", *more)
        ]
        for name in entry.options.keys() - takes.keys():
            raise UsageError(f"{kind}.options: {entry.model} has no option {name!r}: {meant(name, known)}")
    try:
        return make(addresses.get(kind, entry.address), clock=clock, **more, **entry.options)
    except UsageError as err:
        raise UsageError(f"{kind}: {err}") from err
    except (AttributeError, TypeError, ValueError) as err:
        raise UsageError(f"{kind}.options: {entry.model} cannot be made with them: {err}") from err


def _open_all(stack: ExitStack, instruments: Mapping[str, Instrument], bench: Bench) -> dict[str, Identity]:
    failures: dict[str, BenchError] = {}
    identities: dict[str, Identity] = {}
    for name, instrument in instruments.items():
        try:
            stack.enter_context(instrument)
            identities[name] = instrument.identify()
        except BenchError as err:
            failures[name] = err
        except (AttributeError, TypeError, ValueError) as err:
            entry: InstrumentEntry = getattr(bench, name)
            if not entry.options:
                raise
            failures[name] = UsageError(f"{entry.model} cannot be opened with {name}.options {entry.options}: {err}")
    if failures:
        raise BenchNotReadyError(failures)
    return identities


_LEFT_OUT = ("physics", "effects", "faults", "notify")


def bench_toml_at(bench: Bench, addresses: Mapping[str, str], speed: float) -> str:
    """Return the bench's own text with the servers' addresses and without tables that only a simulation has.

    `[notify]`, whose URLs are masked in the text, is left out, too. `speed` is bench seconds per wall second.
    """
    document = tomllib.loads(bench.text)
    document |= {"simulated": False, "time_factor": speed}
    for table in _LEFT_OUT:
        document.pop(table, None)
    for name in bench.entries:
        if name != "rate_table" or not bench.by_hand:
            document[name]["address"] = addresses[name]
    document["chamber"]["model"] = bench.chamber.model  # a profile's full path: the new file may be in another folder
    if "digitizer_stream" in addresses:
        document["digitizer"]["stream_address"] = addresses["digitizer_stream"]
    return tomli_w.dumps(document)
