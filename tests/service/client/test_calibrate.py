"""`talus calibrate`: files that hold no request, the published ones, and what a study leaves in its folder."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
from rich.console import Console

from service.api.study_body import StudyBody
from service.cli import main
from service.client import calibrate as calibration
from service.client.local_service import LocalService
from service.client.rest import Client, RefusedError
from service.settings import Settings
from tests.service.client.test_demo import STUDY

PUBLISHED = sorted((Path(__file__).parents[3] / "docs" / "studies").glob("*.json"))


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"{", "is no JSON"),
        (b"[1]", "holds list, not an object"),
        (b"\xff\xfe", "is no JSON"),
    ],
)
def test_a_file_without_a_request_is_one_line_and_status_2(
    content: bytes, told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "request.json"
    file.write_bytes(content)
    assert main(["calibrate", str(file)]) == 2
    error = capsys.readouterr().err
    assert told in error
    assert error.count("\n") == 1


def test_a_missing_file_is_one_line_and_status_2(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", "nowhere.json"]) == 2
    assert "'nowhere.json' does not exist" in capsys.readouterr().err


@pytest.mark.parametrize("file", PUBLISHED, ids=lambda file: file.stem)
def test_the_published_requests_are_still_accepted(file: Path) -> None:
    spec = StudyBody.model_validate(calibration.read_request(file)).to_spec()
    assert spec.material == file.stem.split("_")[0]


def test_the_published_requests_are_the_papers_three() -> None:
    assert {"coke", "sinter", "pellet"} <= {file.stem for file in PUBLISHED}


class Scripted:
    """A service that has finished whatever study it is asked for, or refuses it."""

    def __init__(self, refuses: bool = False) -> None:
        self.refuses = refuses
        self.asked: list[str] = []
        self.reports = [httpx.Response(404), httpx.Response(200, json={"is_current": False})]

    def __call__(self, request: httpx.Request) -> httpx.Response:
        path = request.url.path
        self.asked.append(f"{request.method} {path}")
        if request.method == "POST" and self.refuses:
            return httpx.Response(422, json={"detail": "budget 0: a whole number from 1 to 1000"})
        if path == "/v1/health/ready":
            return httpx.Response(200, json={"checks": {}})
        if path.endswith("/report"):
            return self.reports.pop(0) if self.reports else httpx.Response(200, json={"is_current": True})
        if path.endswith("/events"):
            return httpx.Response(
                200, content=b'id: 1\nevent: study_finished\ndata: {"state": "completed"}\n\n'
            )
        if path.endswith(("/export", "/designs.csv", "/designs.parquet")):
            return httpx.Response(200, content=path.encode())
        return httpx.Response(200, json=DONE)


DONE: dict[str, Any] = {**STUDY, "budget": 30, "spec": {**STUDY["spec"], "variables": {}, "seed": 1}}


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> Scripted:
    scripted = Scripted()

    def scripted_client(url: str) -> Client:
        return Client(url, httpx.MockTransport(scripted))

    @contextmanager
    def running(_settings: Settings) -> Iterator[LocalService]:
        yield LocalService("http://talus", Path("log"))

    monkeypatch.setattr(calibration, "Client", scripted_client)
    monkeypatch.setattr("service.client.local_service.Client", scripted_client)
    monkeypatch.setattr(calibration, "running_service", running)
    monkeypatch.setattr(calibration, "POLL_SECONDS", 0.0)
    return scripted


def test_a_study_leaves_its_files_and_its_figures(script: Scripted, tmp_path: Path) -> None:
    out, told = tmp_path / "a" / "b", io.StringIO()
    assert calibration.calibrate(Settings(), {"material": "pellet"}, out, Console(file=told, width=100)) == 0
    assert (out / "study.json").read_bytes() == b"/v1/studies/4/export"
    assert {file.name for file in out.iterdir()} == {"study.json", "designs.csv", "designs.parquet"}
    assert "angle_deg 25.44 deg, certified" in told.getvalue()
    assert script.asked[0] == "POST /v1/studies"
    # The files come after the report on all designs: none at first, then one of earlier.
    assert script.asked.index("GET /v1/studies/4/export") > script.asked.index("GET /v1/studies/4/report")
    assert script.asked.count("GET /v1/studies/4/report") == 3


def test_files_come_without_a_report_that_does_not(
    script: Scripted, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(calibration, "REPORT_SECONDS", 0.05)
    script.reports = [httpx.Response(404)] * 1000
    told = io.StringIO()
    assert calibration.calibrate(Settings(), {"material": "pellet"}, tmp_path, Console(file=told)) == 0
    assert "The report is not written yet" in told.getvalue()
    assert (tmp_path / "study.json").exists()


def test_a_refusal_leaves_nothing(script: Scripted, tmp_path: Path) -> None:
    script.refuses = True
    with pytest.raises(RefusedError, match="a whole number from 1 to 1000"):
        calibration.calibrate(Settings(), {"budget": 0}, tmp_path / "out", Console(file=io.StringIO()))
    assert not (tmp_path / "out").exists()
    assert script.asked == ["POST /v1/studies"]
