"""Routes of the operator: released procedures, their check, their start, and the answers to a run's questions."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter
from starlette.responses import Response

from benchctl.app.station import NotStartedError, Station
from benchctl.campaign.page_operator import NotAskedError, answer_question
from benchctl.campaign.stop import NotRunningError
from benchctl.dashboard.web.access import Caller, CallerOf, CsrfHeader
from benchctl.dashboard.web.answers import RefusalError, answer
from benchctl.dashboard.web.campaign_routes import Key
from benchctl.dashboard.web.models import (
    AnswerOrder,
    AnswerTaken,
    Checked,
    CheckOrder,
    Error,
    Released,
    ReleasedProcedure,
    Started,
    StartOrder,
)
from benchctl.dashboard.web.site import Site, SiteOf

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
    try:
        return await site.starting.run(lambda: _started(site, station, order))
    except NotStartedError as err:
        raise RefusalError(409, str(err)) from err


@router.post("/campaigns/{key}/answer", status_code=202, response_model=AnswerTaken, responses=_change)
async def answer_run(
    key: Key, order: AnswerOrder, site: SiteOf, caller: CallerOf, x_csrf: CsrfHeader = None
) -> dict[str, bool]:
    """Answer the open question of a run that was started with --page; a refusal ends it as Stop does."""
    _require_operator(caller)
    try:
        await site.quick.run(
            lambda: answer_question(site.path_of(key), order.question, done=order.answer == "done", who=order.who)
        )
    except (NotRunningError, NotAskedError) as err:
        raise RefusalError(409, str(err)) from err
    return {"taken": True}


def _station(site: Site, caller: Caller, procedure: str) -> Station:
    _require_operator(caller)
    if site.station is None or procedure not in site.station.procedures:
        raise RefusalError(404, "no procedure of this name is released; ask for /api/released again")
    return site.station


def _require_operator(caller: Caller) -> None:
    if caller.role != "operator":
        raise RefusalError(403, "this token only looks; a run is started and answered with the other one")


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


def _started(site: Site, station: Station, order: StartOrder) -> dict[str, str]:
    folder = station.start(order.procedure, order.serial, order.who)
    return {"id": site.catalogue.id_of(folder), "name": folder.name}


def _identities(found: dict[str, Any]) -> list[dict[str, str]]:
    return [
        {name: one.get(name, "") for name in ("manufacturer", "model", "serial")}
        for one in found.get("instruments", {}).values()
    ]
