"""What the service consists of: each process's command and environment, said once.

`talus serve` starts these on one machine and compose.yaml starts the same commands in containers; a test
holds the two together.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field

from service.broker import server_command
from service.code_version import demcore_folder
from service.settings import Settings

# An open event stream would keep uvicorn alive for ever; after this many seconds it is cut.
STREAM_GRACE_SECONDS = 3

THREAD_VARIABLES = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
# Kernels run on one thread per worker process, so that `workers` says how many cores are used.
SINGLE_THREADED = dict.fromkeys(THREAD_VARIABLES, "1")


@dataclass(frozen=True)
class ProcessSpec:
    """One process: its name (also its log's), its command, and what only its environment has."""

    name: str
    command: tuple[str, ...]
    extra_environment: Mapping[str, str] = field(default_factory=dict)


def migrate_command() -> tuple[str, ...]:
    return (sys.executable, "-m", "service.cli", "migrate")


def api_command(settings: Settings) -> tuple[str, ...]:
    return (
        *(sys.executable, "-m", "uvicorn", "service.app:create_app", "--factory"),
        *("--host", settings.host, "--port", str(settings.port)),
        *("--timeout-graceful-shutdown", str(STREAM_GRACE_SECONDS), "--no-access-log", "--no-server-header"),
    )


def dispatcher_command() -> tuple[str, ...]:
    return (sys.executable, "-m", "service.dispatcher")


def worker_command(name: str, settings: Settings) -> tuple[str, ...]:
    """A Celery worker of one child process; `--max-memory-per-child` is not set: a leak is to be seen."""
    return (
        *(sys.executable, "-m", "celery", "--app", "worker.app", "worker"),
        *("--hostname", f"{name}@%h", "--pool", "prefork", "--concurrency", "1"),
        *("--loglevel", settings.log_level, "--without-gossip", "--without-mingle"),
    )


def worker_process(name: str, settings: Settings) -> ProcessSpec:
    """One worker; its simulations have the threads of the settings.

    Linear algebra keeps one: the optimizer's matrices are small, and a second thread that waits for its share
    doubles the processor time (a kriging proposal 1.9 times, a diagnosis 3.7 times; wall times are longer too).
    """
    threads = {**dict.fromkeys(THREAD_VARIABLES, str(settings.threads)), "OPENBLAS_NUM_THREADS": "1"}
    return ProcessSpec(name, worker_command(name, settings), threads)


def broker_process(settings: Settings) -> ProcessSpec:
    return ProcessSpec("broker", tuple(server_command(settings)))


def long_running(settings: Settings) -> tuple[ProcessSpec, ...]:
    """Everything that stays up beside the broker, in the order in which it is started."""
    return (
        ProcessSpec("api", api_command(settings)),
        ProcessSpec("dispatcher", dispatcher_command()),
        *(worker_process(f"worker-{n}", settings) for n in range(1, settings.workers + 1)),
    )


def environment(settings: Settings, spec: ProcessSpec) -> dict[str, str]:
    """This process's environment with every setting in it, so that a child resolves the same ones."""
    shared = {
        "TALUS_DATA_DIR": str(settings.data_dir),
        "TALUS_HOST": settings.host,
        "TALUS_PORT": str(settings.port),
        "TALUS_LEASE_SECONDS": str(settings.lease_seconds),
        "TALUS_CHECKPOINT_SECONDS": str(settings.checkpoint_seconds),
        "TALUS_DISK_PAUSE_SECONDS": str(settings.disk_pause_seconds),
        "TALUS_MAX_BODY_BYTES": str(settings.max_body_bytes),
        "TALUS_THREADS": str(settings.threads),
        "TALUS_WORKER_NICENESS": str(settings.worker_niceness),
        "TALUS_MAX_IMPORT_BYTES": str(settings.max_import_bytes),
        "TALUS_AUTH": settings.auth,
        "TALUS_LOG_LEVEL": settings.log_level,
        "TALUS_DATABASE_URL": settings.resolved_database_url,
        "TALUS_BROKER_URL": settings.resolved_broker_url,
        "PYTHONUNBUFFERED": "1",
    }
    if settings.store_url is not None:
        shared["TALUS_STORE_URL"] = settings.store_url
    return {**compiled_kernels(settings), **os.environ, **shared, **spec.extra_environment}


def compiled_kernels(settings: Settings) -> dict[str, str]:
    """Where Numba keeps what it compiled: beside demcore's sources, as the tests do, if that can be written.

    demcore/jit.py makes a folder there for each state of its sources.
    """
    if os.access(demcore_folder(), os.W_OK):
        return {}
    return {"NUMBA_CACHE_DIR": str(settings.data_dir / "numba")}
