"""Run a verb on many recordings, on a cluster, and collect what is stated of each."""

from __future__ import annotations

import uuid
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from benchctl.campaign.stop import StoppedError, StopRequest
from benchctl.fleet.cluster import connected, outcomes, refuse_without_dask
from benchctl.fleet.job import Job, JobRecord, Options, Outcome, kept, record_at
from benchctl.fleet.located import Located
from benchctl.fleet.places import Place, place_of
from benchctl.reports.fleet_facts import Fleet, Member
from benchctl.reports.fleet_stated import REPORTS, VERBS, FleetVerb
from benchctl.side_by_side import cores
from benchctl_instruments.errors import BenchError, LinkError


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Where a fleet runs and where its results land; None: processes on this machine, and next to each recording."""

    scheduler: str | None = None
    workers: int | None = None
    out: str | None = None
    again: bool = False


def run_fleet(
    verb: FleetVerb,
    recordings: Sequence[Located],
    options: Options,
    settings: Settings,
    on_outcome: Callable[[Job, Outcome], None],
    say: Callable[[str], None],
    stop: StopRequest,
) -> Fleet:
    """Run a verb on recordings that need it; `on_outcome` is called with each outcome, `say` with warnings.

    Raises
    ------
    UsageError
        Where dask is not installed, or no scheduler answers.
    """
    run = uuid.uuid4().hex
    jobs = [
        Job(
            verb=verb,
            recording=recording,
            place=place_of(recording, verb, settings.out),
            options=options,
            run=run,
            again=settings.again,
        )
        for recording in recordings
    ]
    ended: dict[str, Outcome] = {}

    def end(job: Job, outcome: Outcome) -> None:
        ended[job.recording.where] = outcome
        on_outcome(job, outcome)

    for job in jobs:
        if (outcome := kept(job)) is not None:
            end(job, outcome)
    to_do = [job for job in jobs if job.recording.where not in ended]
    if to_do:
        refuse_without_dask()
        workers = min(settings.workers or cores(), len(to_do))
        try:
            with connected(settings.scheduler, workers) as client:
                if not client.nthreads():
                    say(f"no workers at {settings.scheduler} yet: waiting; dask worker {settings.scheduler} starts one")
                for job, outcome in outcomes(client, to_do, stop):
                    end(job, outcome)
        except LinkError as err:
            say(str(err))
        except StoppedError:
            if settings.scheduler is None:  # its workers are dead; others' finish what they are at
                for job in to_do:
                    job.place.end()
    members = tuple(
        _member(job, ended[job.recording.where], settings.out) for job in jobs if job.recording.where in ended
    )
    return Fleet(verb=verb, members=members, left=len(jobs) - len(ended))


def _member(job: Job, outcome: Outcome, out: str | None) -> Member:
    """A recording of the fleet with what is stated of it: by this verb, and before by the others."""
    records: dict[FleetVerb, JobRecord] = {}
    for verb in VERBS:
        place = place_of(job.recording, verb, out)
        record = outcome.record if verb == job.verb else _still_true(place, verb, job.recording)
        if record is not None:
            records[verb] = record
    unit = next(iter(records.values()), None)
    return Member(
        recording=job.recording.where,
        name=job.recording.name,
        serial=unit.serial if unit else "",
        model=unit.model if unit else "",
        state=outcome.state,
        says=outcome.reason,
        stated={verb: record.stated for verb, record in records.items()},
        reports={verb: f"{place_of(job.recording, verb, out).where}/{REPORTS[verb]}" for verb in records},
    )


def _still_true(place: Place, verb: FleetVerb, recording: Located) -> JobRecord | None:
    """What another verb stated of a recording that has not changed since."""
    try:
        record = record_at(place, verb)
    except BenchError:
        return None
    return record if record is not None and record.stamp == recording.stamp != () else None
