"""Requests and responses of the interface, as in its OpenAPI document; the page and other programs rely on them."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from benchctl.dashboard.web.sessions import Role

Numbers = list[float | None]


class Exact(BaseModel):
    """An object with exactly these keys."""

    model_config = ConfigDict(extra="forbid")


class Error(Exact):
    """The reason for a refused request, in one line."""

    error: str


class SessionSaid(Exact):
    """A session: its role, the CSRF token to be sent as `X-CSRF` with every change, and what it may do here."""

    role: Role
    csrf: str
    may_start: bool
    may_sign: bool


class Has(Exact):
    """Which documents a campaign has."""

    calibration: bool
    diagnosis: bool
    acceptance: bool


class Campaign(Exact):
    """A campaign in the list."""

    id: str = Field(pattern="^[0-9a-f]{16}$")
    name: str
    procedure: str
    unit: str
    model: str
    status: Literal["running", "died", "complete", "interrupted", "aborted", "imported", "simulated", "unreadable"]
    started_utc: str | None
    steps_planned: int | None
    steps_whole: int
    samples: int
    duration_s: float
    operator: str
    bench: str
    has: Has
    says: str
    integrity: Literal["verified", "not verified", "altered"]
    altered: str


class Campaigns(Exact):
    """All campaigns, newest first."""

    campaigns: list[Campaign]


class PlannedStep(Exact):
    """A step of the plan, with its planned bench time and its actual start."""

    index: int
    label: str
    kind: str
    t_start_s: float
    t_end_s: float
    setpoint_c: float | None
    began_s: float | None


class Step(Exact):
    """A recorded step."""

    index: int
    name: str
    kind: str
    role: str
    whole: bool
    t_start_s: float
    t_end_s: float
    samples: int
    gaps: int
    rate_dps: float | None
    amplitude_dps: float | None
    frequency_hz: float | None
    setpoint_c: float | None
    mounting: str


class Channel(Exact):
    """A channel with its unit, a description, and the time axis that it belongs to."""

    name: str
    unit: str | None
    says: str
    axis: str


class BenchLimit(Exact):
    """A limit of the bench."""

    quantity: str
    unit: str
    low: float | None
    high: float | None


class CampaignDetails(Campaign):
    """A campaign with its plan, steps and channels."""

    plan: list[PlannedStep]
    steps: list[Step]
    channels: list[Channel]
    t_end_s: float
    limits: list[BenchLimit]
    provenance: dict[str, str]
    notes: list[str]
    digest: str


class ChannelSeries(Exact):
    """A channel over time: every sample if `exact`, else the minimum and maximum of all samples in each pixel."""

    channel: str
    unit: str | None
    from_s: float
    to_s: float
    exact: bool
    complete: bool
    done: float = Field(ge=0.0, le=1.0)
    t_s: list[float]
    low: Numbers
    high: Numbers
    samples: int


class Event(Exact):
    """A line of the journal as a sentence."""

    number: int
    wall_time: str
    kind: str
    says: str
    level: Literal["info", "warning", "bad"]


class Events(Exact):
    """Events, and the number from which to continue."""

    events: list[Event]
    next: int


class Calibration(Exact):
    """Summary of a calibration; keys as in `coefficients.json`, if present there."""

    unit: str = ""
    output_unit: str = ""
    convention: str = ""
    argument: str = ""
    K0_v_per_dps: float | None = None
    U0_v: float | None = None
    T0_c: float | None = None
    S_rad_per_dps: float | None = None
    stages: list[Any] = []
    valid: dict[str, Any] | None = None
    uncertainty: dict[str, Any] | None = None
    error_percent: dict[str, Any] | None = None
    rms_percent: dict[str, Any] | None = None
    joint: dict[str, Any] | None = None
    free_motion: dict[str, Any] | None = None
    misfit_percent_of_full_scale: float | None = None
    warnings: list[str] = []
    notes: list[str] = []


class Diagnosis(Exact):
    """Summary of a diagnosis; keys as in `diagnosis.json`."""

    verdict: str
    says: Any = None
    baseline: Any = None
    findings: list[Any] = []
    unexplained: Any = None
    fit: Any = None
    next_experiment: Any = None
    not_found: Any = None
    notes: list[str] = []
    map: Any = None


class Signed(Exact):
    """By whom an acceptance is signed, as `benchctl verify` states it, and what differs from what was signed."""

    says: str
    problems: list[str]


class Acceptance(Exact):
    """Summary of the acceptance tests of a gyro; keys as in `acceptance.json`; `signed` is null without a signature."""

    verdict: str
    tally: str | None = None
    tests: list[Any] = []
    unit_under_test: Any = None
    started_utc: str | None = None
    stage: Any = None
    limits: Any = None
    rule: Any = None
    anomalies: Any = None
    signed: Signed | None = None


class History(BaseModel):
    """Units over time, as in `benchctl history --json`."""

    model_config = ConfigDict(extra="allow")
    units: list[dict[str, Any]]


class Explanation(BaseModel):
    """The explanation of an effect, a metric or a term."""

    model_config = ConfigDict(extra="allow")


class HelpSection(Exact):
    """A heading with its content: nodes that are a text, or a list of tag, attributes and nodes."""

    anchor: str
    level: int = Field(ge=1, le=6)
    heading: str
    content: list[Any]


class HelpPage(Exact):
    """A page of the handbook."""

    topic: str
    title: str
    sections: list[HelpSection]


class Handbook(Exact):
    """All pages of the handbook; the last one is the glossary."""

    pages: list[HelpPage]


Word = Annotated[str, Field(min_length=1, max_length=60, pattern=r"^[^\x00-\x1f\x7f]*[^\x00-\x20\x7f]$")]
"""One line that does not end in a space."""


class StopOrder(Exact):
    """The campaign's name, typed by the user for confirmation, and the name of that person, if it is known."""

    confirm: str = Field(max_length=500)
    who: Word | None = None


class StopAsked(Exact):
    """The request was sent to the run, which stops by itself."""

    asked: Literal[True]


class ReleasedProcedure(Exact):
    """A procedure that the lab has released; `bench_time_s` is null where the bench cannot run it."""

    name: str
    title: str
    says: str
    steps: int
    bench_time_s: float | None
    questions: int


class Released(Exact):
    """The released procedures, the name of the bench, and the operator that its file states."""

    bench: str
    operator: str
    procedures: list[ReleasedProcedure]


class CheckOrder(Exact):
    """A released procedure, by its name, and the serial number of a unit."""

    procedure: Word
    serial: Word


ORDER_ID = "^[0-9a-f]{16}$"


class StartOrder(CheckOrder):
    """The same, the name of the person who starts it, and an id that the client makes: none is carried out twice."""

    who: Word
    order: str = Field(pattern=ORDER_ID)


class Checked(Exact):
    """What `benchctl check` states; nothing is started unless it is `ready`. Duration in bench time."""

    ready: bool
    problems: list[str]
    warnings: list[str]
    questions: list[str]
    steps: int | None
    bench_time_s: float | None
    instruments: list[str]


class Started(Exact):
    """The campaign that has begun."""

    id: str
    name: str


class QueuedOrder(Exact):
    """A released procedure, by its title, for a unit, ordered by a person."""

    order: str
    title: str
    serial: str
    who: str


class StationRun(QueuedOrder):
    """The run that was started last: its campaign, and its fault: null while it goes on, empty if it ended properly."""

    campaign: str
    name: str
    fault: str | None


class Queue(Exact):
    """The run that was started last, and what waits; while `held` gives a reason, nothing of it starts."""

    run: StationRun | None
    held: str
    hold: int
    waiting: list[QueuedOrder]


class ByOrder(Exact):
    """The name of the person who changes something."""

    who: Word


class GoOnOrder(ByOrder):
    """The hold that is ended, as `Queue` has it, by whom, and whether the run that ended early is resumed first."""

    hold: int = Field(ge=0, le=1 << 31)
    resume: bool


class SignOrder(ByOrder):
    """The verdict that a person has seen and has signed, and the name of that person, for the station's journal."""

    verdict: Literal["PASS", "FAIL", "INCONCLUSIVE"]


class AnswerOrder(Exact):
    """The answer to the question with that id, and the name of the person who gives it."""

    question: str = Field(max_length=100)
    answer: Literal["done", "refuse"]
    who: Word


class AnswerTaken(Exact):
    """The answer was handed to the run."""

    taken: Literal[True]
