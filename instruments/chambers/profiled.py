"""A chamber with any Modbus controller that a profile describes; see `profile` for what profiles declare.

Fault handling: link faults as in `links.modbus.ModbusLink`, and writes that toggle a state are never repeated. An
exception, an over-range code, a latched fault and a written value that does not arrive raise `InstrumentError`; every
reading includes the alarms. A single reading does not show air that is stuck or stalls short of the set point; a soak
that does not end shows it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, Self

from benchctl_instruments.chambers.modbus_chamber import LOOK_AGAIN_S, ModbusChamber, Quantity
from benchctl_instruments.chambers.profile import MOST_DECIMALS, Condition, Number, Profile, changed
from benchctl_instruments.chambers.profiled_table import (
    ADVICE,
    NOWHERE,
    ProfiledQuantity,
    ProfiledTable,
    code,
    conditioning_of,
    quantity_of,
)
from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.interfaces import ChamberReading, Clock, Identity
from benchctl_instruments.links.address import parse_address
from benchctl_instruments.links.modbus import DEFAULT_BAUD, ModbusLink, Retry
from benchctl_instruments.links.wirelog import WireLog
from benchctl_instruments.protocols.modbus import WordOrder
from benchctl_instruments.recognition import ByRegisters


class ProfiledChamber(ModbusChamber):
    """Driver of a chamber as its profile describes it. Not tried on hardware.

    Parameters
    ----------
    address
        `serial://DEVICE?baud=9600` or `socket://HOST:PORT` for Modbus RTU, `tcp://HOST:PORT` for Modbus TCP. A serial
        address without a speed uses the profile's.
    profile
        The controller's profile.
    clock
        The clock used for waiting.
    changes
        Fields of the profile to replace, in its own tables: `{"switch": {"bit": 1}}`.
    word_order, unit_id, pause_s, timeout_s
        Replace the profile's values.
    retry, wire_log
        See `ModbusLink`.
    """

    def __init__(
        self,
        address: str,
        *,
        profile: Profile,
        clock: Clock,
        changes: Mapping[str, Any] | None = None,
        word_order: WordOrder | None = None,
        unit_id: int | None = None,
        pause_s: float | None = None,
        timeout_s: float | None = None,
        retry: Retry | None = None,
        wire_log: WireLog | None = None,
    ) -> None:
        if changes is not None:
            profile = changed(profile, changes, "chamber.options.changes")
        if word_order is not None:
            profile = changed(profile, {"transport": {"word_order": word_order}}, "chamber.options")
        transport = profile.transport
        link = ModbusLink(
            _with_baud(address, transport.baud),
            unit_id=transport.unit_id if unit_id is None else unit_id,
            name=profile.name,
            timeout_s=transport.timeout_s if timeout_s is None else timeout_s,
            retry=retry,
            pause_s=transport.pause_s if pause_s is None else pause_s,
            clock=clock,
            wire_log=wire_log,
        )
        self._set_up(link, profile, clock)

    @classmethod
    def over(cls, link: ModbusLink, profile: Profile, clock: Clock) -> Self:
        """Return a driver over a link that its caller opens and closes."""
        made = cls.__new__(cls)
        cls._set_up(made, link, profile, clock)
        return made

    def _set_up(self, link: ModbusLink, profile: Profile, clock: Clock) -> None:
        self._profile = profile
        self._clock = clock
        setpoint = quantity_of(profile.setpoint, "set point", "°C", profile=profile, writable=True)
        low_limit, high_limit, kept = _limits_of(profile, setpoint)
        self._registers = ProfiledTable(link, clock=clock, profile=profile, kept=kept)
        super().__init__(link, self._registers, setpoint=setpoint, low_limit=low_limit, high_limit=high_limit)
        self._also = [replace(setpoint, address=address) for address in profile.setpoint.also]
        self._taken = self._shown(profile.setpoint.taken, "set point taken over", "°C")
        self._run = profile.setpoint.run
        self._sent_c: float | None = None  # the last set point that this driver sent
        self._air = quantity_of(profile.air, "air temperature", "°C", profile=profile)
        self._power = self._shown(profile.power, "power", "%")
        self._heating = self._shown(profile.heating, "heating", "%")
        self._cooling = self._shown(profile.cooling, "cooling", "%")
        self._conditioning = conditioning_of(profile, self._registers)
        self._obeyed = setpoint if self._taken is None else self._taken
        powers = [quantity for quantity in (self._power, self._heating, self._cooling) if quantity is not None]
        self._reading = (self._air, self._obeyed, *powers, *_registers(profile.input_errors + profile.alarms))

    def identify(self) -> Identity:
        """Return the identity stated in the profile, without a request to the controller."""
        return Identity(manufacturer=self._profile.manufacturer, model=self._profile.model)

    def set_limits(self, low_c: float, high_c: float) -> None:
        """Program the controller's own set point limits; without registers for them, the driver keeps the limits."""
        self._wait_until_free()
        super().set_limits(low_c, high_c)

    def go_to(self, setpoint_c: float) -> None:
        """Set a set point and confirm it; if the chamber conditions, also confirm that the controller follows it."""
        self._wait_until_free()
        super().go_to(setpoint_c)
        for register in self._also:
            self._registers.put(register, setpoint_c)
        self._sent_c = setpoint_c
        if (self._run is not None or self._taken is not None) and self._conditioning.is_on():
            self._take_over()

    def read(self) -> ChamberReading:
        """Return air temperature, set point, power and alarms; raises `InstrumentError` if there is no temperature.

        Power is heating minus the magnitude of cooling, NaN if the profile has no register for it.
        """
        words = self._look(self._reading)
        if errors := _standing(self._profile.input_errors, words):
            raise InstrumentError(f"{self._link.who}: no valid temperature, {'; '.join(errors)}; {ADVICE}")
        return ChamberReading(
            temperature_c=self._registers.value_of(self._air, words),
            setpoint_c=self._registers.value_of(self._obeyed, words),
            power_percent=self._power_percent(words),
            alarms=tuple(_standing(self._profile.alarms, words)),
        )

    def _check_controller(self) -> None:
        self._wait_until_free()
        for check in self._profile.checks:
            if (found := self._registers.read_code(code(check.name, check.address))) not in check.expected:
                expected = " or ".join(map(str, check.expected))
                raise InstrumentError(
                    f"{self._link.who}: {check.name} (register {check.address}) reads {found}, expected {expected};"
                    f" {check.advice}"
                )
        self._read_decimals()
        words = self._look(self._reading)  # checks that every register of a reading exists
        self._registers.value_of(self._obeyed, words)  # raises if the word order is wrong, not for a broken sensor

    def describe(self) -> str:
        """Check the controller over an open link, reading only, and describe it.

        Raises `InstrumentError` if its registers are not those of the profile, or hold zeros only.
        """
        self._check_controller()
        now = self.read()
        self._registers.read_words(_registers(self._profile.modes))
        on = self._conditioning.is_on()
        if now.temperature_c == now.setpoint_c == 0.0:
            raise InstrumentError(f"{self._link.who}: air and set point read 0 °C; check that it is the right model")
        return (
            f"{self._profile.name}; air {now.temperature_c:.4g} °C, set point {now.setpoint_c:.4g} °C,"
            f" conditioning {'on' if on else 'off'}"
        )

    def _read_decimals(self) -> None:
        address = self._profile.decimals_register
        if address is None:
            return
        decimals = self._registers.read_code(code("implied decimal point", address))
        if decimals > MOST_DECIMALS:
            raise InstrumentError(
                f"{self._link.who}: register {address} reads {decimals}, expected 0 to {MOST_DECIMALS} decimals;"
                " check that it is the right model"
            )
        self._registers.decimals = decimals

    def _switch(self, *, on: bool) -> None:
        try:
            self._wait_until_free()
        except InstrumentError:  # a stop is attempted anyway, and its result is checked
            if on:
                raise
        if on:
            self._refuse_start()
        self._conditioning.turn(on=on)
        if on:
            self._take_over()

    def _refuse_start(self) -> None:
        latched = tuple(alarm for alarm in self._profile.alarms if alarm.clear is not None)
        words = self._registers.read_words(_registers(self._profile.modes + latched))
        if modes := _standing(self._profile.modes, words):
            raise InstrumentError(
                f"{self._link.who}: it would not keep our set point, {', '.join(modes)}; end that on its panel"
            )
        if faults := _standing(latched, words):
            raise InstrumentError(
                f"{self._link.who}: conditioning is not switched on while it has "
                f"{', '.join(faults)}; clear that on its panel"
            )

    def _take_over(self) -> None:
        """Make the controller follow the set point that was written, if that needs a separate step."""
        if self._run is not None:
            self._registers.write(code("run command", self._run.address, writable=True), self._run.value)
        if self._taken is not None and self._sent_c is not None:
            self._registers.confirm(self._taken, self._registers.kept(self._taken, self._sent_c))

    def _power_percent(self, words: Mapping[int, int]) -> float:
        value_of = self._registers.value_of
        if self._power is not None:
            return value_of(self._power, words)
        if self._heating is None and self._cooling is None:
            return math.nan
        heating = 0.0 if self._heating is None else value_of(self._heating, words)
        return heating - (0.0 if self._cooling is None else abs(value_of(self._cooling, words)))

    def _wait_until_free(self) -> None:
        self._look(())

    def _look(self, quantities: Iterable[Quantity]) -> dict[int, int]:
        """Return the registers once the controller is not busy; waits, in bench time, as long as the profile states."""
        busy = self._profile.busy
        if busy is None:
            return self._registers.read_words(quantities)
        wanted = (*quantities, code("busy", busy.address))
        started_s = self._clock.now()
        while (words := self._registers.read_words(wanted))[busy.address] not in busy.free:
            if self._clock.now() - started_s >= busy.wait_s:
                raise InstrumentError(
                    f"{self._link.who}: busy or offline (register {busy.address} reads {words[busy.address]}) for more"
                    f" than {busy.wait_s:g} s; {busy.advice}"
                )
            self._clock.sleep(LOOK_AGAIN_S)
        return words

    def _shown(self, number: Number | None, name: str, unit: str) -> ProfiledQuantity | None:
        return None if number is None else quantity_of(number, name, unit, profile=self._profile)


def recognition_of(profile: Profile) -> tuple[ByRegisters]:
    """Return how the controller of a profile is recognised: by everything that its driver reads.

    A single in the wrong place rarely makes sense as a temperature; an integer often does.
    """
    at_once = profile
    if profile.busy is not None:
        at_once = profile.model_copy(update={"busy": profile.busy.model_copy(update={"wait_s": 0.0})})

    def read(link: ModbusLink, clock: Clock) -> str:
        return ProfiledChamber.over(link, at_once, clock).describe()

    likely = bool(profile.checks) or profile.air.kind == "f32"
    transport = profile.transport
    return (
        ByRegisters(
            read=read,
            certainty="likely" if likely else "possible",
            baud=transport.baud or DEFAULT_BAUD,
            pause_s=transport.pause_s,
        ),
    )


def _limits_of(profile: Profile, setpoint: ProfiledQuantity) -> tuple[Quantity, Quantity, dict[str, float]]:
    """Return the set point's limits, and by name the values of those for which the controller has no register.

    These are rounded to the steps of the set point's own register, so that a set point may equal a limit.
    """
    names = ("set point low limit", "set point high limit")
    if profile.low_limit is not None and profile.high_limit is not None:
        low, high = (
            quantity_of(number, name, "°C", profile=profile, writable=True)
            for number, name in zip((profile.low_limit, profile.high_limit), names, strict=True)
        )
        return low, high, {}
    low, high = (replace(setpoint, name=name, address=NOWHERE, readable=True, wears=False) for name in names)
    return low, high, dict(zip(names, profile.kept_limits_c or (), strict=True))


def _registers(conditions: Iterable[Condition]) -> list[ProfiledQuantity]:
    return [code(condition.name, condition.address) for condition in conditions]


def _standing(conditions: Iterable[Condition], words: Mapping[int, int]) -> list[str]:
    """Return the texts of abnormal conditions, and how a latched one is cleared; nothing is cleared here."""
    found = []
    for condition in conditions:
        clear = condition.clear
        how = (
            ""
            if clear is None
            else f" (latched; once its cause is gone, write {clear.value} to register {clear.address})"
        )
        found += [f"{text}{how}" for text in condition.stand(words[condition.address])]
    return list(dict.fromkeys(found))  # two registers may report the same


def _with_baud(address: str, baud: int | None) -> str:
    """Return the address with the profile's speed added if it is a serial address that states none."""
    parsed = parse_address(address)
    return f"{address}?baud={baud}" if parsed.scheme == "serial" and parsed.baud is None and baud else address
