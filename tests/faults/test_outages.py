"""The broker away for a minute and the database for ten seconds: service.md's promises, on both databases."""

from __future__ import annotations

import pytest

from tests.faults.outages import BROKER_AWAY_S, DATABASE_AWAY_S, measure_outages


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("backend", ["sqlite", "postgresql"])
def test_work_is_taken_without_a_broker_and_nothing_is_lost_without_a_database(
    backend: str, capsys: pytest.CaptureFixture[str]
) -> None:
    broker, database = measure_outages(backend, BROKER_AWAY_S, DATABASE_AWAY_S)
    with capsys.disabled():
        print(f"\n{backend}: {broker.line()}\n{backend}: {database.line()}")
    assert broker.problems == [] and database.problems == []
    assert broker.answers.keys() == {201} and broker.finished_once == broker.jobs > 20
    assert database.answers[503] > 0 and database.finished_once == database.jobs > 0
