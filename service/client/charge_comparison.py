"""`talus compare`: finished charges beside each other, as a table and as JSON."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.table import Table

from service.client.rest import Client
from service.settings import get_settings


@click.command("compare")
@click.argument("groups", nargs=-1, required=True, metavar="NAME=ID,ID...")
@click.option(
    "--plant-heights",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="CSV with azimuth_deg and height_m above the bell's seat",
)
@click.option(
    "--plant-pressures",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="CSV with azimuth_deg and pressure_kpa of taps below the hopper",
)
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), help="a JSON file for all numbers")
def compare_command(
    groups: tuple[str, ...], plant_heights: Path | None, plant_pressures: Path | None, out: Path | None
) -> None:
    """Set groups of charges beside each other: materials, scales, seeds or parameter sets."""
    body: dict[str, Any] = {"groups": dict(_group(text) for text in groups)}
    for field, file in (("plant_heights", plant_heights), ("plant_pressures", plant_pressures)):
        if file is not None:
            body[field] = file.read_text(encoding="utf-8")
    with Client(get_settings().base_url) as client:
        found = client.compare_charges(body)
    Console().print(_table(found, list(body["groups"])))
    for row in found["plant"]:
        correlation = _signed(row["correlation"])
        click.echo(
            f"charge {row['charge_id']} against the plant: bias {row['bias_m']:+.3f} m, rms {row['rms_m']:.3f} m, "
            f"correlation {correlation}"
        )
    for row in found["pressures"]:
        turned = row["as_strong_when_turned"]
        share = "" if turned is None else f"; {100 * turned:.0f} % of its turnings agree as strongly"
        click.echo(
            f"charge {row['charge_id']} against the taps: rank correlation of height and pressure "
            f"{_signed(row['rank_correlation'])}{share}"
        )
    if out is not None:
        out.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
        click.echo(f"Written: {out}")


def _group(text: str) -> tuple[str, list[int]]:
    name, sign, ids = text.partition("=")
    try:
        if not sign or not name:
            raise ValueError(text)
        return name, [int(number) for number in ids.split(",")]
    except ValueError:
        raise click.BadParameter(f"{text!r} is no NAME=ID,ID...", param_hint="GROUPS") from None


def _table(found: dict[str, Any], names: list[str]) -> Table:
    table = Table("number", "unit", *names, "difference", "its noise", "")
    for row in found["rows"]:
        cells = [_mean(row["groups"][name]) for name in names]
        told = {None: "", True: "stands out", False: "within noise"}[row["stands_out"]]
        table.add_row(
            row["name"], row["unit"], *cells, _number(row["difference"]), _number(row["noise"]), told
        )
    return table


def _signed(value: float | None) -> str:
    return "–" if value is None else f"{value:+.2f}"


def _mean(group: dict[str, Any]) -> str:
    spread = "" if group["sd"] is None else f" +- {group['sd']:.2g}"
    return f"{_number(group['mean'])}{spread} ({group['charges']})"


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.4g}"
