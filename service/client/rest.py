"""The REST API as the command line uses it: a few calls, and a study's events as they happen.

A service that has answered and is then away (it restarts, its database does) is waited for wherever something is
only read, so that a command that follows a night's work outlives it.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self

import httpx
from tenacity import Retrying, retry_if_exception_type, stop_after_delay, wait_fixed

from service.settings import get_settings

# The service sends something at least every 15 s; silence for longer than this is a broken connection.
STREAM_SILENCE_SECONDS = 40.0
RECONNECT_SECONDS = 0.5
# The supervisor brings a dead API back within seconds; after this long the service counts as gone.
AWAY_SECONDS = 60.0
# To connect, and to wait for an answer: a charge's plant is checked before it is stored, which takes seconds on a
# machine whose cores simulate.
CONNECT_SECONDS = 10.0
READ_SECONDS = 60.0
TIMEOUT = httpx.Timeout(CONNECT_SECONDS, read=READ_SECONDS)
# A study of thousands of designs is a file of tens of megabytes.
FILE_SECONDS = 120.0


class RefusedError(Exception):
    """The service refused the request; the text is its own sentence."""

    def __init__(self, status: int, detail: str) -> None:
        super().__init__(detail)
        self.status = status


class ServiceAwayError(Exception):
    """The service does not answer, or says that it cannot at the moment."""


@dataclass(frozen=True)
class Event:
    """One server-sent event; `id` None for progress, which is not stored."""

    kind: str
    data: dict[str, Any]
    id: str | None = None


class Client:
    """A connection to one service; `with Client(url) as client`."""

    def __init__(
        self, base_url: str, transport: httpx.BaseTransport | None = None, api_key: str | None = None
    ) -> None:
        self.base_url = base_url.rstrip("/")
        key = get_settings().api_key if api_key is None else api_key
        headers = {} if key is None else {"Authorization": f"Bearer {key}"}
        self._http = httpx.Client(base_url=base_url, timeout=TIMEOUT, transport=transport, headers=headers)
        self._has_answered = False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        self._http.close()

    def create_study(self, body: dict[str, Any]) -> dict[str, Any]:
        return self._call("POST", "/v1/studies", body)

    def study(self, study_id: int) -> dict[str, Any]:
        return self._call("GET", f"/v1/studies/{study_id}")

    def studies(self, limit: int = 20) -> list[dict[str, Any]]:
        items: list[dict[str, Any]] = self._call("GET", f"/v1/studies?limit={limit}")["items"]
        return items

    def cancel_study(self, study_id: int) -> dict[str, Any]:
        return self._call("POST", f"/v1/studies/{study_id}/cancel")

    def pause_study(self, study_id: int) -> dict[str, Any]:
        return self._call("POST", f"/v1/studies/{study_id}/pause")

    def resume_study(self, study_id: int) -> dict[str, Any]:
        return self._call("POST", f"/v1/studies/{study_id}/resume")

    def extend_budget(self, study_id: int, budget: int) -> dict[str, Any]:
        return self._call("POST", f"/v1/studies/{study_id}/budget", {"budget": budget})

    def add_design(self, study_id: int, x: dict[str, float], seed: int | None = None) -> dict[str, Any]:
        return self._call("POST", f"/v1/studies/{study_id}/designs", {"x": x, "seed": seed})

    def rerun_design(self, design_id: int, same_seed: bool) -> dict[str, Any]:
        return self._call("POST", f"/v1/designs/{design_id}/rerun", {"same_seed": same_seed})

    def designs(self, study_id: int) -> list[dict[str, Any]]:
        """All designs of a study, page after page."""
        found: list[dict[str, Any]] = []
        cursor: int | None = 0
        while cursor is not None:
            answer = self._call("GET", f"/v1/studies/{study_id}/designs?limit=200&cursor={cursor}")
            found += answer["items"]
            cursor = answer["next_cursor"]
        return found

    def download(self, study_id: int, name: str) -> bytes:
        """`name`: export, designs.csv or designs.parquet."""
        return self._send("GET", f"/v1/studies/{study_id}/{name}", timeout=FILE_SECONDS).content

    def import_study(self, content: bytes) -> dict[str, Any]:
        headers = {"Content-Type": "application/json"}
        answer = self._send(
            "POST", "/v1/studies/import", content=content, headers=headers, timeout=FILE_SECONDS
        )
        study: dict[str, Any] = answer.json()
        return study

    def create_charges(self, body: dict[str, Any]) -> dict[str, Any]:
        return self._call("POST", "/v1/charges", body)

    def charge(self, charge_id: int) -> dict[str, Any]:
        return self._call("GET", f"/v1/charges/{charge_id}")

    def charges(self, limit: int = 20) -> list[dict[str, Any]]:
        items: list[dict[str, Any]] = self._call("GET", f"/v1/charges?limit={limit}")["items"]
        return items

    def cancel_charge(self, charge_id: int) -> dict[str, Any]:
        return self._call("POST", f"/v1/charges/{charge_id}/cancel")

    def compare_charges(self, body: dict[str, Any]) -> dict[str, Any]:
        return self._call("POST", "/v1/charges/comparison", body)

    def artifact(self, artifact_id: int) -> bytes:
        """A file's bytes."""
        return self._send("GET", f"/v1/artifacts/{artifact_id}", timeout=FILE_SECONDS).content

    def report(self, study_id: int) -> dict[str, Any] | None:
        """What the newest report says and of how many designs; None before there is one."""
        try:
            return self._call("GET", f"/v1/studies/{study_id}/report")
        except RefusedError as error:
            if error.status == 404:
                return None
            raise

    def report_page(self, kind: str, number: int) -> bytes:
        """The report of `studies` or `diagnoses` as a page. Asks for the row first: that refusal is a sentence."""
        self._call("GET", f"/v1/{kind}/{number}")
        return self._send("GET", f"/{kind}/{number}/report", timeout=FILE_SECONDS).content

    def create_data_set(self, name: str, tables: dict[str, str], planned: bool = False) -> dict[str, Any]:
        body = {"name": name, "tables": tables, "planned": planned}
        answer = self._send("POST", "/v1/measurements", json=body, timeout=FILE_SECONDS)
        data_set: dict[str, Any] = answer.json()
        return data_set

    def create_diagnosis(self, body: dict[str, Any]) -> dict[str, Any]:
        return self._call("POST", "/v1/diagnoses", body)

    def diagnosis(self, diagnosis_id: int) -> dict[str, Any]:
        return self._call("GET", f"/v1/diagnoses/{diagnosis_id}")

    def diagnoses(self, limit: int = 20) -> list[dict[str, Any]]:
        items: list[dict[str, Any]] = self._call("GET", f"/v1/diagnoses?limit={limit}")["items"]
        return items

    def cancel_diagnosis(self, diagnosis_id: int) -> dict[str, Any]:
        return self._call("POST", f"/v1/diagnoses/{diagnosis_id}/cancel")

    def readiness(self) -> dict[str, Any]:
        """The checks by name, also where the service says that it is not ready."""
        return self._call("GET", "/v1/health/ready", good=(200, 503))

    def events(self, study_id: int) -> Iterator[Event]:
        """All events of a study from its first to its last; a lost connection is taken up where it broke."""
        last: str | None = None
        heard = time.monotonic()
        while True:
            try:
                for event in self._stream(study_id, last):
                    heard = time.monotonic()
                    last = event.id or last
                    yield event
                    if event.kind == "study_finished":
                        return
            except httpx.TransportError as error:
                if time.monotonic() - heard > AWAY_SECONDS:
                    raise ServiceAwayError(f"no event from {self.base_url} ({error})") from error
            time.sleep(RECONNECT_SECONDS)

    def _stream(self, study_id: int, last: str | None) -> Iterator[Event]:
        headers = {"Accept": "text/event-stream"} | ({"Last-Event-ID": last} if last else {})
        timeout = httpx.Timeout(CONNECT_SECONDS, read=STREAM_SILENCE_SECONDS)
        path = f"/v1/studies/{study_id}/events"
        with self._http.stream("GET", path, headers=headers, timeout=timeout) as answer:
            if answer.status_code >= 500:
                raise httpx.ReadError(f"status {answer.status_code}")  # passes; the caller comes again
            if answer.is_error:
                answer.read()
                raise RefusedError(answer.status_code, detail_of(answer))
            yield from parse_events(answer.iter_lines())

    def _call(
        self, method: str, path: str, body: dict[str, Any] | None = None, good: tuple[int, ...] = ()
    ) -> dict[str, Any]:
        answer = self._send(method, path, good, json=body)
        content: dict[str, Any] = answer.json()
        return content

    def _send(self, method: str, path: str, good: tuple[int, ...] = (), **request: Any) -> httpx.Response:
        """Reading is tried again, writing is not: what it did before the answer was lost is not known."""
        waits = method == "GET" and self._has_answered
        patience = stop_after_delay(AWAY_SECONDS + READ_SECONDS if waits else 0.0)
        away = retry_if_exception_type(ServiceAwayError)
        again = Retrying(stop=patience, wait=wait_fixed(RECONNECT_SECONDS), retry=away, reraise=True)
        return again(self._send_once, method, path, good, **request)

    def _send_once(self, method: str, path: str, good: tuple[int, ...], **request: Any) -> httpx.Response:
        try:
            answer = self._http.request(method, path, **request)
        except httpx.TransportError as error:
            raise ServiceAwayError(
                f"no service answers at {self.base_url} ({error}); `talus serve` starts one, "
                "TALUS_PORT says where another is"
            ) from error
        if answer.is_error and answer.status_code not in good:
            if answer.status_code == httpx.codes.SERVICE_UNAVAILABLE:
                raise ServiceAwayError(detail_of(answer))
            raise RefusedError(answer.status_code, detail_of(answer))
        self._has_answered = True
        return answer


def detail_of(answer: httpx.Response) -> str:
    """The sentence of a problem+json answer, or what else there is to say."""
    try:
        content = answer.json()
    except ValueError:
        content = None
    if isinstance(content, dict) and content.get("detail"):
        return str(content["detail"])
    return f"the service answered {answer.status_code} {answer.reason_phrase}"


def parse_events(lines: Iterable[str]) -> Iterator[Event]:
    """Server-sent events out of their lines (HTML standard, section 9.2); comments are skipped."""
    fields: dict[str, str] = {}
    for line in lines:
        if line:
            name, _, value = line.partition(":")
            value = value.removeprefix(" ")
            if name == "data" and "data" in fields:
                fields["data"] += "\n" + value
            elif name:
                fields[name] = value
        else:
            if "data" in fields:
                yield Event(fields.get("event", "message"), json.loads(fields["data"]), fields.get("id"))
            fields = {}
