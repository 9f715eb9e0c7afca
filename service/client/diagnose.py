"""`talus diagnose`: measured tables from a folder, to the verdict on what the simulation gets wrong.

It uses the service that runs on the data folder, or starts one for as long as the diagnosis takes. Stopped, it can
be asked again: simulations that were made are not made again.
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from service.client.local_service import running_service
from service.client.rest import Client
from service.domain.data_set.cells import BadDataSet
from service.domain.data_set.columns import CONDITIONS, OBSERVATIONS, PROFILES
from service.domain.data_set.reading import read_data_set
from service.domain.data_set.tables import read_file
from service.domain.effect_words import estimate_in_words, size_in_words
from service.domain.effects import library
from service.domain.misfit_words import place
from service.domain.verdict_words import is_one_likely, verdict_sentence
from service.settings import Settings

POLL_SECONDS = 0.5
OPEN_STATES = ("WAITING", "RUNNING")


class NotADataSetError(Exception):
    """The folder holds no data set; the text names every bad cell."""


def read_tables(folder: Path, planned: bool = False) -> dict[str, str]:
    """The texts of the tables, checked before a service is started; of tests that lie ahead perhaps the conditions
    alone. Raises NotADataSetError."""
    try:
        read_data_set(folder, planned)
    except BadDataSet as error:
        raise NotADataSetError(str(error)) from error
    names = (CONDITIONS, OBSERVATIONS, PROFILES)
    return {name: read_file(folder / name) for name in names if (folder / name).exists()}


def diagnose(
    settings: Settings,
    name: str,
    tables: Mapping[str, str],
    options: Mapping[str, Any],
    as_json: bool,
    console: Console,
) -> int:
    """The exit status: 0 when there is a verdict. `options`: the fields of POST /v1/diagnoses that were chosen;
    with `plan` among them it is told what the tests could show."""
    is_plan = options.get("plan") is not None
    quiet = Console(stderr=True, quiet=as_json)
    with running_service(settings) as service, Client(service.url) as client:
        data_set = client.create_data_set(name, dict(tables), planned=is_plan)
        for sentence in [] if is_plan else data_set["sentences"]:
            quiet.print(sentence, highlight=False)
        diagnosis = client.create_diagnosis({"data_set": data_set["id"], **options})
        quiet.print(f"Diagnosis {diagnosis['id']}: {diagnosis['cost']['text']}", highlight=False)
        service.wait_for("dispatcher", "workers")
        diagnosis = follow(client, diagnosis, quiet)
    if diagnosis["state"] != "COMPLETE":
        console.print(
            f"Diagnosis {diagnosis['id']} is {diagnosis['state']}: {diagnosis['failure_text'] or 'no verdict'}",
            highlight=False,
        )
        return 1
    if as_json:
        result = diagnosis["result"]
        console.print_json(json.dumps(result if is_plan else published(result)))
    elif is_plan:
        tell_plan(diagnosis["result"], console)
    else:
        for line in lines(diagnosis["result"]):
            console.print(line, highlight=False, soft_wrap=True)
    return 0


def tell_plan(result: Mapping[str, Any], console: Console) -> None:
    """What planned tests could show: a line for each cause, then the sentences."""
    table = Table(box=None, pad_edge=False)
    for name in ("cause", "could be", "seen from", "named from", "mistaken for"):
        table.add_column(name, overflow="fold")
    for found in result["effects"]:
        sizes = [_size(found, name) for name in ("detectable_from", "nameable_from")]
        table.add_row(found["effect"], found["verdict"], *sizes, ", ".join(found["alike"]))
    console.print(table, highlight=False)
    for sentence in result["sentences"]:
        console.print(sentence, highlight=False, soft_wrap=True)
    for added in result["adds"]:
        gained = ", ".join(added["nameable"]) or "no further cause"
        console.print(f"{added['condition']} adds: {gained}.", highlight=False, soft_wrap=True)


def _size(found: Mapping[str, Any], which: str) -> str:
    size = found[which]
    return "-" if size is None else size_in_words(found["effect"], size, found["unit"])


def follow(client: Client, diagnosis: dict[str, Any], console: Console) -> dict[str, Any]:
    """Until it is over. Ctrl-C cancels it; its runs stay."""
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("simulating", total=1.0)
        try:
            while diagnosis["state"] in OPEN_STATES:
                time.sleep(POLL_SECONDS)
                diagnosis = client.diagnosis(diagnosis["id"])
                told = diagnosis["progress"] or {}
                bar.update(
                    task, completed=told.get("fraction", 0.0), description=f"{told.get('runs', 0)} runs"
                )
        except KeyboardInterrupt:
            client.cancel_diagnosis(diagnosis["id"])
            raise
    return diagnosis


PUBLISHED = (
    "verdict",
    "claims",
    "also_possible",
    "not_testable",
    "indistinguishable",
    "unexplained",
    "remainder",
    "gain",
    "next_measurement",
    "cost",
    "model_version",
)


def published(result: Mapping[str, Any]) -> dict[str, Any]:
    """The fields that `--json` promises, in their order."""
    return {name: result[name] for name in PUBLISHED}


def lines(result: Mapping[str, Any]) -> list[str]:
    """What a plant engineer reads, a sentence each."""
    told = [verdict_sentence(result["verdict"], result), *result["sentences"]]
    told += [_claim(claim) for claim in result["claims"]]
    likely = "Likeliest" if is_one_likely(result["verdict"], result) else "Not excluded"
    for group, words in (("also_possible", likely), ("unexplained", "Where")):
        if result[group]:
            names = ", ".join(
                f"{item['effect'] if 'effect' in item else place(item['block'])} "
                f"{item.get('inclusion', item.get('probability')):.2f}"
                for item in result[group]
            )
            told.append(f"{words}: {names}.")
    if result["verdict"] == "no_misfit" and result.get("limits"):
        sizes = "; ".join(
            f"{limit['effect']}: {size_in_words(limit['effect'], limit['detectable_from'], limit['unit'])}"
            for limit in result["limits"]
        )
        told.append(f"Shown from: {sizes}.")
    if result["not_testable"]:
        told.append(f"These data cannot show: {', '.join(result['not_testable'])}.")
    if result["gain"]:
        gain = result["gain"]
        told.append(
            f"On data held out the extended model gains {gain['log_score']:.1f} nats (by chance at most "
            f"{gain['null_95']:.1f}), RMSE {gain['rmse_before']:.2f} to {gain['rmse_after']:.2f} sd."
        )
    if result.get("extended_model"):
        told.append(f"Extended model: {result['extended_model']}.")
    told += [f"Next: {item['what']} (cost {item['cost']:g})." for item in result["next_measurement"][:3]]
    return told


def _claim(claim: Mapping[str, Any]) -> str:
    known, name, size = library(), claim["effect"], claim["amplitude"]
    what = f"{known[name].what} ({name})" if name in known else name
    told = estimate_in_words(name, size["value"], (size["ci90"][0], size["ci90"][1]), size["unit"])
    return (
        f"{what[0].upper()}{what[1:]}, {claim['level']}: equivalent to {told}, in brackets the 90 % interval; "
        f"inclusion {claim['inclusion']:.3f}, within this library."
    )
