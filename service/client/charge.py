"""`talus charge`: charges of the hopper through the service, from the request to the report on this disk.

It uses the service that runs on the data folder, or starts one on all cores for as long as the charges take.
"""

from __future__ import annotations

import json
import os
import time
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

from service.client.local_service import running_service
from service.client.rest import Client
from service.settings import Settings, get_settings

# A charge takes minutes on all cores, and whoever asks takes one from it.
POLL_SECONDS = 2.0
OVER = ("COMPLETE", "FAILED", "CANCELLED")


def read_object(text: str, field: str) -> dict[str, Any]:
    """An object given as JSON, or the name of a JSON or TOML file; of `{ value, why }` the value counts. Raises
    click.BadParameter."""
    try:
        if text.lstrip().startswith("{"):
            found = json.loads(text)
        else:
            content = Path(text).read_text(encoding="utf-8")
            found = tomllib.loads(content) if text.endswith(".toml") else json.loads(content)
    except OSError as error:
        raise click.BadParameter(f"{text}: {error.strerror}", param_hint=field) from error
    except ValueError as error:
        raise click.BadParameter(f"{text} is neither JSON nor TOML: {error}", param_hint=field) from error
    if not isinstance(found, dict):
        raise click.BadParameter(f"{text} holds no object", param_hint=field)
    return {name: _plain(value) for name, value in found.items()}


def _plain(value: Any) -> Any:
    if not isinstance(value, dict):
        return value
    return value["value"] if "value" in value else {name: _plain(item) for name, item in value.items()}


def all_cores_for(charges: int, settings: Settings) -> Settings:
    """The settings for a service that is started for so many charges: a worker for each as far as the cores reach,
    and what is left of them as threads, which change no bit. What the user has set stays."""
    if settings.model_fields_set & {"workers", "threads"}:
        return settings
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    workers = min(charges, cores)
    return settings.model_copy(update={"workers": workers, "threads": cores // workers})


def charge(settings: Settings, body: Mapping[str, Any], out: Path, console: Console) -> int:
    """Ask for the charges, wait, fetch their files into `out`, one folder each where they are several. The exit
    status: 0 when all are complete."""
    started = all_cores_for(len(body["seeds"]), settings)
    with running_service(started) as service, Client(service.url) as client:
        asked = client.create_charges(dict(body))["items"]
        for item in asked:
            console.print(
                f"charge {item['id']}, seed {item['seed']}: {item['cost']['text']}", highlight=False
            )
        service.wait_for("dispatcher", "workers")
        try:
            ended = _wait(client, [item["id"] for item in asked], console)
        except KeyboardInterrupt:
            for item in asked:
                if client.charge(item["id"])["state"] not in OVER:
                    client.cancel_charge(item["id"])
            raise
        for item in ended:
            folder = out if len(ended) == 1 else out / f"charge-{item['id']}"
            _tell(client, item, folder, console)
    return 0 if all(item["state"] == "COMPLETE" for item in ended) else 1


def _wait(client: Client, ids: Sequence[int], console: Console) -> list[dict[str, Any]]:
    """Until all are over, with a bar each."""
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[phase]}"))
    with Progress(
        *columns, TimeRemainingColumn(), console=console, transient=True, refresh_per_second=2
    ) as bars:
        tasks: dict[int, TaskID] = {n: bars.add_task(f"charge {n}", total=1.0, phase="waits") for n in ids}
        while True:
            found = [client.charge(n) for n in ids]
            for item in found:
                told = item["progress"] or {}
                done = 1.0 if item["state"] in OVER else told.get("fraction") or 0.0
                phase = told.get("phase") or item["state"].lower()
                bars.update(tasks[item["id"]], completed=done, phase=phase)
            if all(item["state"] in OVER for item in found):
                return found
            time.sleep(POLL_SECONDS)


def _tell(client: Client, item: Mapping[str, Any], folder: Path, console: Console) -> None:
    if item["state"] != "COMPLETE":
        console.print(f"charge {item['id']}: {item['state'].lower()}; {item['failure_text'] or ''}")
        return
    files = fetch(client, item, folder)
    found = item["findings"]
    told = ", ".join(found["depressions"]) or "none"
    piles = f"{found['piles']} pile" + ("" if found["piles"] == 1 else "s")
    console.print(
        f"charge {item['id']}, seed {item['seed']}: {piles}; far {_height(found, 'far')}, near "
        f"{_height(found, 'near')}; depressions: {told}\nWritten: {files['report']}",
        highlight=False,
        soft_wrap=True,
    )


def _height(found: Mapping[str, Any], side: str) -> str:
    height, size = found[f"{side}_height_m"], found[f"{side}_size_m"]
    if height is None or size is None:
        return "none"
    return f"{height:.2f} m of {1e3 * size:.0f} mm"


def fetch(client: Client, item: Mapping[str, Any], folder: Path) -> dict[str, Path]:
    """The files of a charge in `folder`, by kind. Raises click.BadParameter where it cannot be."""
    found = {}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for artifact in item["artifacts"]:
            path = folder / Path(artifact["file_name"]).name
            path.write_bytes(client.artifact(artifact["id"]))
            found[artifact["kind"]] = path
    except OSError as error:
        raise click.BadParameter(
            f"{folder} cannot be written: {error.strerror}", param_hint="--out"
        ) from error
    return found


@click.command("charge")
@click.argument("material")
@click.option(
    "--scale", type=float, default=4.0, show_default=True, help="coarse-graining: grain sizes times this"
)
@click.option("--seed", type=int, default=1, show_default=True)
@click.option("--seeds", type=click.IntRange(1, 50), default=1, help="so many charges, from --seed on")
@click.option("--plant", help="what differs from the shipped plant: TOML or JSON file, or JSON")
@click.option("--parameters", help="contact numbers by material, or of studies: JSON file, or JSON")
@click.option(
    "--longest-hours",
    type=float,
    help="refuse what would take longer, before it starts [default: the service's, 24]",
)
@click.option("--model-version", help="the model that a diagnosis extended [default: the baseline]")
@click.option("--moisture-percent", type=float, help="of the burden; only a version's cohesion feels it")
@click.option(
    "--out", type=click.Path(file_okay=False, path_type=Path), default=Path("charge"), show_default=True
)
def charge_command(
    material: str,
    scale: float,
    seed: int,
    seeds: int,
    plant: str | None,
    parameters: str | None,
    out: Path,
    **more: object,
) -> int:
    """Charge the hopper with MATERIAL (coke or iron), live, and keep the report and its files."""
    body: dict[str, Any] = {
        "charge": material,
        "scale": scale,
        "seeds": list(range(seed, seed + seeds)),
        **{name: value for name, value in more.items() if value is not None},
    }
    if plant is not None:
        body["plant"] = read_object(plant, "--plant")
    if parameters is not None:
        given = read_object(parameters, "--parameters")
        # Bare numbers are short for given values.
        body["parameters"] = {
            name: row if isinstance(row, dict) and {"values", "study"} & set(row) else {"values": row}
            for name, row in given.items()
        }
    return charge(get_settings(), body, out, Console())


@click.command("charges")
@click.option("--limit", type=click.IntRange(1, 200), default=20, show_default=True)
def charges_command(limit: int) -> None:
    """List the newest charges of the running service."""
    with Client(get_settings().base_url) as client:
        for item in client.charges(limit):
            found = item["findings"] or {}
            piles = f"; {found['piles']} piles" if found else ""
            click.echo(
                f"charge {item['id']} ({item['charge']}, scale {item['scale']:g}, seed {item['seed']}): "
                f"{item['state'].lower()}{piles}"
            )


@click.command("cancel-charge")
@click.argument("charge_id", type=int)
def cancel_command(charge_id: int) -> None:
    """Stop a charge; it leaves nothing."""
    with Client(get_settings().base_url) as client:
        click.echo(f"charge {charge_id}: {client.cancel_charge(charge_id)['state'].lower()}")


COMMANDS = (charge_command, charges_command, cancel_command)
