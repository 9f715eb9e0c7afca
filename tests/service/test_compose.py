"""compose.yaml is the supervisor's layout in containers: same commands, health checks, no default secret."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from service import processes
from service.settings import Settings

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def compose() -> dict[str, Any]:
    content: dict[str, Any] = yaml.safe_load((ROOT / "compose.yaml").read_text())
    return content


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return Settings(data_dir=tmp_path, host="0.0.0.0", port=8642)


def command(compose: dict[str, Any], service: str) -> list[str]:
    words: list[str] = compose["services"][service]["command"]
    assert words[0] == "python"
    return [sys.executable, *words[1:]]


def test_commands_are_the_supervisors(compose: dict[str, Any], settings: Settings) -> None:
    assert command(compose, "migrate") == [*processes.migrate_command()]
    assert command(compose, "api") == [*processes.api_command(settings)]
    assert command(compose, "beat") == [*processes.dispatcher_command()]
    assert command(compose, "worker") == [*processes.worker_command("worker", settings)]


def test_nothing_the_supervisor_runs_is_missing(compose: dict[str, Any], settings: Settings) -> None:
    supervised = {re.sub(r"-\d+$", "", spec.name) for spec in processes.long_running(settings)}
    renamed = {"beat" if name == "dispatcher" else name for name in supervised}
    assert set(compose["services"]) == renamed | {"migrate", "postgres", "redis"}


def test_the_broker_keeps_what_it_got(compose: dict[str, Any], settings: Settings) -> None:
    ours = " ".join(processes.broker_process(settings).command)
    for option in ("--appendonly yes", "--save ", "--maxmemory-policy noeviction"):
        assert option in " ".join(compose["services"]["redis"]["command"])
        assert option in ours


def test_workers_are_single_threaded(compose: dict[str, Any]) -> None:
    environment = compose["services"]["worker"]["environment"]
    assert processes.SINGLE_THREADED.items() <= environment.items()


def test_everything_that_stays_up_has_a_health_check(compose: dict[str, Any]) -> None:
    without = [name for name, service in compose["services"].items() if "healthcheck" not in service]
    assert without == ["migrate"]


def test_data_lies_in_named_volumes(compose: dict[str, Any]) -> None:
    assert set(compose["volumes"]) == {"data", "postgres", "redis"}
    used = {volume.split(":")[0] for service in compose["services"].values() for volume in service["volumes"]}
    assert used == set(compose["volumes"])


def test_no_secret_has_a_default() -> None:
    text = (ROOT / "compose.yaml").read_text()
    passwords = re.findall(r"\$\{(\w*(?:PASSWORD|SECRET|KEY)\w*)(:?.)", text)
    assert passwords
    assert {how for _, how in passwords} == {":?"}
    assert not re.search(r"(?i)(password|secret):\s*['\"]?[a-z0-9]", text)


def test_only_the_api_is_published_and_only_on_loopback(compose: dict[str, Any]) -> None:
    published = {
        name: service["ports"] for name, service in compose["services"].items() if "ports" in service
    }
    assert list(published) == ["api"]
    assert all(port.startswith("127.0.0.1:") for port in published["api"])


def test_settings_in_compose_exist(compose: dict[str, Any]) -> None:
    known = {f"TALUS_{name.upper()}" for name in Settings.model_fields}
    for service in compose["services"].values():
        given = {name for name in service.get("environment", {}) if name.startswith("TALUS_")}
        assert given <= known
