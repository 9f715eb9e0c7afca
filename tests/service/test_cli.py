"""The command line's manners: bad input is one line on stderr and status 2."""

from __future__ import annotations

import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from service.cli import main
from service.settings import get_settings


@pytest.fixture(autouse=True)
def own_settings(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[None]:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        monkeypatch.setenv("TALUS_PORT", str(probe.getsockname()[1]))
    monkeypatch.setenv("TALUS_DATA_DIR", str(tmp_path / "data"))
    get_settings.cache_clear()
    yield
    get_settings.cache_clear()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["serv"], "No such command 'serv'"),
        (["demo", "--scale", "big"], "'big' is not a valid float"),
        (["demo", "--budget", "1.5"], "'1.5' is not a valid integer"),
        (["status", "one"], "'one' is not a valid integer"),
        (["studies", "--limit", "0"], "1<=x<=200"),
    ],
)
def test_bad_input_is_one_line_and_status_2(
    words: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    error = capsys.readouterr().err
    assert error.startswith("talus: ")
    assert error.count("\n") == 1
    assert told in error


def test_a_bad_setting_is_named(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("TALUS_WORKERS", "many")
    assert main(["studies"]) == 2
    assert "TALUS_WORKERS='many'" in capsys.readouterr().err


def test_no_service_is_one_line_and_status_1(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["status"]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert f"no service answers at {get_settings().base_url}" in error


def test_version_names_the_code(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["version"]) == 0
    assert capsys.readouterr().out.startswith("talus 0.")


def test_migrate_makes_the_database_and_may_run_again() -> None:
    assert main(["migrate"]) == 0
    assert (get_settings().data_dir / "talus.db").is_file()
    assert main(["migrate"]) == 0


def test_without_words_it_helps(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 0
    assert "serve" in capsys.readouterr().out


# What opens the database, talks to the broker, computes or reads an object store.
HEAVY = {"sqlalchemy", "alembic", "redis", "celery", "kombu", "numba", "numpy", "scipy", "fastapi", "fsspec"}


def test_a_command_that_asks_the_service_loads_nothing_heavy() -> None:
    """SQLAlchemy and redis were two thirds of what every command took to start."""
    program = (
        "import sys; from service.cli import main; "
        "codes = [main(words) for words in (['--help'], ['status'], ['retention', '--help'], ['version'])]; "
        "import service.supervisor; print(*codes); print(*sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(__file__).resolve().parents[2],
    )
    *_, codes, modules = done.stdout.splitlines()
    assert codes.split() == ["0", "1", "0", "0"]
    loaded = {name.partition(".")[0] for name in modules.split()}
    assert {"service", "click", "httpx"} <= loaded
    assert HEAVY & loaded == set()
