"""Routes of the operator: released procedures, their check, their start, the queue, and the answers to questions."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, TypeVar

from fastapi import APIRouter
from fastapi import Path as PathParameter
from starlette.responses import Response

from benchctl.app.station import NotSignedError, NotStartedError, Station
from benchctl.app.station_journal import Order
from benchctl.campaign.page_operator import NotAskedError, answer_question
from benchctl.campaign.stop import NotRunningError
from benchctl.dashboard.data.documents import signature_of
from benchctl.dashboard.web.access import Caller, CallerOf, CsrfHeader, require
from benchctl.dashboard.web.answers import RefusalError, answer
from benchctl.dashboard.web.campaign_routes import Key
from benchctl.dashboard.web.models import (
    ORDER_ID,
    AnswerOrder,
    AnswerTaken,
    ByOrder,
    Checked,
    CheckOrder,
    Error,
    GoOnOrder,
    Queue,
    Released,
    ReleasedProcedure,
    Signed,
    SignOrder,
    Started,
    StartOrder,
)
from benchctl.dashboard.web.site import Site, SiteOf

T = TypeVar("T")

router = APIRouter(
    prefix="/api", tags=["operator"], responses={401: {"model": Error}, 422: {"model": Error}, 503: {"model": Error}}
)
_change: dict[int | str, dict[str, Any]] = {status: {"model": Error} for status in (400, 403, 404, 409)}


@router.get("/released", response_model=Released)
async def released(site: SiteOf, caller: CallerOf) -> dict[str, Any]:
    """Return the released procedures; none if the server has no bench."""
    if site.station is None:
        return {"bench": "", "operator": "", "procedures": []}
    return {
        "bench": site.station.bench.name,
        "operator": site.station.bench.operator,
        "procedures": [
            {name: getattr(one, name) for name in ReleasedProcedure.model_fields}
            for one in site.station.procedures.values()
        ],
    }


@router.post("/check", response_model=Checked, responses=_change)
async def check(order: CheckOrder, site: SiteOf, caller: CallerOf, x_csrf: CsrfHeader = None) -> Response:
    """Return what `benchctl check` states of a released procedure and a unit; its instruments are identified."""
    station = _station(site, caller, order.procedure)
    return await answer(site.starting, lambda: _checked(station, order))


@router.post("/start", status_code=202, response_model=Started, responses=_change)
async def start(order: StartOrder, site: SiteOf, caller: CallerOf, x_csrf: CsrfHeader = None) -> dict[str, str]:
    """Start a released procedure on a unit as `benchctl run` does; return its campaign once it has begun."""
    station = _station(site, caller, order.procedure)
    return await _carried_out(site, lambda: _begun(site, station.start(_order(order))))


@router.get("/queue", response_model=Queue)
async def queue(site: SiteOf, caller: CallerOf) -> dict[str, Any]:
    """Return the run that was started last, the orders that wait behind it, and why they are held, if they are."""
    return _queue(site)


@router.post("/queue", status_code=202, response_model=Queue, responses=_change)
async def put(order: StartOrder, site: SiteOf, caller: CallerOf, x_csrf: CsrfHeader = None) -> dict[str, Any]:
    """Put a released procedure on a unit at the end of the queue; it is checked again before it starts."""
    station = _station(site, caller, order.procedure)
    await _carried_out(site, lambda: station.queue(_order(order)))
    return _queue(site)


@router.post("/queue/{order}/remove", status_code=202, response_model=Queue, responses=_change)
async def remove(
    order: Annotated[str, PathParameter(pattern=ORDER_ID)],
    who: ByOrder,
    site: SiteOf,
    caller: CallerOf,
    x_csrf: CsrfHeader = None,
) -> dict[str, Any]:
    """Remove an order from the queue."""
    station = _station(site, caller)
    await _carried_out(site, lambda: station.remove(order, who.who))
    return _queue(site)


@router.post("/queue/go_on", status_code=202, response_model=Queue, responses=_change)
async def go_on(order: GoOnOrder, site: SiteOf, caller: CallerOf, x_csrf: CsrfHeader = None) -> dict[str, Any]:
    """Let a queue that holds go on: with its next order, or first with the run that ended early, from where it was."""
    station = _station(site, caller)
    act = station.resume if order.resume else station.go_on
    await _carried_out(site, lambda: act(order.hold, order.who))
    return _queue(site)


@router.post("/campaigns/{key}/answer", status_code=202, response_model=AnswerTaken, responses=_change)
async def answer_run(
    key: Key, order: AnswerOrder, site: SiteOf, caller: CallerOf, x_csrf: CsrfHeader = None
) -> dict[str, bool]:
    """Answer the open question of a run that was started with --page; a refusal ends it as Stop does."""
    require(caller, "operator", "answers a run")
    try:
        await site.quick.run(
            lambda: answer_question(site.path_of(key), order.question, done=order.answer == "done", who=order.who)
        )
    except (NotRunningError, NotAskedError) as err:
        raise RefusalError(409, str(err)) from err
    return {"taken": True}


@router.post("/campaigns/{key}/sign", status_code=202, response_model=Signed, responses=_change)
async def sign(key: Key, order: SignOrder, site: SiteOf, caller: CallerOf, x_csrf: CsrfHeader = None) -> dict[str, Any]:
    """Sign the acceptance of a campaign with the key of the laboratory on this station, as `benchctl accept --sign`."""
    require(caller, "releaser", "signs an acceptance")
    if (station := site.station) is None:
        raise RefusalError(404, _NO_STATION)
    try:
        signed = await site.signing.run(lambda: _signed(site, station, key, order))
    except NotSignedError as err:
        raise RefusalError(409, str(err)) from err
    await site.starting.run(lambda: station.journal.note("signed", by=order.who, **signed))
    return dict(signed["signed"])


_NO_STATION = "this server starts and signs nothing: benchctl serve --bench names what may be started"


def _station(site: Site, caller: Caller, procedure: str | None = None) -> Station:
    require(caller, "operator", "starts or queues a run")
    if site.station is None:
        raise RefusalError(404, _NO_STATION)
    if procedure is not None and procedure not in site.station.procedures:
        raise RefusalError(404, "no procedure of this name is released; ask for /api/released again")
    return site.station


async def _carried_out(site: Site, job: Callable[[], T]) -> T:
    try:
        return await site.starting.run(job)
    except NotStartedError as err:
        raise RefusalError(409, str(err)) from err


def _signed(site: Site, station: Station, key: str, order: SignOrder) -> dict[str, Any]:
    folder, altered = site.path_of(key), site.catalogue.entry(key)["altered"]
    if altered:
        raise NotSignedError(altered)
    station.sign(folder, order.verdict)
    return {"campaign": folder.name, "signed": signature_of(folder)}


def _order(order: StartOrder) -> Order:
    return Order(order=order.order, procedure=order.procedure, serial=order.serial, by=order.who)


def _queue(site: Site) -> dict[str, Any]:
    if site.station is None:
        return {"run": None, "held": "", "hold": 0, "waiting": []}
    station, journal = site.station, site.station.journal
    run = journal.run and {
        **_told(station, journal.run.order),
        "campaign": site.catalogue.id_of(station.root / journal.run.campaign),
        "name": journal.run.campaign,
        "fault": journal.run.fault,
    }
    waiting = [_told(station, one) for one in journal.waiting]
    return {"run": run, "held": journal.held, "hold": journal.hold, "waiting": waiting}


def _told(station: Station, order: Order) -> dict[str, str]:
    released = station.procedures.get(order.procedure)
    return {
        "order": order.order,
        "title": released.title if released else order.procedure,
        "serial": order.serial,
        "who": order.by,
    }


def _checked(station: Station, order: CheckOrder) -> dict[str, Any]:
    try:
        found = station.check(order.procedure, order.serial)
    except NotStartedError as err:
        raise RefusalError(409, str(err)) from err
    # where there are problems, the error repeats the first of them
    refused = [] if found["ok"] else [str(found.get("error", ""))]
    instruments = [" ".join(filter(None, one.values())) for one in _identities(found)]
    return {
        "ready": found["ok"],
        "problems": [f"step {one['step']}: {one['says']}" for one in found.get("problems", [])] or refused,
        "warnings": found.get("warnings", []),
        "questions": [one["says"] for one in found.get("questions", [])],
        "steps": found.get("steps"),
        "bench_time_s": found.get("bench_time_s"),
        "instruments": instruments,
    }


def _begun(site: Site, folder: Path) -> dict[str, str]:
    return {"id": site.catalogue.id_of_new(folder), "name": folder.name}


def _identities(found: dict[str, Any]) -> list[dict[str, str]]:
    return [
        {name: one.get(name, "") for name in ("manufacturer", "model", "serial")}
        for one in found.get("instruments", {}).values()
    ]
