"""What is asked beside campaigns: units over time, words for a term, and the description of this interface."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from benchctl.dashboard.web.access import CallerOf
from benchctl.dashboard.web.answers import answer
from benchctl.dashboard.web.models import Error, Explanation, History
from benchctl.dashboard.web.refusal import RefusalError
from benchctl.dashboard.web.site import Site, SiteOf
from benchctl_instruments.errors import UsageError

router = APIRouter(prefix="/api", responses={401: {"model": Error}, 422: {"model": Error}, 503: {"model": Error}})

Term = Annotated[str, Path(min_length=1, max_length=100)]


@router.get("/history", response_model=History, responses={404: {"model": Error}}, tags=["units"])
async def history(site: SiteOf, caller: CallerOf) -> Response:
    """What calibrations and acceptances said of each unit over time."""
    return await answer(site.heavy, lambda: _history(site))


@router.get("/explain/{term}", response_model=Explanation, responses={404: {"model": Error}}, tags=["words"])
async def explain(term: Term, site: SiteOf, caller: CallerOf) -> Response:
    """Words for an effect, a metric or a term."""
    return await answer(site.heavy, lambda: _explained(site, term))


@router.get("/openapi.json", include_in_schema=False)
async def openapi(request: Request, caller: CallerOf) -> Response:
    """Describe the interface for programs."""
    return JSONResponse(request.app.openapi())


def _history(site: Site) -> object:
    from benchctl.dashboard.data.units import history_json  # its fits take seconds to import

    try:
        return history_json(site.root, site.cache)
    except UsageError as err:  # nothing below the folder states anything of a unit
        raise RefusalError(404, str(err)) from err


def _explained(site: Site, term: str) -> object:
    try:
        return site.explain(term)
    except UsageError as err:
        raise RefusalError(404, str(err)) from err
