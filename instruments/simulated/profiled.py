"""A simulated chamber created from a lab's own profile, served as Modbus RTU.

It only shows that the profile is self-consistent, and allows to rehearse a campaign: it uses every register as the
profile declares it, so a wrong number in the profile is wrong here in the same way.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from benchctl_instruments.chambers.profile import (
    BitSwitch,
    Condition,
    KeySwitch,
    NothingWired,
    Number,
    Profile,
    RegisterSwitch,
    Switch,
    changed,
    words,
)
from benchctl_instruments.protocols.modbus import ILLEGAL_VALUE, ModbusRefusal, WordOrder
from benchctl_instruments.simulated.machines import ChamberMachine
from benchctl_instruments.simulated.modbus_server import (
    LimitedSetpoint,
    ModbusRtuServer,
    Register,
    RegisterTable,
    f32,
    signed_word,
    word,
)

LOW_C, HIGH_C = -70.0, 180.0


class SimulatedProfiled(ModbusRtuServer):
    """A controller as a profile describes it, from `start()` to `stop()` or in a `with`; a driver uses its `address`.

    Parameters
    ----------
    chamber
        The chamber machine.
    profile
        The controller's profile.
    changes
        Fields of the profile to replace, as for the driver.
    word_order, unit_id
        Replace the profile's values.
    pace_baud, over_tcp
        See `ModbusRtuServer`.

    `words` holds the registers that are no numbers, by address, and may be changed: conditions, modes, busy.
    """

    def __init__(
        self,
        chamber: ChamberMachine,
        *,
        profile: Profile,
        changes: Mapping[str, Any] | None = None,
        word_order: WordOrder | None = None,
        unit_id: int | None = None,
        pace_baud: int | None = None,
        over_tcp: bool = False,
    ) -> None:
        if changes is not None:
            profile = changed(profile, changes, "chamber.options.changes")
        if word_order is not None:
            profile = changed(profile, {"transport": {"word_order": word_order}}, "chamber.options")
        self._chamber = chamber
        self._profile = profile
        self._pending_c = chamber.setpoint_c()
        self._setpoint = LimitedSetpoint(self, *(profile.kept_limits_c or (LOW_C, HIGH_C)))
        self._outputs: dict[int, float] = {}  # values written while off
        self.words = {address: 0 for _, address in words(profile)} | self._first_words()
        self._declared: list[Register] = []
        self._declare()
        super().__init__(
            RegisterTable(self._declared),
            unit_id=profile.transport.unit_id if unit_id is None else unit_id,
            baud=profile.transport.baud or 19200,
            pace_baud=pace_baud,
            over_tcp=over_tcp,
        )

    def _first_words(self) -> dict[int, int]:
        """Return the registers of a controller without any fault."""
        profile = self._profile
        found = {
            condition.address: condition.fine[0]
            for condition in (*profile.input_errors, *profile.alarms, *profile.modes)
            if not condition.bits
        }
        found |= {check.address: check.expected[0] for check in profile.checks}
        if profile.busy is not None:
            found[profile.busy.address] = profile.busy.free[0]
        if profile.decimals_register is not None:
            found[profile.decimals_register] = profile.decimals
        return found

    def _declare(self) -> None:
        """Declare every register; of two at one address in the profile the first one is used."""
        profile, chamber, setpoint = self._profile, self._chamber, self._setpoint
        self._number(profile.air, chamber.air_c)
        for address in (profile.setpoint.address, *profile.setpoint.also):
            register = profile.setpoint.model_copy(update={"address": address})
            self._number(register, lambda: self._pending_c, setpoint.put)
        self._number(profile.setpoint.taken, chamber.setpoint_c)
        self._number(profile.low_limit, lambda: setpoint.low_c, setpoint.put_low)
        self._number(profile.high_limit, lambda: setpoint.high_c, setpoint.put_high)
        self._declare_switch(profile.switch)
        self._number(profile.power, chamber.power_percent)
        self._number(profile.heating, lambda: max(0.0, chamber.power_percent()))
        self._number(profile.cooling, lambda: max(0.0, -chamber.power_percent()))
        if profile.setpoint.run is not None:
            self._add(word(profile.setpoint.run.address, lambda: 0, self._run))
        for alarm in profile.alarms:
            if alarm.clear is not None:
                self._add(word(alarm.clear.address, lambda: 0, self._cleared(alarm)))
        for run in profile.transport.runs:
            self.words = dict.fromkeys(range(run.first, run.first + run.count), 0) | self.words
        for address in self.words:
            self._add(word(address, self._word_at(address)))

    def _declare_switch(self, switch: Switch) -> None:
        if isinstance(switch, NothingWired):
            self._chamber.run(True)  # it has power
            return
        shown = switch.address if switch.shown is None else switch.shown
        if isinstance(switch, BitSwitch):
            self.words[shown] = (switch.on if self._chamber.running() else 1 - switch.on) << switch.bit
            state, put = self._word_at(shown), self._set_bits(switch, shown)
        else:
            state, put = self._code_of(switch), self._set_code(switch)
        self._add(word(switch.address, state if shown == switch.address else lambda: 0, put))
        self._add(word(shown, state))
        if isinstance(switch, RegisterSwitch):
            for setting in switch.after_off:
                self._number(setting, self._output(setting.address), self._set_output(setting.address))

    def _number(
        self, number: Number | None, get: Callable[[], float], put: Callable[[float], None] | None = None
    ) -> None:
        if number is None:
            return
        if number.kind == "f32":
            self._add(f32(number.address, get, put, word_order=self._profile.transport.word_order))
            return
        step = 10 ** (self._profile.decimals if number.decimals is None else number.decimals)
        low, high, make = (0, 0xFFFF, word) if number.kind == "u16" else (-0x8000, 0x7FFF, signed_word)
        scaled = None if put is None else lambda value: put(value / step)
        self._add(make(number.address, lambda: max(low, min(high, round(get() * step))), scaled))

    def _add(self, register: Register) -> None:
        claimed = {address for other in self._declared for address in range(other.address, other.address + other.words)}
        if not claimed & set(range(register.address, register.address + register.words)):
            self._declared.append(register)

    def set_setpoint(self, setpoint_c: float) -> None:
        """Set a new set point; if the controller has to take it over by a command, it is only stored."""
        self._pending_c = setpoint_c
        if self._profile.setpoint.run is None:
            self._chamber.set_setpoint(setpoint_c)

    def _run(self, value: int) -> None:
        if self._profile.setpoint.run is None or value != self._profile.setpoint.run.value:
            raise ModbusRefusal(ILLEGAL_VALUE)
        self._chamber.set_setpoint(self._pending_c)

    def _cleared(self, alarm: Condition) -> Callable[[int], None]:
        def put(value: int) -> None:
            if alarm.clear is None or value != alarm.clear.value:
                raise ModbusRefusal(ILLEGAL_VALUE)
            self.words[alarm.address] = 0 if alarm.bits else alarm.fine[0]

        return put

    def _code_of(self, switch: RegisterSwitch | KeySwitch) -> Callable[[], int]:
        return lambda: switch.on if self._chamber.running() else switch.off

    def _set_code(self, switch: RegisterSwitch | KeySwitch) -> Callable[[int], None]:
        def put(value: int) -> None:
            known = (
                {switch.press: not self._chamber.running()}
                if isinstance(switch, KeySwitch)
                else {switch.on: True, switch.off: False}
            )
            if value not in known:
                raise ModbusRefusal(ILLEGAL_VALUE)
            self._chamber.run(known[value])
            self._outputs.clear()

        return put

    def _set_bits(self, switch: BitSwitch, shown: int) -> Callable[[int], None]:
        def put(value: int) -> None:
            self.words[shown] = value
            self._chamber.run((value >> switch.bit & 1) == switch.on)

        return put

    def _output(self, address: int) -> Callable[[], float]:
        return lambda: self._outputs.get(address, self._chamber.power_percent())

    def _set_output(self, address: int) -> Callable[[float], None]:
        def put(value: float) -> None:
            if self._chamber.running():
                raise ModbusRefusal(ILLEGAL_VALUE)
            self._outputs[address] = value

        return put

    def _word_at(self, address: int) -> Callable[[], int]:
        return lambda: self.words[address]
