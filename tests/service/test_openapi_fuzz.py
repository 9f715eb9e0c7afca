"""schemathesis over the whole document: whatever is sent, the answer is one that it knows, and no 5xx."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, given, settings
from schemathesis.checks import not_a_server_error
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    response_schema_conformance,
    status_code_conformance,
)

from service.app import create_app
from service.db.session import Database
from service.domain.access import Scope
from service.settings import Settings
from service.studies.manage_keys import create_key
from tests.builders.charges import charges
from tests.builders.diagnoses import a_data_set
from tests.builders.studies import a_finished_study

# A stream has no end to wait for while its study runs; its refusals are tried in test_event_stream.
LEFT_OUT = ("followStudy",)
CHECKS = (
    not_a_server_error,
    status_code_conformance,
    content_type_conformance,
    response_schema_conformance,
)


def schema_of(database: Database, folder: Path, auth: Any) -> Any:
    app = create_app(Settings(data_dir=folder, database_url=database.url, auth=auth))
    found = schemathesis.openapi.from_asgi("/openapi.json", app, headers=key_for(database, auth))
    return found.exclude(operation_id=list(LEFT_OUT))


def key_for(database: Database, auth: str) -> dict[str, str]:
    if auth == "off":
        return {}
    with database.writing() as session:
        return {"Authorization": f"Bearer {create_key(session, 'fuzz', Scope.ADMIN, 'default')[1].text}"}


def fuzz(database: Database, folder: Path, auth: str, examples: int) -> int:
    """Every operation with so many generated requests; the number of operations."""
    a_finished_study(database)
    charges(database)
    a_data_set(database)
    schema = schema_of(database, folder, auth)
    headers = key_for(database, auth)
    count = 0
    for result in schema.get_all_operations():
        operation = result.ok()
        count += 1
        send_many(operation, headers, examples)
    return count


def send_many(operation: Any, headers: dict[str, str], examples: int) -> None:
    """Generated requests to one operation, each answer checked."""

    @given(case=operation.as_strategy())
    @settings(
        max_examples=examples,
        deadline=None,
        database=None,
        derandomize=True,
        phases=[Phase.explicit, Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    def send(case: Any) -> None:
        case.call_and_validate(headers=headers, checks=list(CHECKS))

    send()


@pytest.mark.parametrize("auth", ["off", "on"])
def test_no_request_gets_a_5xx_or_an_answer_that_the_document_does_not_know(
    sqlite_database: Database, tmp_path: Path, auth: str
) -> None:
    assert fuzz(sqlite_database, tmp_path, auth, examples=2) > 45


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("auth", ["off", "on"])
def test_no_request_of_many_gets_a_5xx(database: Database, tmp_path: Path, auth: str) -> None:
    assert fuzz(database, tmp_path, auth, examples=60) > 45


def walk(database: Database, folder: Path, auth: str, walks: int, steps: int) -> Counter[str]:
    """Chains of requests in which each takes ids of an answer before it; how often each operation was asked."""
    a_finished_study(database)
    charges(database)
    a_data_set(database)
    headers, asked = key_for(database, auth), Counter[str]()

    class Walk(schema_of(database, folder, auth).as_state_machine()):  # type: ignore[misc]
        def get_call_kwargs(self, case: Any) -> dict[str, Any]:
            return {"headers": headers}

        def validate_response(self, response: Any, case: Any, **_others: Any) -> None:
            told = case.operation.definition.raw["operationId"]
            asked[f"{told} {response.status_code // 100}xx"] += 1
            case.validate_response(response, checks=list(CHECKS))

    Walk.run(
        settings=settings(
            max_examples=walks,
            stateful_step_count=steps,
            deadline=None,
            database=None,
            derandomize=True,
            phases=[Phase.generate],
            suppress_health_check=list(HealthCheck),
        )
    )
    return asked


def test_no_chain_of_requests_gets_a_5xx(sqlite_database: Database, tmp_path: Path) -> None:
    asked = walk(sqlite_database, tmp_path, "off", walks=2, steps=12)
    assert sum(asked.values()) > 10, asked


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("auth", ["off", "on"])
def test_no_long_chain_of_requests_gets_a_5xx(
    database: Database, tmp_path: Path, auth: str, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = walk(database, tmp_path, auth, walks=150, steps=30)
    with capsys.disabled():
        print(f"\n{sum(asked.values())} requests in chains: {dict(sorted(asked.items()))}")
    assert {"getStudy 2xx", "listDesigns 2xx", "getDesign 2xx"} <= asked.keys()
