"""Routes of campaigns: the list, the contents and results of one, and the request to stop a run."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Query
from fastapi import Path as PathParameter
from starlette.responses import Response

from benchctl.campaign.stop import NotRunningError, ask_by_file
from benchctl.dashboard.data.details import details_of
from benchctl.dashboard.data.documents import Kind, document, report_of
from benchctl.dashboard.data.events import events_after
from benchctl.dashboard.web.access import CallerOf, CsrfHeader, require
from benchctl.dashboard.web.answers import RefusalError, answer
from benchctl.dashboard.web.gate import REPORT_POLICY
from benchctl.dashboard.web.models import (
    Acceptance,
    Calibration,
    CampaignDetails,
    Campaigns,
    ChannelSeries,
    Diagnosis,
    Error,
    Events,
    StopAsked,
    StopOrder,
)
from benchctl.dashboard.web.site import Site, SiteOf
from benchctl.limits import LONGEST_TIME_S

MOST_PIXELS = 4000
MOST_EVENT_NUMBER = 1 << 31

Key = Annotated[str, PathParameter(pattern="^[0-9a-f]{16}$", description="The campaign's id, as the list has it.")]
Seconds = Annotated[float, Query(ge=-LONGEST_TIME_S, le=LONGEST_TIME_S, allow_inf_nan=False)]

router = APIRouter(
    prefix="/api/campaigns",
    tags=["campaigns"],
    responses={401: {"model": Error}, 422: {"model": Error}, 503: {"model": Error}},
)
_one: dict[int | str, dict[str, Any]] = {404: {"model": Error}}


@router.get("", response_model=Campaigns)
async def campaigns(site: SiteOf, caller: CallerOf) -> Response:
    """Return all campaigns below the folder, newest first."""
    return await answer(site.quick, lambda: {"campaigns": site.catalogue.list()})


@router.get("/{key}", response_model=CampaignDetails, responses=_one)
async def campaign(key: Key, site: SiteOf, caller: CallerOf) -> Response:
    """Return one campaign: plan, steps, channels, limits, provenance."""
    return await answer(site.heavy, lambda: _details(site, key))


@router.get("/{key}/series", response_model=ChannelSeries, responses=_one)
async def series(
    key: Key,
    site: SiteOf,
    caller: CallerOf,
    channel: Annotated[str, Query(pattern="^[A-Za-z][A-Za-z0-9_]*$", max_length=100)],
    from_s: Seconds,
    to_s: Seconds,
    pixels: Annotated[int, Query(ge=1, le=MOST_PIXELS)] = 1200,
) -> Response:
    """Return a channel between two times [s] on the campaign's own time axis."""
    return await answer(site.heavy, lambda: site.series.view(site.path_of(key), channel, from_s, to_s, pixels))


@router.get("/{key}/events", response_model=Events, responses=_one)
async def events(
    key: Key, site: SiteOf, caller: CallerOf, after: Annotated[int, Query(ge=0, le=MOST_EVENT_NUMBER)] = 0
) -> Response:
    """Return the journal as sentences, at most 500 lines after the one with that number."""
    return await answer(site.quick, lambda: events_after(site.path_of(key), after))


@router.get("/{key}/documents/{kind}", response_model=Calibration | Diagnosis | Acceptance, responses=_one)
async def stated(key: Key, kind: Kind, site: SiteOf, caller: CallerOf) -> Response:
    """Return a summary of a calibration, a diagnosis or an acceptance."""
    return await answer(site.heavy, lambda: _there(document(site.path_of(key), kind), kind))


@router.get(
    "/{key}/documents/{kind}/report",
    response_class=Response,
    responses={**_one, 200: {"content": {"text/html": {"schema": {"type": "string"}}}}},
)
async def report(key: Key, kind: Kind, site: SiteOf, caller: CallerOf) -> Response:
    """Return the stored report, for a frame without scripts."""
    content = await site.heavy.run(lambda: _there(report_of(site.path_of(key), kind), kind))
    headers = {"Content-Security-Policy": REPORT_POLICY}
    return Response(content, media_type="text/html; charset=utf-8", headers=headers)


@router.post(
    "/{key}/stop",
    status_code=202,
    response_model=StopAsked,
    responses={**_one, 400: {"model": Error}, 403: {"model": Error}, 409: {"model": Error}},
)
async def stop(
    key: Key, order: StopOrder, site: SiteOf, caller: CallerOf, x_csrf: CsrfHeader = None
) -> dict[str, bool]:
    """Request a run to stop as with Ctrl-C: table at rest, chamber safe, both read back, the recording closed."""
    require(caller, "operator", "stops a run")
    await site.quick.run(lambda: _ask_to_stop(site, key, order))
    return {"asked": True}


def _details(site: Site, key: str) -> dict[str, Any]:
    path, entry = site.path_of(key), site.catalogue.entry(key)
    details = {**details_of(path), **entry}
    if (
        entry["status"] != "running"
    ):  # a viewer of a campaign usually requests its channels next; running campaigns have priority
        site.series.prepare(path)
    return details


def _ask_to_stop(site: Site, key: str, order: StopOrder) -> None:
    folder = site.path_of(key)
    if order.confirm != site.catalogue.entry(key)["name"]:
        raise RefusalError(422, "confirm is not the name of this campaign; nothing was stopped")
    try:
        ask_by_file(folder, order.who or "operator")
    except NotRunningError as err:
        raise RefusalError(409, str(err)) from err


def _there(found: Any, kind: str) -> Any:
    if found is None:
        raise RefusalError(404, f"this campaign has no {kind}")
    return found
