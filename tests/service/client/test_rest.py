"""The REST client against a scripted server: parsing, refusals, a stream that breaks and goes on."""

from __future__ import annotations

import json

import httpx
import pytest

from service.client import rest
from service.client.rest import Client, Event, RefusedError, ServiceAwayError, parse_events


def test_events_are_parsed_as_the_standard_says() -> None:
    lines = [
        ": a comment",
        "",
        "id: 7",
        "event: design_finished",
        'data: {"number":',
        "data: 3}",
        "",
        "data: {}",
        "",
    ]
    assert list(parse_events(lines)) == [
        Event("design_finished", {"number": 3}, "7"),
        Event("message", {}, None),
    ]


def test_an_unfinished_event_is_not_told() -> None:
    assert list(parse_events(["event: x", 'data: {"a": 1}'])) == []


def sse(*events: tuple[int, str, dict[str, object]]) -> bytes:
    return "".join(
        f"id: {n}\nevent: {kind}\ndata: {json.dumps(data)}\n\n" for n, kind, data in events
    ).encode()


def test_a_broken_stream_is_taken_up_after_the_last_event(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rest, "RECONNECT_SECONDS", 0.0)
    asked: list[str | None] = []

    def answer(request: httpx.Request) -> httpx.Response:
        asked.append(request.headers.get("Last-Event-ID"))
        match len(asked):
            case 1:
                return httpx.Response(200, content=sse((4, "study_created", {})))
            case 2:
                raise httpx.ConnectError("away")
            case 3:
                return httpx.Response(503)
            case _:
                return httpx.Response(200, content=sse((5, "study_finished", {"state": "completed"})))

    with Client("http://talus", httpx.MockTransport(answer)) as client:
        kinds = [event.kind for event in client.events(1)]
    assert kinds == ["study_created", "study_finished"]
    assert asked == [None, "4", "4", "4"]


def test_a_service_that_stays_away_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rest, "RECONNECT_SECONDS", 0.0)
    monkeypatch.setattr(rest, "AWAY_SECONDS", 0.05)

    def away(request: httpx.Request) -> httpx.Response:
        raise httpx.ConnectError("away")

    with Client("http://talus", httpx.MockTransport(away)) as client:
        with pytest.raises(ServiceAwayError, match="http://talus"):
            list(client.events(1))
        with pytest.raises(ServiceAwayError, match="no service answers at http://talus"):
            client.studies()


@pytest.mark.parametrize(
    ("answer", "text"),
    [
        (
            httpx.Response(422, json={"detail": "material: got 'x', allowed is coke"}),
            "material: got 'x', allowed is coke",
        ),
        (httpx.Response(413, text="too large"), "the service answered 413 Request Entity Too Large"),
        (httpx.Response(404, json=["odd"]), "the service answered 404 Not Found"),
    ],
)
def test_a_refusal_is_the_services_own_sentence(answer: httpx.Response, text: str) -> None:
    with (
        Client("http://talus", httpx.MockTransport(lambda _: answer)) as client,
        pytest.raises(RefusedError) as caught,
    ):
        client.create_study({"material": "x"})
    assert str(caught.value) == text
    assert caught.value.status == answer.status_code


def test_an_unready_service_still_says_what_is_missing() -> None:
    body = {"ready": False, "checks": {"schema": {"ok": False, "reason": "old"}}}
    with Client("http://talus", httpx.MockTransport(lambda _: httpx.Response(503, json=body))) as client:
        assert client.readiness()["checks"]["schema"]["reason"] == "old"


def scripted(*answers: httpx.Response | Exception) -> httpx.MockTransport:
    """One answer after the other; the last one again and again."""
    left = list(answers)

    def answer(_request: httpx.Request) -> httpx.Response:
        found = left.pop(0) if len(left) > 1 else left[0]
        if isinstance(found, Exception):
            raise found
        return found

    return httpx.MockTransport(answer)


GONE = httpx.ConnectError("connection refused")
BUSY = httpx.Response(503, json={"detail": "the database does not answer"})


def test_who_follows_a_charge_outlives_a_restart(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rest, "RECONNECT_SECONDS", 0.0)
    running, over = (httpx.Response(200, json={"state": state}) for state in ("RUNNING", "COMPLETE"))
    with Client("http://talus", scripted(running, GONE, GONE, BUSY, over)) as client:
        assert client.charge(1)["state"] == "RUNNING"
        assert client.charge(1)["state"] == "COMPLETE"


def test_one_that_stays_away_is_told_in_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("RECONNECT_SECONDS", "AWAY_SECONDS", "READ_SECONDS"):
        monkeypatch.setattr(rest, name, 0.01)
    with Client("http://talus", scripted(httpx.Response(200, json={}), BUSY)) as client:
        client.charge(1)
        with pytest.raises(ServiceAwayError, match="the database does not answer"):
            client.charge(1)


def test_one_that_never_answered_is_not_waited_for() -> None:
    """`talus status` without a service ends at once: patience would be some minutes."""
    asked = []

    def answer(request: httpx.Request) -> httpx.Response:
        asked.append(request)
        raise GONE

    with Client("http://talus", httpx.MockTransport(answer)) as client, pytest.raises(ServiceAwayError):
        client.charge(1)
    assert len(asked) == 1


def test_nothing_is_written_twice() -> None:
    """An answer that was lost may have been one to a job that is there."""
    answers = scripted(httpx.Response(200, json={}), GONE, httpx.Response(201, json={"id": 1}))
    with Client("http://talus", answers) as client:
        client.charge(1)
        with pytest.raises(ServiceAwayError):
            client.create_study({"material": "coke"})
