"""bench.toml: the instruments, the unit under test, and the limits."""

from __future__ import annotations

from base64 import b64encode
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, PrivateAttr, ValidationInfo, field_validator, model_validator

from benchctl.bench_instruments import ChamberEntry, DigitizerEntry, GyroEntry, InstrumentEntry, RateTableEntry
from benchctl.limits import read_whole
from benchctl.model_file import Model
from benchctl.notifications import Notify, without_secrets
from benchctl.tables import Table
from benchctl.toml_file import line_of, named_place, parse_toml, read_text
from benchctl.units import quantity, unit_stated
from benchctl_instruments.catalog import MANUAL, find_profile, is_profile
from benchctl_instruments.chambers.profile import parse_profile, profile_name
from benchctl_instruments.errors import UsageError
from benchctl_instruments.simulated.faults.bench import AnyFault

Quantity = Literal[
    "rate_dps",
    "acceleration_dps2",
    "angle_deg",
    "air_c",
    "setpoint_c",
    "setpoint_error_c",
    "power_percent",
    "gyro_c",
    "gyro_v",
    "encoder_dps",
]
"""Quantities measured during a run. `setpoint_error_c` is air minus set point, `gyro_c` is measured by the gyro's
thermistor, and `encoder_dps` is the table's rate from the digitizer's count, independent of the table controller."""

_INTERLOCKED = {"degC": ("degC", "K"), "degC or K": ("degC", "K")}
"""By the unit that a quantity's name states: the units of its limits and of its hysteresis, if these differ."""

HAND_ERROR_PERCENT = 10.0
"""Default of `limits.motion_error_percent` with a manual rate table."""

_PNG, _MOST_LOGO_BYTES = b"\x89PNG\r\n\x1a\n", 300_000

SIMULATED = "simulated"
"""The name of the bench that needs no file and no hardware."""


class UnitUnderTest(Table):
    """The gyro under test; `range_dps` is its rated range."""

    serial: str = Field(
        min_length=1,
        title="Serial number",
        description="That of the unit; its history goes by it.",
        examples=["SN-0017"],
    )
    model: str = Field(
        default="", description="The unit's model; units of one model are compared.", examples=["VG910Q"]
    )
    range_dps: float = Field(gt=0, title="Rated range", description="The unit's rated range.", examples=[175.0])


class Limits(Table):
    """Limits of all steps and of all measured values.

    While a step is recorded, the rate measured by the encoder may differ from the demanded rate by `motion_error_dps`
    or by `motion_error_percent` of the demanded rate, whichever is larger.
    """

    rate_dps: float = Field(
        gt=0,
        title="Highest rate",
        description="No step turns faster; a measured rate beyond it stops the run.",
        examples=[300.0],
    )
    acceleration_dps2: float = Field(
        gt=0, title="Highest acceleration", description="No step accelerates faster.", examples=[1500.0]
    )
    coldest_c: float = Field(
        title="Coldest air", description="No set point lies below; below hottest_c.", examples=[-55.0]
    )
    hottest_c: float = Field(
        title="Hottest air", description="No set point lies above; above coldest_c.", examples=[85.0]
    )
    ramp_c_per_min: float = Field(
        gt=0,
        title="Ramp",
        description="How fast the chamber's air follows; durations are reckoned with it.",
        examples=[2.0],
    )
    silence_s: float = Field(
        default=10.0, gt=0, title="Silence", description="An instrument that is silent for so long stops the run."
    )
    motion_error_dps: float = Field(
        default=0.5,
        gt=0,
        title="Motion",
        description="How far the rate by the encoder may be off the demand while a step is recorded;"
        " beyond it the step is repeated once, then the run stops. The encoder's resolution is added.",
    )
    motion_error_percent: float = Field(
        default=2.0,
        ge=0,
        title="Motion, relative",
        description="The same as a share of the rate that is demanded; the larger of the two counts."
        " Without it, 10 with a manual rate table.",
    )

    @model_validator(mode="after")
    def _in_order(self) -> Limits:
        if self.coldest_c >= self.hottest_c:
            raise ValueError(f"coldest_c ({self.coldest_c:g}) must be below hottest_c ({self.hottest_c:g})")
        return self

    def motion_tolerance_dps(self, demand_dps: float) -> float:
        """Return by how much the encoder's rate may differ from a demanded one [deg/s]."""
        return max(self.motion_error_dps, self.motion_error_percent / 100.0 * abs(demand_dps))


class Safe(Table):
    """The chamber's set point after every run, and the time of silence of the runner after which its guard acts."""

    chamber_c: float = Field(
        default=23.0, title="Safe set point", description="Between limits.coldest_c and limits.hottest_c."
    )
    hang_s: float = Field(
        default=60.0,
        gt=0,
        title="Hang",
        description="A run on real instruments that hangs for so long is ended by its guard;"
        " wall time, longer than silence_s.",
    )


class Interlock(Table):
    """A limit on a measured quantity, and the action if it is violated for `for_s`.

    The limit counts as violated until the value is back inside it by `hysteresis`. "stop" ends the run at once; "hold"
    completes the current step, then waits with the table at rest for at most `give_up_s`. Times are in bench time.
    """

    quantity: Quantity = Field(
        description="What is watched; setpoint_error_c is air less set point.", examples=["gyro_c"]
    )
    above: float | None = Field(
        default=None, description="Beyond this, in the quantity's unit; above, below or both.", examples=[70.0]
    )
    below: float | None = Field(
        default=None, description="Beneath this, in the quantity's unit; above, below or both.", examples=[-60.0]
    )
    hysteresis: float = Field(
        default=0.0, ge=0, description="It is over once the value is back inside by so much.", examples=[2.0]
    )
    for_s: float = Field(
        default=0.0,
        ge=0,
        title="For",
        description="It counts once it has lasted so long (bench time); 0: at once.",
        examples=[30.0],
    )
    action: Literal["stop", "hold"] = Field(
        default="stop",
        description="stop ends the run; hold ends the step, then waits with the table at rest.",
        examples=["hold"],
    )
    give_up_s: float | None = Field(
        default=None,
        gt=0,
        title="Give up",
        description="A hold that lasts longer ends the run; for hold, and only for it.",
        examples=[3600.0],
    )

    @field_validator("above", "below", "hysteresis", mode="before")
    @classmethod
    def _in_the_unit_of_its_quantity(cls, value: Any, info: ValidationInfo) -> Any:
        if not isinstance(value, str):
            return value
        stated = unit_stated(str(info.data.get("quantity")))
        limit, difference = _INTERLOCKED.get(stated, (stated, stated))
        try:
            return quantity(value, difference if info.field_name == "hysteresis" else limit)
        except UsageError as err:
            raise ValueError(str(err)) from err

    @model_validator(mode="after")
    def _makes_sense(self) -> Interlock:
        if self.above is None and self.below is None:
            raise ValueError(f"{self.quantity}: expected above, below or both")
        if self.above is not None and self.below is not None and self.below + 2 * self.hysteresis >= self.above:
            raise ValueError(
                f"{self.quantity}: nothing is left between below ({self.below:g}) and above ({self.above:g}) "
                f"once the hysteresis ({self.hysteresis:g}) is taken from both"
            )
        if (self.action == "hold") != (self.give_up_s is not None):
            raise ValueError(f'{self.quantity}: action = "hold" needs give_up_s, and no other action has one')
        if self.action == "hold" and self.quantity == "encoder_dps":
            raise ValueError(
                "encoder_dps: it is measured only while a step is recorded, so that a hold would never see it end; "
                'hold on rate_dps, or use action = "stop"'
            )
        return self


class Laboratory(Table):
    """The laboratory that the acceptance report names."""

    name: str = Field(title="Name", description="As reports state it.", examples=["Gyro laboratory, Example Ltd"])
    address: str = Field(default="", title="Address", description="As reports state it.")
    logo: str = Field(
        default="",
        title="Logo",
        description="A PNG file, relative to the folder of bench.toml; recordings store its content.",
        examples=["logo.png"],
    )
    signing_key: str = Field(
        default="",
        title="Signing key",
        description="The OpenSSH Ed25519 key with which the live page signs, relative to the folder of bench.toml.",
        examples=["qa_key"],
    )


class Released(Table):
    """A procedure with its parameters that the lab has released: the live page starts these and no others."""

    procedure: str = Field(
        min_length=1,
        description="Its name, or a .py file, relative to the folder of bench.toml.",
        examples=["acceptance"],
    )
    title: str = Field(
        default="", description="What the live page calls it; otherwise what the procedure states of itself."
    )
    parameters: dict[str, Any] = Field(
        default_factory=dict, description="As -p NAME=VALUE of benchctl run.", examples=[{"points": 5}]
    )
    limits: str = Field(
        default="",
        description="A file of limits by which a complete run is judged, relative to the folder of bench.toml.",
        examples=["limits.toml"],
    )


class Site(Table):
    """The location of the bench; the uncertainty of its latitude is expanded, k = 2."""

    latitude_deg: float | None = Field(
        default=None, ge=-90, le=90, title="Latitude", description="Positive in the north.", examples=[58.5]
    )
    latitude_uncertainty_deg: float | None = Field(
        default=None, ge=0, title="Uncertainty of the latitude", description="Expanded, k = 2.", examples=[0.05]
    )


class Simulation(Table):
    """The lab's model of the gyro: U = U0 + K0·k(T)·k(ω)·ω, with parameters from an earlier calibration.

    `k_T` holds a1, a2, … of k(T) = 1 + a1·(T − T0) + a2·(T − T0)² + …, `k_omega` b2, b4, … of k(ω) = 1 + b2·ω² + b4·ω⁴
    + …; with an empty list, the model has no such term. `noise_v_rms` is the noise of one sample.
    """

    K0_v_per_dps: float = Field(title="Scale factor", description="K0 of U = U0 + K0·k(T)·k(ω)·ω.", examples=[0.05])
    U0_v: float = Field(title="Bias", description="U0, the output at rest.", examples=[0.012])
    T0_c: float = Field(title="Reference temperature", description="T0, at which k(T) is 1.", examples=[20.0])
    k_T: tuple[float, ...] = Field(  # noqa: N815 - the key is that of open recordings
        default=(),
        title="Temperature coefficients",
        description="a1, a2, … of k(T); empty: no such term.",
        examples=[[-0.0001315, 2.066e-06]],
    )
    k_omega: tuple[float, ...] = Field(
        default=(),
        title="Rate coefficients",
        description="b2, b4, … of k(ω); empty: no such term.",
        examples=[[-3.375e-06, 3.417e-12]],
    )
    noise_v_rms: float = Field(ge=0, title="Noise", description="The noise of one sample.", examples=[0.0006])
    output_limit_v: float = Field(
        gt=0, title="Output limit", description="Where the gyro's output clips.", examples=[11.0]
    )


class Bench(Table):
    """A bench as described by its file, with the text of the file."""

    name: str = Field(description="What reports and recordings call this bench.", examples=["bench 2, room 114"])
    operator: str = Field(
        default="", description="Who runs the bench; it goes into every recording.", examples=["A. Ivanova"]
    )
    simulated: bool = Field(
        default=False,
        description="true: benchctl starts simulated instruments of these models and runs on their clock."
        " false: the instruments are at their addresses.",
        examples=[True],
    )
    time_factor: float = Field(
        default=1.0, gt=0, description="Bench seconds a second of the wall; other than 1 with `benchctl sim`."
    )
    unit: UnitUnderTest = Field(title="Unit under test", description="The gyro that is tested.")
    limits: Limits = Field(description="What no step may exceed, and no measured value may pass.")
    safe: Safe = Field(default=Safe(), title="Safe state", description="Where the bench goes whatever ends a run.")
    interlocks: tuple[Interlock, ...] = Field(
        default=(), description="Limits of your own on what is measured, and what happens beyond."
    )
    notify: Notify | None = Field(
        default=None,
        title="Messages",
        description="Who gets a message on mail or chat when a run ends or needs somebody.",
    )
    laboratory: Laboratory | None = Field(default=None, description="Who tests, for the first page of a report.")
    released: dict[str, Released] = Field(
        default_factory=dict, description="The procedures that the live page may start, by a name of the lab's."
    )
    site: Site = Field(default=Site(), description="Location of the bench, for the Earth's rate.")
    rate_table: RateTableEntry = Field(description="The rate table, its driver, address and certificate.")
    chamber: ChamberEntry = Field(description="The climate chamber, its driver, address and certificate.")
    digitizer: DigitizerEntry = Field(description="What samples encoder and gyro, and what its terminals mean.")
    gyro: GyroEntry | None = Field(
        default=None, title="Digital gyro", description="A gyro that sends frames, where there is one."
    )
    simulation: Simulation | None = Field(
        default=None,
        title="Believed model",
        description="The model that the lab believes in; diagnosis begins with it.",
    )
    physics: dict[str, Any] = Field(
        default_factory=dict,
        description="What the simulated bench obeys; every figure has a default.",
        examples=[{"seed": 1}],
    )
    effects: dict[str, Any] = Field(
        default_factory=dict, description="Physics that the model leaves out, by name, for simulated benches only."
    )
    faults: tuple[AnyFault, ...] = Field(
        default=(), description="What goes wrong on simulated links and in simulated instruments."
    )
    _text: str = PrivateAttr(default="")
    _chamber_profile: str = PrivateAttr(default="")
    _logo: str = PrivateAttr(default="")

    @model_validator(mode="before")
    @classmethod
    def _set_by_hand(cls, data: Any) -> Any:
        match data:
            case {"rate_table": {"model": "manual"}, "limits": dict(limits)}:
                return {**data, "limits": {"motion_error_percent": HAND_ERROR_PERCENT, **limits}}
        return data

    @model_validator(mode="after")
    def _reachable(self) -> Bench:
        if not self.limits.coldest_c <= self.safe.chamber_c <= self.limits.hottest_c:
            raise ValueError(f"safe.chamber_c ({self.safe.chamber_c:g}) lies outside limits.coldest_c to hottest_c")
        if self.safe.hang_s <= self.limits.silence_s:
            raise ValueError(
                f"safe.hang_s ({self.safe.hang_s:g}) must be longer than limits.silence_s ({self.limits.silence_s:g}), "
                "for which a silent instrument is waited for"
            )
        if self.by_hand and self.rate_table.address is not None:
            raise ValueError("rate_table.address: a manual table has no wire; leave it out")
        if not self.simulated:
            wired = {name: entry for name, entry in self.entries.items() if entry.model != MANUAL}
            if missing := [f"{name}.address" for name, entry in wired.items() if entry.address is None]:
                raise ValueError(f"{', '.join(missing)} must be given where simulated is not true")
            if self.effects:
                raise ValueError("[effects] is played by simulated instruments only, and simulated is not true")
            if self.faults:
                raise ValueError("[[faults]] happen to simulated instruments only, and simulated is not true")
        if self.gyro is None and any(fault.on == "gyro" for fault in self.faults):
            raise ValueError('[[faults]] on = "gyro" happen to a digital gyro, and there is no [gyro]')
        return self

    @property
    def text(self) -> str:
        """The text of the file as it was read, with the URLs of `[notify]` masked."""
        return self._text

    @property
    def chamber_profile(self) -> str:
        """The text of the profile that `chamber.model` names, as it was read; empty if it names none."""
        return self._chamber_profile

    @property
    def logo(self) -> str:
        """The content of the laboratory's logo, in base64; empty if there is none."""
        return self._logo

    @property
    def entries(self) -> dict[str, InstrumentEntry]:
        """The instruments by their role."""
        found = {"rate_table": self.rate_table, "chamber": self.chamber, "digitizer": self.digitizer}
        return found if self.gyro is None else {**found, "gyro": self.gyro}

    @property
    def by_hand(self) -> bool:
        """Whether an operator sets the rates of the rate table, which no program can stop."""
        return self.rate_table.model == MANUAL

    @property
    def recorded_hz(self) -> float:
        """The number of rows of four channels recorded per second of a streamed step: scans and frames."""
        frames_hz = self.gyro.frame_rate_hz * (1.75 if self.gyro.axes == 3 else 1.0) if self.gyro else 0.0
        return self.digitizer.sample_rate_hz + frames_hz

    def read_from(self, text: str, chamber_profile: str) -> Bench:
        """Return the same bench with the texts of these files."""
        bench = self.model_copy()
        bench._text, bench._chamber_profile = text, chamber_profile  # noqa: SLF001 - this class's own
        return bench

    def with_logo(self, png: bytes) -> Bench:
        """Return the same bench with the content of the laboratory's logo."""
        bench = self.model_copy()
        bench._logo = b64encode(png).decode()  # noqa: SLF001 - this class's own
        return bench

    def with_seed(self, seed: int | None) -> Bench:
        """Return the same bench with another seed of its simulated physics."""
        return self if seed is None else self.model_copy(update={"physics": {**self.physics, "seed": seed}})

    def with_unit(self, serial: str | None) -> Bench:
        """Return the same bench with another unit of the same kind on it."""
        if serial is None:
            return self
        return self.model_copy(update={"unit": self.unit.model_copy(update={"serial": serial})})

    def silent(self) -> Bench:
        """Return the same bench without messages to anybody."""
        return self.model_copy(update={"notify": None})

    def obeying(self, model: Model) -> Bench:
        """Return the same bench with the physics and effects of a model, whose gyro also becomes the lab's model."""
        simulation = self.simulation if model.simulation is None else Simulation.model_validate(model.simulation)
        return self.model_copy(
            update={"simulation": simulation, "physics": model.bench_physics, "effects": dict(model.effects)}
        )


def template() -> str:
    """Return the commented template of bench.toml; it describes the simulated bench."""
    return files("benchctl").joinpath("bench.toml").read_text(encoding="utf-8")


def load_bench(source: str) -> Bench:
    """Return the bench of that file, or the simulated bench for the word `simulated`.

    Raises
    ------
    UsageError
        If the file does not exist, is not TOML, or has a wrong field; names the file, the line and the field. The same
        for the chamber's profile, whose path is relative to the folder of this file.
    """
    path = Path(source)
    if source == SIMULATED:
        text, name = template(), "simulated bench"
    elif path.is_dir():
        raise UsageError(f"bench {path}: expected a bench.toml, this is a folder")
    else:
        text, name = read_text(path, "bench"), str(path)
    bench = bench_of_text(text, name)
    if is_profile(bench.chamber.model):
        bench = _with_profile(bench, path.parent, name)
    if bench.simulated:
        _check_simulation(bench, name)
    if bench.laboratory and bench.laboratory.logo:
        bench = bench.with_logo(_png(path.parent / bench.laboratory.logo, f"{name}: laboratory.logo "))
    return bench


def bench_of_text(text: str, name: str, chamber_profile: str = "") -> Bench:
    """Return the bench of a text and of the text of its chamber's profile; raise the same errors as `parse_toml`."""
    bench = parse_toml(text, Bench, name)
    try:
        return bench.read_from(without_secrets(text, bench.notify), chamber_profile)
    except UsageError as err:
        raise UsageError(f"{name}, line {line_of(text, named_place(str(err)))}: {err}") from err


def _png(path: Path, what: str) -> bytes:
    content = read_whole(path, _MOST_LOGO_BYTES, what)
    if not content.startswith(_PNG):
        raise UsageError(f"{what}{path}: expected a PNG file")
    return content


def _with_profile(bench: Bench, folder: Path, name: str) -> Bench:
    try:
        path, text = find_profile(bench.chamber.model, folder)
    except UsageError as err:
        raise UsageError(f"{name}, line {line_of(bench.text, ('chamber', 'model'))}: {err}") from err
    parse_profile(text, profile_name(path))
    chamber = bench.chamber.model_copy(update={"model": str(path)})
    return bench.model_copy(update={"chamber": chamber}).read_from(bench.text, text)


def _check_simulation(bench: Bench, name: str) -> None:
    from benchctl_instruments.physics.effects.making import make_effects
    from benchctl_instruments.simulated.settings import WorldSettings

    try:
        WorldSettings.from_mapping(bench.physics, where="physics")
        make_effects(bench.effects)
    except UsageError as err:
        raise UsageError(f"{name}, line {line_of(bench.text, named_place(str(err)))}: {err}") from err
