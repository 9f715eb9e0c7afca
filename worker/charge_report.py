"""The report of a charge: one HTML page with its pictures inside, to be kept, sent and opened anywhere.

It shows what was asked, what was assumed and why, what came out beside what the plant saw, and how it was checked.
Everything is read from the summary; the only numbers made here are shares and spans of what stands there.
"""

from __future__ import annotations

import base64
import json
import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from demcore.experiments.charge_findings import compare_findings
from service.code_version import demcore_hash
from service.domain.charge import TOLD, ChargeSpec
from service.domain.charge_pictures import PICTURES


@dataclass(frozen=True)
class Source:
    """Which charge of which installation the report is on."""

    charge_id: int
    spec: ChargeSpec


@lru_cache(maxsize=1)
def environment() -> Environment:
    """Everything is escaped; an unknown name is an error instead of an empty text."""
    made = Environment(
        loader=PackageLoader("worker"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters.update(mm=lambda m: "–" if m is None else f"{1e3 * m:.0f}", fixed=fixed, percent=percent)
    return made


def fixed(value: float | None, digits: int = 2) -> str:
    """A number to so many digits; a dash for what is not there."""
    return "–" if value is None or not math.isfinite(value) else f"{value:.{digits}f}"


def percent(share: float | None, digits: int = 0) -> str:
    """A share in percent; a dash for what is not there."""
    return fixed(None if share is None else 100.0 * share, digits)


def write_report(summary: Mapping[str, Any], source: Source, pictures: Path, path: Path) -> None:
    """Write the page; `summary` is the charge's with its findings, pictures lie in the folder `pictures`."""
    images = {
        name: base64.b64encode((pictures / f"{name}.png").read_bytes()).decode()
        for name in PICTURES
        if (pictures / f"{name}.png").exists()
    }
    text = (
        environment()
        .get_template("charge.html")
        .render(
            s=summary,
            charge=source,
            findings=compare_findings(summary),
            sectors=sector_rows(summary),
            assumptions=assumption_rows(summary["inputs"]["plant"]["sources"]),
            changed=[
                (f"{part}.{key}", value)
                for part, row in source.spec.plant.items()
                for key, value in row.items()
            ],
            parameters=parameter_rows(summary["inputs"]["charge"]["parameters"]),
            missing=largest_missing(summary["account"]),
            pictures=[(name, images[name], told) for name, told in PICTURES.items() if name in images],
            command=command_of(source.spec),
            version=version("talus"),
            code=demcore_hash()[:16],
        )
    )
    path.write_text(text, encoding="utf-8")


def sector_rows(summary: Mapping[str, Any]) -> list[dict[str, Any]]:
    """One row a sector, with what leaves there first when the bell opens."""
    sectors, layer = summary["sectors"], summary["bell_layer"]
    names = ("azimuth_deg", "mass", "particles", "height", "volume", "size")
    seat = -summary["inputs"]["plant"]["hopper"]["seat_depth"]
    rows = [
        dict(zip(names, values, strict=True)) for values in zip(*(sectors[n] for n in names), strict=True)
    ]
    for row, mass in zip(rows, layer["mass_kg"], strict=True):
        row["height"] -= seat
        row["bell_mass"] = mass
    return rows


def assumption_rows(sources: Mapping[str, str]) -> list[tuple[str, str, str]]:
    """Number, kind (published, assumed, given) and reason of every number of the plant."""
    rows = []
    for name, why in sources.items():
        kind = "published" if why.startswith("paper") else "given" if why.endswith(TOLD) else "assumed"
        rows.append((name, kind, why))
    return rows


def parameter_rows(parameters: Mapping[str, Any]) -> list[tuple[str, list[tuple[str, float]]]]:
    """Contact numbers by material; one row for a set that holds for all contacts."""
    if "parts" in parameters:
        sets = [(part["material"], part["parameters"]) for part in parameters["parts"]]
    else:
        sets = [("all contacts", parameters)]
    return [(name, [(k, v) for k, v in values.items() if v is not None]) for name, values in sets]


def largest_missing(account: Mapping[str, Sequence[float]]) -> float:
    """kg: the largest difference, over all reports, of what went in and what is somewhere."""
    columns = zip(*(account[n] for n in ("fed", "on_belt", "in_flight", "in_hopper", "lost")), strict=True)
    return max((abs(fed - sum(places)) for fed, *places in columns), default=0.0)


def command_of(spec: ChargeSpec) -> str:
    """The command that asks a running service for the same charge."""
    words = ["talus", "charge", spec.charge, "--scale", f"{spec.scale:g}", "--seed", str(spec.seed)]
    if spec.plant:
        words += ["--plant", json.dumps({part: dict(row) for part, row in spec.plant.items()})]
    if spec.parameters:
        words += ["--parameters", json.dumps({name: dict(row) for name, row in spec.parameters.items()})]
    if spec.model is not None:
        moisture = f"{spec.model.moisture_percent:g}"
        words += ["--model-version", spec.model.name, "--moisture-percent", moisture]
    return " ".join(shlex.quote(word) for word in words)
