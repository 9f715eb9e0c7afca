"""Settings: defaults that hang together, TALUS_ variables, refusals that name the variable."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from pydantic import ValidationError

from service.settings import LONGEST_SOCKET_PATH, Settings, describe_problems, get_settings


@pytest.fixture(autouse=True)
def clean_environment(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name in [name for name in os.environ if name.startswith("TALUS_")]:
        monkeypatch.delenv(name)
    monkeypatch.chdir(tmp_path)
    get_settings.cache_clear()


def refusal(**given: object) -> str:
    with pytest.raises(ValidationError) as caught:
        Settings.model_validate(given)
    return describe_problems(caught.value)


def test_defaults_live_below_var(tmp_path: Path) -> None:
    settings = Settings()
    assert settings.data_dir == tmp_path / "var"
    assert settings.resolved_database_url == f"sqlite:///{tmp_path}/var/talus.db"
    assert settings.artifacts_dir == tmp_path / "var" / "artifacts"
    assert settings.embeds_broker
    assert settings.resolved_broker_url.startswith("redis+socket:///")
    assert settings.base_url == "http://127.0.0.1:8642"


def test_the_environment_is_read_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TALUS_WORKERS", "7")
    monkeypatch.setenv("TALUS_LOG_LEVEL", "DEBUG")
    assert get_settings().workers == 7
    assert get_settings().log_level == "debug"
    monkeypatch.setenv("TALUS_WORKERS", "8")
    assert get_settings().workers == 7


def test_a_data_dir_stays_where_it_was_when_the_process_moves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = Settings(data_dir=Path("here"))
    monkeypatch.chdir("/")
    assert settings.artifacts_dir == tmp_path / "here" / "artifacts"


def test_postgresql_gets_its_driver() -> None:
    settings = Settings(database_url="postgresql://talus:secret@db/talus")
    assert settings.resolved_database_url == "postgresql+psycopg://talus:secret@db/talus"


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("port", 0, "greater than or equal to 1"),
        ("port", "http", "valid integer"),
        ("lease_seconds", 0.5, "greater than or equal to 1"),
        ("log_level", "loud", "'debug', 'info', 'warning' or 'error'"),
        ("workers", -1, "greater than or equal to 0"),
        ("data_dir", "what?", "question mark"),
    ],
)
def test_a_refusal_names_variable_value_and_limit(name: str, value: object, words: str) -> None:
    text = refusal(**{name: value})
    assert f"TALUS_{name.upper()}={value!r}: " in text
    assert words in text


@pytest.mark.parametrize("name", ["database_url", "broker_url"])
def test_a_refused_url_does_not_show_its_password(name: str) -> None:
    text = refusal(**{name: "amqp://user:geheim@host"})
    assert f"TALUS_{name.upper()}: must start with" in text
    assert "geheim" not in text


def test_a_file_is_no_data_dir(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert "is a file" in refusal(data_dir=tmp_path / "file")


@pytest.mark.parametrize("length", [5, 60, 300])
def test_the_socket_path_always_fits(tmp_path: Path, length: int) -> None:
    settings = Settings(data_dir=tmp_path / ("d" * min(length, 200)) / ("e" * length)[:200])
    assert len(os.fsencode(settings.broker_socket)) <= LONGEST_SOCKET_PATH


def test_two_long_data_dirs_have_two_sockets(tmp_path: Path) -> None:
    sockets = {Settings(data_dir=tmp_path / (letter * 120)).broker_socket for letter in "ab"}
    assert len(sockets) == 2


def test_a_client_does_not_call_the_wildcard_address() -> None:
    assert Settings(host="0.0.0.0", port=1234).base_url == "http://127.0.0.1:1234"
