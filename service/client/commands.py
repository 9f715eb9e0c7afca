"""The commands of `talus` that act on one study of a running service: its files, and its user's controls."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import click

from service.client.rest import Client
from service.settings import get_settings

FILES = {"export": "study.json", "designs.csv": "designs.csv", "designs.parquet": "designs.parquet"}


def charge_report(client: Client, charge_id: int) -> bytes:
    """The page that the worker wrote. Raises click.UsageError before there is one."""
    for file in client.charge(charge_id)["artifacts"]:
        if file["kind"] == "report":
            return client.artifact(file["id"])
    raise click.UsageError(f"charge {charge_id} has no report: it is written when the charge has ended well")


REPORTS: Mapping[str, Callable[[Client, int], bytes]] = {
    "study": lambda client, number: client.report_page("studies", number),
    "charge": charge_report,
    "diagnosis": lambda client, number: client.report_page("diagnoses", number),
}


@click.command("export")
@click.argument("study_id", type=int)
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), required=True, help="a folder")
def export_command(study_id: int, out: Path) -> None:
    """Write a study as study.json (`talus import` reads it), its designs as CSV and Parquet."""
    with Client(get_settings().base_url) as client:
        for file in write_files(client, study_id, out):
            click.echo(file)


def write_files(client: Client, study_id: int, out: Path) -> list[Path]:
    """A study's files in the folder `out`. Raises click.BadParameter where it cannot be."""
    contents = {out / file: client.download(study_id, name) for name, file in FILES.items()}
    try:
        out.mkdir(parents=True, exist_ok=True)
        for path, content in contents.items():
            path.write_bytes(content)
    except OSError as error:
        raise click.BadParameter(f"{out} cannot be written: {error.strerror}", param_hint="--out") from error
    return list(contents)


@click.command("report")
@click.argument("kind", type=click.Choice(sorted(REPORTS)))
@click.argument("number", type=int)
@click.option(
    "--out", type=click.Path(dir_okay=False, path_type=Path), help="a file [default: KIND-NUMBER.html]"
)
def report_command(kind: str, number: int, out: Path | None) -> None:
    """Write a study, charge or diagnosis as one page that holds everything it shows (print it for a PDF)."""
    out = out or Path(f"{kind}-{number}.html")
    with Client(get_settings().base_url) as client:
        content = REPORTS[kind](client, number)
    try:
        out.write_bytes(content)
    except OSError as error:
        raise click.BadParameter(f"{out} cannot be written: {error.strerror}", param_hint="--out") from error
    click.echo(out)


@click.command("import")
@click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
def import_command(file: Path) -> None:
    """Read a study in that another installation exported; the same file twice is one study."""
    with Client(get_settings().base_url) as client:
        study = client.import_study(file.read_bytes())
    click.echo(
        f"study {study['id']} ({study['material']}, {study['state']}) at {client.base_url}/studies/{study['id']}"
    )


@click.command()
@click.argument("study_id", type=int)
def pause(study_id: int) -> None:
    """Propose and start nothing more; what runs comes to its end."""
    with Client(get_settings().base_url) as client:
        _tell(client.pause_study(study_id))


@click.command()
@click.argument("study_id", type=int)
def resume(study_id: int) -> None:
    """Go on with a paused study."""
    with Client(get_settings().base_url) as client:
        _tell(client.resume_study(study_id))


@click.command()
@click.argument("study_id", type=int)
def cancel(study_id: int) -> None:
    """Stop a study; what it has measured stays and is judged."""
    with Client(get_settings().base_url) as client:
        _tell(client.cancel_study(study_id))


@click.command()
@click.argument("study_id", type=int)
@click.argument("budget", type=int)
def extend(study_id: int, budget: int) -> None:
    """Set a running study's budget of simulations to BUDGET, more than it has."""
    with Client(get_settings().base_url) as client:
        _tell(client.extend_budget(study_id, budget))


@click.command()
@click.argument("study_id", type=int)
@click.argument("values", nargs=-1, required=True, metavar="NAME=VALUE...")
@click.option("--seed", type=int, help="default: a new one")
def add(study_id: int, values: tuple[str, ...], seed: int | None) -> None:
    """Simulate a design of your own in a study: a value for each variable."""
    x = dict(_assignment(text) for text in values)
    with Client(get_settings().base_url) as client:
        _tell_design(client.add_design(study_id, x, seed))


@click.command()
@click.argument("study_id", type=int)
@click.argument("number", type=int)
@click.option("--same-seed", is_flag=True, help="repeat a design that ended in error")
def rerun(study_id: int, number: int, same_seed: bool) -> None:
    """Run design NUMBER of a study again: with another seed, or after an error with its own."""
    with Client(get_settings().base_url) as client:
        chosen = [design for design in client.designs(study_id) if design["number"] == number]
        if not chosen:
            raise click.BadParameter(f"study {study_id} has no design {number}", param_hint="NUMBER")
        _tell_design(client.rerun_design(chosen[0]["id"], same_seed))


def _assignment(text: str) -> tuple[str, float]:
    name, sign, value = text.partition("=")
    try:
        return name, float(value)
    except ValueError:
        problem = f"{text!r} is no NAME=VALUE" if not sign else f"{value!r} is no number (of {name})"
        raise click.BadParameter(problem, param_hint="VALUES") from None


def _tell(study: dict[str, Any]) -> None:
    counts = ", ".join(f"{count} {name}" for name, count in study["counters"].items())
    click.echo(f"study {study['id']}: {study['state']}; budget {study['budget']}; {counts}")


def _tell_design(design: dict[str, Any]) -> None:
    click.echo(
        f"study {design['study_id']}, design {design['number']}: {design['state']}; seed {design['seed']}"
    )


COMMANDS = (export_command, report_command, import_command, pause, resume, cancel, extend, add, rerun)
