"""`talus`: starts the service, runs the demo, and asks a running service from the command line.

Input that is refused is one line on stderr and exit status 2; a service that fails is one line and status 1.
"""

from __future__ import annotations

import os
import platform
import signal
import sys
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

import click
from pydantic import ValidationError
from rich.console import Console

from service.client.charge import COMMANDS as CHARGE_COMMANDS
from service.client.charge_comparison import compare_command
from service.client.commands import COMMANDS
from service.client.keys import keys_command
from service.client.maintenance import backup, restore, retention
from service.client.rest import Client, RefusedError, ServiceAwayError
from service.client.tables import found_lines, noise_lines, studies_table
from service.code_version import demcore_hash
from service.file_store import StoreAway, artifact_store
from service.settings import Settings, StartupError, describe_problems, get_settings

BAD_INPUT = 2
FAILED = 1
INTERRUPTED = 130
# As many simulations as the paper spent on its pellet (Table 6); under ten minutes on two cores.
DEMO_BUDGET = 16


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
def cli() -> None:
    """Calibrates the contact parameters of granular simulations. Settings: TALUS_ variables (README.md)."""


@cli.command()
def serve() -> None:
    """Start the whole service on this machine and stay."""
    from service.supervisor import Supervisor

    Supervisor(get_settings(), _say).run()


@cli.command()
@click.option("--material", default="pellet", show_default=True, help="a shipped material")
@click.option("--scale", type=float, help="coarse-graining: particle diameters times this")
@click.option("--budget", type=int, default=DEMO_BUDGET, show_default=True, help="simulations at most")
@click.option("--seed", type=int, help="the same seed gives the same designs")
@click.option("--keep-serving", is_flag=True, help="leave the service running at the end, until Ctrl-C")
def demo(material: str, scale: float | None, budget: int, seed: int | None, keep_serving: bool) -> None:
    """Calibrate a material, live, and compare with the paper."""
    from service.client.demo import DemoOptions, run_demo

    # A SIGTERM ends the demo as Ctrl-C does: the study is cancelled and the service stopped.
    signal.signal(signal.SIGTERM, _interrupt)
    options = DemoOptions(material, scale, budget, seed, keep_serving)
    sys.exit(run_demo(get_settings(), options, Console()))


@cli.command()
@click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option(
    "--out", type=click.Path(file_okay=False, path_type=Path), help="a folder for the study's files"
)
def calibrate(file: Path, out: Path | None) -> None:
    """Run the study that FILE asks for (the JSON of POST /v1/studies), live, and keep its files."""
    from service.client import calibrate as calibration

    signal.signal(signal.SIGTERM, _interrupt)
    try:
        body = calibration.read_request(file)
    except calibration.NotARequestError as error:
        raise click.BadParameter(str(error), param_hint="FILE") from error
    sys.exit(calibration.calibrate(get_settings(), body, out, Console()))


@cli.command()
@click.argument("dataset", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="the published form and nothing else")
@click.option("--grains", type=int, help="about which a simulated pile is made of")
@click.option("--contact-model", help="paper or hertz_mindlin")
@click.option("--first-wave", type=int, help="runs of each condition over the whole box")
@click.option("--second-wave", type=int, help="and about the re-calibrated parameters")
@click.option("--plants", type=int, help="effect-free pseudo-plants, at least 100")
@click.option("--seed", type=int, help="the same seed gives the same diagnosis")
@click.option("--model", "model_version", help="a version of the model, diagnosed in place of the baseline")
def diagnose(dataset: Path, as_json: bool, **options: object) -> None:
    """Find what the simulation gets wrong of the measured tables in the folder DATASET, and name the cause.

    DATASET holds conditions.csv, observations.csv and, where there are, profiles.csv.
    """
    chosen = {name: value for name, value in options.items() if value is not None}
    _diagnose(dataset, "DATASET", as_json, chosen)


@cli.command()
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="the result and nothing else")
@click.option("--replicates", type=int, help="of each test, at least 3 [default: 4]")
@click.option(
    "--observable", "observables", multiple=True, help="that would be read (repeatable) [default: all]"
)
@click.option("--candidate", "candidates", multiple=True, help="a condition not yet decided (repeatable)")
@click.option("--grains", type=int, help="about which a simulated pile is made of")
@click.option("--contact-model", help="paper or hertz_mindlin")
@click.option("--first-wave", type=int, help="runs of each condition over the whole box")
@click.option("--seed", type=int, help="the same seed gives the same answer")
@click.option("--model", "model_version", help="a version of the model, in place of the baseline")
def plan(folder: Path, as_json: bool, **options: Any) -> None:
    """Say what the tests of FOLDER/conditions.csv could show, before they are made.

    Which causes would stay silent, be seen or be named, from which size on, and which candidate adds most.
    """
    chosen = {name: value for name, value in options.items() if value not in (None, ())}
    asked = {name: chosen.pop(name) for name in ("replicates", "observables", "candidates") if name in chosen}
    _diagnose(folder, "FOLDER", as_json, {**chosen, "plan": asked})


def _diagnose(folder: Path, argument: str, as_json: bool, chosen: dict[str, Any]) -> NoReturn:
    from service.client import diagnose as diagnosis

    signal.signal(signal.SIGTERM, _interrupt)
    try:
        tables = diagnosis.read_tables(folder, planned="plan" in chosen)
    except diagnosis.NotADataSetError as error:
        raise click.BadParameter(str(error), param_hint=argument) from error
    name = folder.resolve().name[:100]
    sys.exit(diagnosis.diagnose(get_settings(), name, tables, chosen, as_json, Console()))


@cli.command()
@click.option("--no-key", is_flag=True, help="make no first key")
def migrate(no_key: bool) -> None:
    """Bring the database to the newest schema; where keys are asked for and there is none, make the first."""
    from service.db.migrate import upgrade
    from service.first_key import first_key_lines

    settings = get_settings()
    settings.data_dir.mkdir(parents=True, exist_ok=True)
    upgrade(settings.resolved_database_url)
    for line in [] if no_key else first_key_lines(settings):
        click.echo(line)


@cli.command()
@click.option("--name", default="worker", show_default=True, help="its name in Celery's and the log's lines")
@click.option("--broker", help="the service's broker [default: TALUS_BROKER_URL]")
@click.option("--database", help="the service's database [default: TALUS_DATABASE_URL]")
@click.option("--store", help="the service's object store, where it has one [default: TALUS_STORE_URL]")
@click.option(
    "--data-dir",
    type=click.Path(file_okay=False, path_type=Path),
    help="the folder that all machines share, or one of its own with --store [default: TALUS_DATA_DIR]",
)
def worker(
    name: str, broker: str | None, database: str | None, store: str | None, data_dir: Path | None
) -> None:
    """Run one worker process here, on this machine or another than the service's."""
    from service.processes import environment, worker_process

    given = {"broker_url": broker, "database_url": database, "store_url": store, "data_dir": data_dir}
    settings = Settings(**{option: value for option, value in given.items() if value is not None})  # type: ignore[arg-type]
    artifact_store(settings)  # a store without its package is told now, not by the first job
    spec = worker_process(name, settings)
    os.execve(spec.command[0], spec.command, environment(settings, spec))


@cli.command()
def version() -> None:
    """The version, and the hash of the simulation code that results are stored with."""
    from importlib.metadata import version as installed

    click.echo(
        f"talus {installed('talus')}, demcore {demcore_hash()[:16]}, Python {platform.python_version()}"
    )


@cli.command()
@click.option("--limit", type=click.IntRange(1, 200), default=20, show_default=True)
def studies(limit: int) -> None:
    """List the newest studies of the running service."""
    with Client(get_settings().base_url) as client:
        Console().print(studies_table(client.studies(limit)))


@cli.command()
@click.argument("study_id", type=int, required=False)
@click.option("--only", metavar="CHECK", help="one check of the service; status 1 if it is not ok")
def status(study_id: int | None, only: str | None) -> None:
    """How a study is, or without an id whether the service is ready."""
    with Client(get_settings().base_url) as client:
        if study_id is None:
            checks = client.readiness()["checks"]
            if only is not None and only not in checks:
                raise click.BadParameter(f"{only!r} is none of {', '.join(checks)}", param_hint="--only")
            shown = checks if only is None else {only: checks[only]}
            for name, check in shown.items():
                click.echo(f"{name}: {'ok' if check['ok'] else check['reason']}")
            sys.exit(0 if only is None or checks[only]["ok"] else FAILED)
        study = client.study(study_id)
    counts = ", ".join(f"{count} {name}" for name, count in study["counters"].items())
    click.echo(f"study {study_id} ({study['material']}): {study['state']}; {counts}")
    for response in study["spec"].get("responses", ()):
        lower, upper = response["window"]
        click.echo(
            f"  {response['observable']}: target {response['target']:g}, window {lower:g} to {upper:g}"
        )
    for line in found_lines(study["recommendation"]) if study["recommendation"] else ():
        click.echo(f"  {line}")
    for line in noise_lines(study):
        click.echo(f"  {line}")
    if study["spec"].get("strategy", "auto") != "auto":
        click.echo(f"  strategy: {study['spec']['strategy']}")
    if study["pause"] is not None:
        click.echo(f"paused because: {study['pause']['text'] or study['pause']['reason']}")
    if study["stop"] is not None:
        click.echo(f"ended because: {study['stop']['text'] or study['stop']['reason']}")
    for name, value in ((study["recommendation"] or {}).get("x") or {}).items():
        click.echo(f"  {name} = {value:g}")


for command in (*COMMANDS, keys_command, backup, restore, retention, *CHARGE_COMMANDS, compare_command):
    cli.add_command(command)


def _say(text: str) -> None:
    click.echo(f"{datetime.now().astimezone():%H:%M:%S}  {text}")


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def _fail(text: str, code: int) -> int:
    click.echo("talus: " + " ".join(text.split()), err=True)
    return code


def main(arguments: Sequence[str] | None = None) -> int:
    """The exit status of one command line."""
    words = list(sys.argv[1:] if arguments is None else arguments) or ["--help"]
    try:
        result = cli.main(args=words, prog_name="talus", standalone_mode=False)
    except click.ClickException as error:
        return _fail(error.format_message(), BAD_INPUT)
    except ValidationError as error:
        return _fail(describe_problems(error), BAD_INPUT)
    except (StartupError, RefusedError) as error:
        return _fail(str(error), BAD_INPUT)
    except (ServiceAwayError, StoreAway) as error:
        return _fail(str(error), FAILED)
    except (click.Abort, KeyboardInterrupt):
        return _fail("interrupted", INTERRUPTED)
    return result if isinstance(result, int) else 0


if __name__ == "__main__":
    sys.exit(main())
