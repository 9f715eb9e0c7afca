"""The environment that children get: every setting resolved, kernels cached where they can be."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from service import processes
from service.settings import Settings


@pytest.fixture(autouse=True)
def clean_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in os.environ if name.startswith(("TALUS_", "NUMBA_"))]:
        monkeypatch.delenv(name)


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return Settings(data_dir=tmp_path, port=1234, workers=3, lease_seconds=5.5, log_level="warning")


def test_a_child_resolves_the_same_settings(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in processes.environment(settings, processes.long_running(settings)[0]).items():
        monkeypatch.setenv(name, value)
    child = Settings()
    mine = settings.model_dump(exclude={"database_url", "broker_url", "workers"})
    assert child.model_dump(exclude={"database_url", "broker_url", "workers"}) == mine
    assert child.resolved_database_url == settings.resolved_database_url
    assert child.resolved_broker_url == settings.resolved_broker_url


def test_as_many_workers_as_asked_for_each_on_one_thread(settings: Settings) -> None:
    workers = [spec for spec in processes.long_running(settings) if "worker.app" in spec.command]
    assert [spec.name for spec in workers] == ["worker-1", "worker-2", "worker-3"]
    for spec in workers:
        assert spec.command[spec.command.index("--concurrency") + 1] == "1"
        assert processes.environment(settings, spec)["NUMBA_NUM_THREADS"] == "1"


def test_kernels_of_a_read_only_install_are_cached_with_the_data(
    settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert processes.compiled_kernels(settings) == {}
    monkeypatch.setattr(os, "access", lambda *_: False)
    assert processes.compiled_kernels(settings) == {"NUMBA_CACHE_DIR": str(settings.data_dir / "numba")}
