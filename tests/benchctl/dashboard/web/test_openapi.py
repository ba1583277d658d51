"""The interface held against its own description: by hand, and by a fuzzer that knows nothing else of it."""

from __future__ import annotations

import pytest
import schemathesis
from hypothesis import HealthCheck, given, settings
from hypothesis.strategies import one_of
from schemathesis import Case, GenerationMode
from schemathesis.specs.openapi.checks import positive_data_acceptance

from tests.benchctl.dashboard.web.conftest import OVER, RUNNING
from tests.benchctl.dashboard.web.serving import Served

OPERATIONS = {
    "POST /api/session",
    "GET /api/session",
    "DELETE /api/session",
    "GET /api/campaigns",
    "GET /api/campaigns/{key}",
    "GET /api/campaigns/{key}/series",
    "GET /api/campaigns/{key}/events",
    "GET /api/campaigns/{key}/documents/{kind}",
    "GET /api/campaigns/{key}/documents/{kind}/report",
    "POST /api/campaigns/{key}/stop",
    "POST /api/campaigns/{key}/answer",
    "POST /api/campaigns/{key}/sign",
    "GET /api/released",
    "POST /api/check",
    "POST /api/start",
    "GET /api/queue",
    "POST /api/queue",
    "POST /api/queue/{order}/remove",
    "POST /api/queue/go_on",
    "GET /api/history",
    "GET /api/explain/{term}",
    "GET /api/help",
}
MORE_THAN_THE_SCHEMA = {
    "GET /api/campaigns/{key}/series",
    "POST /api/campaigns/{key}/stop",
    "POST /api/campaigns/{key}/answer",
    "POST /api/campaigns/{key}/sign",
    "POST /api/check",
    "POST /api/start",
    "POST /api/queue",
    "POST /api/queue/{order}/remove",
    "POST /api/queue/go_on",
}
"""What a schema cannot say: that a window ends after it began, what the campaign is called, what it asks, and what is
released."""


def test_the_description_has_every_operation_and_how_to_be_let_in(served: Served) -> None:
    with served.client() as client:
        schema = client.get("/api/openapi.json").json()
    found = {f"{method.upper()} {path}" for path, methods in schema["paths"].items() for method in methods}
    assert found == OPERATIONS
    assert set(schema["components"]["securitySchemes"]) == {"token", "session"}
    assert schema["security"] == [{"token": []}, {"session": []}]
    for path, methods in schema["paths"].items():
        for method, operation in methods.items():
            assert "401" in operation["responses"], f"{method} {path}"
            assert operation["description"].endswith("."), f"{method} {path}"


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("mode", GenerationMode, ids=lambda mode: mode.value)
@pytest.mark.parametrize("label", sorted(OPERATIONS))
def test_whatever_is_sent_the_answer_is_as_described_and_never_a_fault_of_the_server(
    served: Served, label: str, mode: GenerationMode
) -> None:
    bearer = {"Authorization": f"Bearer {served.token}"}
    schema = schemathesis.openapi.from_url(f"{served.url}api/openapi.json", headers=bearer)
    operation = next(found.ok() for found in schema.get_all_operations() if found.ok().label == label)
    cases = [operation.as_strategy(mode)]
    if "{key}" in label:  # by chance it would find no campaign
        cases += [operation.as_strategy(mode, path_parameters={"key": served.key_of(name)}) for name in (OVER, RUNNING)]
    excluded = [positive_data_acceptance] if label in MORE_THAN_THE_SCHEMA else []
    sent = 0

    @settings(max_examples=100, deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck))
    @given(case=one_of(cases))
    def holds(case: Case) -> None:
        nonlocal sent
        sent += 1
        case.call_and_validate(headers=bearer, excluded_checks=excluded)

    holds()
    assert sent > 0
    with served.client() as client:
        assert client.get("/api/campaigns").status_code == 200
