"""`talus charge`: the request that it makes, what it says, the files that it leaves."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click
import pytest
from rich.console import Console

from service.client import charge as command
from service.settings import Settings


@pytest.mark.parametrize(
    ("charges", "cores", "expected"),
    [(1, 2, (1, 2)), (2, 2, (2, 1)), (5, 2, (2, 1)), (3, 8, (3, 2)), (1, 1, (1, 1))],
)
def test_a_service_that_is_started_for_charges_uses_all_cores(
    charges: int, cores: int, expected: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(command.os, "sched_getaffinity", lambda _: set(range(cores)))
    monkeypatch.delenv("TALUS_WORKERS", raising=False)
    monkeypatch.delenv("TALUS_THREADS", raising=False)
    found = command.all_cores_for(charges, Settings())
    assert (found.workers, found.threads) == expected


def test_workers_and_threads_that_the_user_set_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TALUS_WORKERS", "3")
    found = command.all_cores_for(1, Settings())
    assert (found.workers, found.threads) == (3, 1)


class FakeClient:
    """A service whose charges are over at the second look; the last one of several fails."""

    def __init__(self) -> None:
        self.asked: dict[str, Any] = {}
        self.looks = 0
        self.cancelled: list[int] = []

    def __enter__(self) -> FakeClient:
        return self

    def __exit__(self, *_: object) -> None:
        return None

    def create_charges(self, body: dict[str, Any]) -> dict[str, Any]:
        self.asked = body
        items = [{"id": n, "seed": n, "cost": {"text": "9 min"}} for n in body["seeds"]]
        return {"series": 1, "items": items}

    def charge(self, charge_id: int) -> dict[str, Any]:
        self.looks += 1
        over = self.looks > len(self.asked["seeds"])
        failed = charge_id == 2
        state = "RUNNING" if not over else "FAILED" if failed else "COMPLETE"
        findings = {"piles": 2, "far_height_m": 1.5, "far_size_m": 0.12, "depressions": ["behind the rod"]}
        return {
            "id": charge_id,
            "seed": charge_id,
            "state": state,
            "progress": None if over else {"phase": "charge", "fraction": 0.5},
            "failure_text": "nothing lies in the hopper" if failed else None,
            "findings": findings | {"near_height_m": None, "near_size_m": None},
            "artifacts": [{"id": 7, "kind": "report", "file_name": "../report.html"}],
        }

    def artifact(self, artifact_id: int) -> bytes:
        return b"<html>"

    def cancel_charge(self, charge_id: int) -> dict[str, Any]:
        self.cancelled.append(charge_id)
        return {"state": "CANCELLED"}


class Service:
    """What `running_service` gives."""

    url = "http://service"

    def wait_for(self, *checks: str) -> None:
        assert set(checks) == {"dispatcher", "workers"}


@pytest.fixture
def client(monkeypatch: pytest.MonkeyPatch) -> FakeClient:
    made = FakeClient()

    @contextmanager
    def running(_settings: Settings) -> Iterator[Service]:
        yield Service()

    monkeypatch.setattr(command, "running_service", running)
    monkeypatch.setattr(command, "Client", lambda _url: made)
    monkeypatch.setattr(command, "POLL_SECONDS", 0.0)
    return made


def run(settings: Settings, body: dict[str, Any], out: Path) -> tuple[int, str]:
    console = Console(file=io.StringIO(), width=200)
    status = command.charge(settings, body, out, console)
    return status, console.file.getvalue()  # type: ignore[attr-defined]


def test_a_charge_ends_with_its_report_on_disk(client: FakeClient, tmp_path: Path) -> None:
    status, told = run(Settings(data_dir=tmp_path), {"charge": "coke", "seeds": [1]}, tmp_path / "out")
    assert status == 0
    assert (tmp_path / "out" / "report.html").read_bytes() == b"<html>"
    assert "charge 1, seed 1: 9 min" in told
    assert "2 piles; far 1.50 m of 120 mm, near none; depressions: behind the rod" in told


def test_of_several_each_has_its_folder_and_a_failure_is_told(client: FakeClient, tmp_path: Path) -> None:
    status, told = run(Settings(data_dir=tmp_path), {"charge": "coke", "seeds": [1, 2]}, tmp_path / "out")
    assert status == 1
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["charge-1"]
    assert "charge 2: failed; nothing lies in the hopper" in told


def test_ctrl_c_cancels_what_is_under_way(
    client: FakeClient, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(command, "_wait", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run(Settings(data_dir=tmp_path), {"charge": "coke", "seeds": [1]}, tmp_path)
    assert client.cancelled == [1]


def test_an_object_is_given_as_json_or_as_a_file(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text('[belt]\nspeed_m_s = { value = 1.8, why = "measured" }\nwidth_mm = 650.0\n')
    expected = {"belt": {"speed_m_s": 1.8, "width_mm": 650.0}}
    assert command.read_object(str(file), "--plant") == expected
    assert command.read_object('{"belt": {"speed_m_s": 1.8, "width_mm": 650.0}}', "--plant") == expected
    for text in ("[1]", "{", str(tmp_path / "missing.json")):
        with pytest.raises(click.BadParameter):
            command.read_object(text, "--plant")
