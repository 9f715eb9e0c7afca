"""What an installation can set: environment variables with the prefix TALUS_, and nothing else.

Everything that a process of the service needs to know about its surroundings is here, so that the supervisor,
the API, the dispatcher and the workers agree: they read the same variables.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Literal
from urllib.parse import quote

from pydantic import Field, ValidationError, field_validator, model_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

DATABASE_SCHEMES = ("sqlite:///", "postgresql+psycopg://")
BROKER_SCHEMES = ("redis://", "rediss://", "redis+socket://")

LOOPBACK = ("127.0.0.1", "::1", "localhost")

# sockaddr_un.sun_path holds 108 bytes with its closing zero on Linux, 104 on macOS.
LONGEST_SOCKET_PATH = 103


class StartupError(Exception):
    """The service cannot start as it is set up here; the text is the one line that the user reads."""


class Settings(BaseSettings):
    """The settings of one installation. Frozen; `get_settings()` gives the one of this process."""

    model_config = SettingsConfigDict(env_prefix="TALUS_", frozen=True, extra="forbid")

    data_dir: Annotated[Path, Field(description="database, broker log, artifacts and logs live below it")] = (
        Path("var")
    )
    database_url: Annotated[str | None, Field(description="default: SQLite in data_dir")] = None
    broker_url: Annotated[str | None, Field(description="default: the embedded Valkey in data_dir")] = None
    store_url: Annotated[
        str | None,
        Field(
            pattern=r"^[a-z0-9+.-]+://.+$",
            description="an object store for artifacts and geometries (s3://bucket/folder); default: data_dir",
        ),
    ] = None
    host: Annotated[str, Field(min_length=1)] = "127.0.0.1"
    port: Annotated[int, Field(ge=1, le=65535)] = 8642
    lease_seconds: Annotated[float, Field(ge=1.0, le=600.0)] = 10.0
    checkpoint_seconds: Annotated[float, Field(ge=0.1, le=3600.0)] = 30.0
    disk_pause_seconds: Annotated[
        float,
        Field(ge=1.0, le=3600.0, description="a job that found the disk full is tried again after this"),
    ] = 30.0
    workers: Annotated[int, Field(ge=0, le=256, description="worker processes that `talus serve` starts")] = 2
    threads: Annotated[
        int,
        Field(ge=1, le=256, description="of each worker; one each is fastest while all cores have a worker"),
    ] = 1
    worker_niceness: Annotated[
        int,
        Field(
            ge=0,
            le=19,
            description="workers compute in what requests and pages leave of the cores; 0: as they",
        ),
    ] = 10
    max_body_bytes: Annotated[int, Field(ge=1_000, le=1_000_000_000)] = 1_000_000
    max_import_bytes: Annotated[int, Field(ge=1_000, le=1_000_000_000)] = 50_000_000
    auth: Annotated[
        Literal["auto", "on", "off"],
        Field(description="whether requests need a key; auto: unless the service listens on loopback alone"),
    ] = "auto"
    api_key: Annotated[str | None, Field(description="the key that this machine's client commands send")] = (
        None
    )
    log_level: Literal["debug", "info", "warning", "error"] = "info"

    @field_validator("data_dir")
    @classmethod
    def _absolute(cls, value: Path) -> Path:
        if "?" in str(value):
            raise ValueError("a folder without a question mark is needed: it would end the database's URL")
        return Path(os.path.abspath(value.expanduser()))

    @field_validator("database_url")
    @classmethod
    def _known_database(cls, value: str | None) -> str | None:
        if value is None:
            return None
        if value.startswith("postgresql://"):
            value = "postgresql+psycopg://" + value.removeprefix("postgresql://")
        if not value.startswith(DATABASE_SCHEMES):
            raise ValueError("must start with " + " or ".join(DATABASE_SCHEMES))
        return value

    @field_validator("broker_url")
    @classmethod
    def _known_broker(cls, value: str | None) -> str | None:
        if value is not None and not value.startswith(BROKER_SCHEMES):
            raise ValueError("must start with " + " or ".join(BROKER_SCHEMES))
        return value

    @field_validator("log_level", mode="before")
    @classmethod
    def _any_case(cls, value: object) -> object:
        return value.lower() if isinstance(value, str) else value

    @model_validator(mode="after")
    def _data_dir_is_a_folder(self) -> Settings:
        if self.data_dir.exists() and not self.data_dir.is_dir():
            raise ValueError(f"data_dir {self.data_dir} is a file, a folder is needed")
        return self

    @property
    def resolved_database_url(self) -> str:
        return self.database_url or f"sqlite:///{self.data_dir / 'talus.db'}"

    @property
    def resolved_broker_url(self) -> str:
        return self.broker_url or f"redis+socket://{quote(str(self.broker_socket))}"

    @property
    def embeds_broker(self) -> bool:
        return self.broker_url is None

    @property
    def broker_dir(self) -> Path:
        return self.data_dir / "broker"

    @property
    def broker_socket(self) -> Path:
        """The embedded broker's unix socket: in data_dir, or under a short name where that is too long."""
        path = self.broker_dir / "valkey.sock"
        if len(os.fsencode(path)) <= LONGEST_SOCKET_PATH:
            return path
        key = hashlib.sha256(os.fsencode(self.data_dir)).hexdigest()[:16]
        return Path(tempfile.gettempdir()) / f"talus-{os.getuid()}-{key}" / "valkey.sock"

    @property
    def artifacts_dir(self) -> Path:
        return self.data_dir / "artifacts"

    @property
    def geometries_dir(self) -> Path:
        return self.data_dir / "geometries"

    @property
    def checkpoints_dir(self) -> Path:
        """What jobs that are not over need to go on."""
        return self.data_dir / "checkpoints"

    def series_folder(self, job_id: str) -> Path:
        """Where the frames of a charge lie until it is over, beside its checkpoint."""
        return self.checkpoints_dir / f"{job_id}.series"

    @property
    def logs_dir(self) -> Path:
        return self.data_dir / "logs"

    @property
    def asks_for_keys(self) -> bool:
        """Whether a request needs a key."""
        return self.auth == "on" or (self.auth == "auto" and self.host not in LOOPBACK)

    @property
    def base_url(self) -> str:
        """Where a client on this machine reaches the API."""
        host = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}.get(self.host, self.host)
        return f"http://{host}:{self.port}"


def describe_problems(error: ValidationError) -> str:
    """One line for a user: each wrong setting with its variable's name, its value and what is allowed."""
    lines = []
    for problem in error.errors(include_url=False, include_context=False):
        name = "_".join(str(part) for part in problem["loc"]).upper()
        text = problem["msg"].removeprefix("Value error, ")
        value = "" if name.endswith("_URL") else f"={problem['input']!r}"  # a URL may hold a password
        lines.append(f"TALUS_{name}{value}: {text}" if name else text)
    return "; ".join(lines)


@lru_cache(maxsize=1)
def get_settings() -> Settings:
    """This process's settings, read from the environment once. Tests call `get_settings.cache_clear()`."""
    return Settings()
