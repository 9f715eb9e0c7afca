"""The installation that docs/pictures shows: small, but all in it ran through the service as a user's would.

Two studies of the pellet, one of them without a surrogate, a charge of coke and one of iron, two diagnoses of
piles that another code made (tests/diagnosis/piles), an uploaded deflector, and a finer charge that is under way
while pictures are taken. Beside these, studies that ran for hours and were exported (docs/studies): one so coarse
is seldom certified.
"""

from __future__ import annotations

import os
import socket
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import httpx

from demcore.geometry.mesh_file import save_mesh
from demcore.plant.plant_file import load_plant
from demcore.plant.surfaces import deflector_mesh
from service.client.local_service import running_service
from service.client.notebook import Talus, Task
from service.db.migrate import upgrade
from service.domain.data_set.records import DataSet
from service.settings import Settings
from tests.builders.server import Server
from tests.diagnosis.piles.bank import data_set, write_tables

# Two to learn from, dry and wet, and one to judge by: the least that a diagnosis takes.
CONDITIONS = ("full", "wet", "wet_half")
# Coarser than real grains and with few runs each, for the time's sake: a real diagnosis takes hours.
SMALL_DIAGNOSIS = {
    "contact_model": "hertz_mindlin",
    "grains": 200,
    "first_wave": 16,
    "second_wave": 16,
    "plants": 100,
}
STUDIES = Path(__file__).resolve().parents[2] / "docs" / "studies"
EXPORTED = ("pellet_coarse", "pellet")
UNDER_WAY_SCALE = 8.0
FRAMES_TO_SEE = 8


@contextmanager
def small_installation(
    kept: Path | None, budget: int, charge_scale: float, cases: tuple[str, ...]
) -> Iterator[str]:
    """The URL of a service in which all of this has ended, but for the charge under way. Data stay in `kept`."""
    with tempfile.TemporaryDirectory(prefix="talus-pictures-") as name, _free_port():
        settings = Settings(data_dir=kept or Path(name) / "var")
        with running_service(settings) as service, Talus(service.url) as talus:
            service.wait_for("database", "schema", "broker", "workers")
            started = time.monotonic()
            tasks: list[Task] = [
                talus.calibrate("pellet", scale=4, budget=budget, initial_designs=min(4, budget)),
                talus.calibrate("pellet", scale=4, budget=budget, strategy="sobol"),
            ]
            for charge in ("coke", "iron"):
                tasks += talus.start_charges(charge, scale=charge_scale, frame_seconds=2.0)
            for case in cases:
                folder = Path(name) / case
                write_tables(few_conditions(data_set(case)), folder)
                tasks.append(talus.diagnose(folder, **SMALL_DIAGNOSIS))
            for exported in EXPORTED:
                talus.import_study(STUDIES / exported / "study.json")
            _upload_deflector(service.url, Path(name) / "deflector.stl")
            for task in tasks:
                task.wait()
                print(f"{task.url} {task.state}, {time.monotonic() - started:.0f} s", flush=True)
            (under_way,) = talus.start_charges("iron", scale=UNDER_WAY_SCALE, frame_seconds=1.0)
            _wait_for_frames(service.url, under_way.id)
            yield service.url
            under_way.cancel()


def few_conditions(whole: DataSet) -> DataSet:
    """The part of a data set that is about CONDITIONS."""

    def kept(rows: tuple) -> tuple:  # type: ignore[type-arg]
        return tuple(row for row in rows if row.condition in CONDITIONS)

    return replace(
        whole,
        conditions=kept(whole.conditions),
        observations=kept(whole.observations),
        profiles=kept(whole.profiles),
    )


@contextmanager
def asking_installation() -> Iterator[str]:
    """The URL of an empty installation that asks for a key."""
    with tempfile.TemporaryDirectory(prefix="talus-pictures-") as name:
        settings = Settings(data_dir=Path(name), auth="on")
        upgrade(settings.resolved_database_url)
        server = Server(settings)
        server.start()
        try:
            yield server.url
        finally:
            server.stop()


@contextmanager
def _free_port() -> Iterator[None]:
    """A service of another data folder may have the usual one."""
    before = os.environ.get("TALUS_PORT")
    with socket.create_server(("127.0.0.1", 0)) as free:
        os.environ["TALUS_PORT"] = str(free.getsockname()[1])
    try:
        yield
    finally:
        if before is None:
            del os.environ["TALUS_PORT"]
        else:
            os.environ["TALUS_PORT"] = before


def _upload_deflector(url: str, file: Path) -> None:
    save_mesh(deflector_mesh(load_plant().deflector), file, "mm")
    answer = httpx.post(
        f"{url}/v1/geometries",
        params={"file_name": file.name},
        content=file.read_bytes(),
        headers={"Content-Type": "application/octet-stream"},
        timeout=60.0,
    )
    answer.raise_for_status()


def _wait_for_frames(url: str, charge: int) -> None:
    deadline = time.monotonic() + 300.0
    while len(httpx.get(f"{url}/charges/{charge}/scene").json()["frames"]) < FRAMES_TO_SEE:
        if time.monotonic() > deadline:
            raise SystemExit(f"charge {charge} has not {FRAMES_TO_SEE} frames after five minutes")
        time.sleep(1.0)
