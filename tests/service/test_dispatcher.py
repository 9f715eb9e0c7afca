"""The dispatcher tells the broker of queued jobs, survives its absence, and reaps."""

from __future__ import annotations

import base64
import json
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import redis

from service.db import read_models
from service.db.session import Database
from service.dispatcher import Dispatcher, run_dispatcher
from service.domain.states import JobKind, JobState
from service.queue import BROKER_SETTINGS, QUEUE_NAME, BrokerAway, Publisher
from service.settings import Settings
from tests.builders.refusals import REFUSALS, Server, running_valkey
from tests.builders.studies import a_simulate_job, a_study, claimed, job, let_lease_expire, open_jobs


@pytest.fixture
def broker_settings(tmp_path_factory: pytest.TempPathFactory, sqlite_database: Database) -> Settings:
    return Settings(data_dir=tmp_path_factory.mktemp("d"), database_url=sqlite_database.url)


@pytest.fixture
def server(broker_settings: Settings) -> Iterator[Server]:
    with running_valkey(broker_settings) as running:
        yield running


@pytest.fixture
def valkey(server: Server) -> redis.Redis:
    return server.client


def messages(client: redis.Redis) -> list[tuple[str, Any]]:
    """Task names and arguments in the queue, oldest first."""
    found = []
    for raw in client.lrange(QUEUE_NAME, 0, -1)[::-1]:
        envelope = json.loads(raw)
        arguments = json.loads(base64.b64decode(envelope["body"]))[0]
        found.append((envelope["headers"]["task"], arguments))
    return found


def test_queued_jobs_are_published_once_with_their_task_and_id(
    valkey: redis.Redis, broker_settings: Settings, sqlite_database: Database
) -> None:
    study_id, simulate_id = a_simulate_job(sqlite_database)
    (propose_id,) = open_jobs(sqlite_database, study_id, JobKind.PROPOSE)
    with Publisher(broker_settings.resolved_broker_url) as publisher:
        dispatcher = Dispatcher(sqlite_database, publisher)
        assert dispatcher.publish() == 2
        assert dispatcher.publish() == 0
    assert sorted(messages(valkey)) == [("talus.propose", [propose_id]), ("talus.simulate", [simulate_id])]
    assert job(sqlite_database, simulate_id).published_at is not None


def test_a_job_that_was_lost_gets_a_new_message(
    valkey: redis.Redis, broker_settings: Settings, sqlite_database: Database
) -> None:
    _, job_id = a_simulate_job(sqlite_database, parallel=1)
    with Publisher(broker_settings.resolved_broker_url) as publisher:
        dispatcher = Dispatcher(sqlite_database, publisher)
        dispatcher.publish()
        claimed(sqlite_database, job_id)
        let_lease_expire(sqlite_database, job_id)
        assert dispatcher.reap() == 1
        assert dispatcher.reap() == 0
        assert dispatcher.publish() == 1
    assert messages(valkey) == [("talus.simulate", [job_id])] * 2


def test_a_broker_that_is_away_costs_nothing_and_is_reported(
    broker_settings: Settings, sqlite_database: Database
) -> None:
    study_id = a_study(sqlite_database)
    (job_id,) = open_jobs(sqlite_database, study_id)
    with Publisher(broker_settings.resolved_broker_url) as publisher:
        dispatcher = Dispatcher(sqlite_database, publisher)
        assert dispatcher.publish() == 0
        assert job(sqlite_database, job_id).published_at is None
        dispatcher.report()
        with sqlite_database.reading() as session:
            (row,) = read_models.seen_lately(session, "dispatcher", 5.0)
        assert row.problem is not None
        assert "rror" in row.problem


@pytest.mark.parametrize("name", REFUSALS)
def test_a_broker_that_refuses_writes_is_away_until_it_takes_them(
    server: Server, broker_settings: Settings, sqlite_database: Database, name: str
) -> None:
    refusal = REFUSALS[name]
    with Publisher(broker_settings.resolved_broker_url) as publisher:
        dispatcher = Dispatcher(sqlite_database, publisher)
        first = a_study(sqlite_database)
        assert dispatcher.publish() == 1
        refusal.begin(server)
        second = a_study(sqlite_database)
        assert dispatcher.publish() == 0
        assert job(sqlite_database, open_jobs(sqlite_database, second)[0]).published_at is None
        dispatcher.report()
        with sqlite_database.reading() as session:
            (row,) = read_models.seen_lately(session, "dispatcher", 60.0)
        assert row.problem is not None
        assert refusal.text in row.problem
        refusal.end(server)
        dispatcher.report()
        assert dispatcher.publish() == 1
    told = [arguments for _, arguments in messages(server.client)]
    assert open_jobs(sqlite_database, second) in told
    assert (open_jobs(sqlite_database, first) in told) is (name != "queue is no list")
    with sqlite_database.reading() as session:
        (row,) = read_models.seen_lately(session, "dispatcher", 60.0)
    assert row.problem is None


def test_a_broker_that_never_answers_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """A black hole: connections are accepted and nothing comes back."""
    options = {"socket_timeout": 0.2, "socket_connect_timeout": 0.2, "max_retries": 0}
    monkeypatch.setitem(BROKER_SETTINGS, "broker_transport_options", options)
    with (
        socket.create_server(("127.0.0.1", 0)) as hole,
        Publisher(f"redis://127.0.0.1:{hole.getsockname()[1]}/0") as publisher,
    ):
        start = time.monotonic()
        with pytest.raises(BrokerAway):
            publisher.publish(JobKind.PROPOSE, "id")
        assert time.monotonic() - start < 10.0


def test_the_loop_publishes_when_the_broker_comes_and_stops_when_told(
    valkey: redis.Redis, broker_settings: Settings, sqlite_database: Database
) -> None:
    stop = threading.Event()
    thread = threading.Thread(target=run_dispatcher, args=(broker_settings, stop))
    thread.start()
    study_id = a_study(sqlite_database)
    (job_id,) = open_jobs(sqlite_database, study_id)
    deadline = time.monotonic() + 10.0
    while not messages(valkey):
        assert time.monotonic() < deadline, "nothing was published"
        time.sleep(0.02)
    assert messages(valkey) == [("talus.propose", [job_id])]
    stop.set()
    thread.join(5.0)
    assert not thread.is_alive()
    with sqlite_database.reading() as session:
        assert read_models.seen_lately(session, "dispatcher", 60.0) == []
    assert job(sqlite_database, job_id).state is JobState.QUEUED


def test_a_message_names_no_worker_code() -> None:
    """The API's and the dispatcher's processes load neither kernels nor surrogate."""
    program = "import sys, service.app, service.dispatcher; print(*sorted(sys.modules))"
    loaded = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(__file__).resolve().parents[2],
    ).stdout.split()
    assert "service.dispatcher" in loaded
    assert not {"numba", "sklearn", "worker", "scipy"} & set(loaded)
