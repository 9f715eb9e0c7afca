"""Charges as their pages show them: the list, and one charge beside the others of its series."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from sqlalchemy.orm import Session

from demcore.experiments.charge_comparison import NUMBERS, compare, number_of
from demcore.experiments.charge_findings import Finding, compare_findings
from service.dashboard import formats
from service.dashboard.charge_charts import charge_charts
from service.dashboard.design_page import Figure, FigureGroup
from service.dashboard.sector_rose import Rose, draw_rose
from service.dashboard.words import CHARGE_NUMBERS
from service.db import dashboard_reads, queries, read_charges
from service.db.dashboard_reads import OpenJob
from service.db.models import ArtifactRow, ChargeRow
from service.db.read_charges import ChargeView
from service.domain.charge_pictures import PICTURES
from service.domain.states import DesignState, is_over

CHARGES_A_PAGE = 25
FILES: Mapping[str, str] = {
    "report": "Report, one page to keep (HTML)",
    "summary": "Every number (JSON)",
    "result": "Result, opens in ParaView (VTKHDF)",
    "spheres": "Grains over time (VTKHDF)",
    "walls": "Walls over time (VTKHDF)",
}


@dataclass(frozen=True)
class ChargeLine:
    """A charge in a list."""

    view: ChargeView
    now: float

    @property
    def charge(self) -> ChargeRow:
        return self.view.charge

    @property
    def fraction(self) -> float | None:
        """Of the work, while it runs."""
        progress = (self.view.job.progress if self.view.job else None) or {}
        return progress.get("fraction") if self.charge.state is DesignState.RUNNING else None

    @property
    def findings(self) -> Mapping[str, Any]:
        return (self.charge.results or {}).get("findings") or {}

    @property
    def seconds(self) -> float | None:
        """By the clock, from its first start."""
        if self.charge.started_at is None:
            return None
        return (self.charge.ended_at or self.now) - self.charge.started_at


@dataclass(frozen=True)
class ChargeListPage:
    """Everything that the list's templates read. `older`: the id to go on from, None at the end."""

    lines: Sequence[ChargeLine]
    older: int | None
    is_first: bool


@dataclass(frozen=True)
class SeriesRow:
    """A number over the charges of a series: each one's, their mean and their standard deviation."""

    label: str
    meaning: str
    values: Sequence[str]
    mean: str
    scatter: str


@dataclass(frozen=True)
class ChargePage:
    """Everything that a charge's templates read; `series`: all charges of the same request, by id."""

    line: ChargeLine
    series: Sequence[ChargeLine]
    jobs: Sequence[OpenJob]

    @property
    def charge(self) -> ChargeRow:
        return self.line.charge

    @property
    def is_over(self) -> bool:
        return is_over(self.charge.state)

    @property
    def is_settled(self) -> bool:
        """Nothing of what the page shows will change."""
        return all(is_over(line.charge.state) for line in self.series)

    @property
    def results(self) -> Mapping[str, Any]:
        return self.charge.results or {}

    @property
    def charts(self) -> Mapping[str, Any]:
        return charge_charts(self.results)

    @property
    def pictures(self) -> Sequence[tuple[ArtifactRow, str]]:
        by_kind = {file.kind: file for file in self.line.view.artifacts}
        return [(by_kind[kind], told) for kind, told in PICTURES.items() if kind in by_kind]

    @property
    def files(self) -> Sequence[tuple[ArtifactRow, str]]:
        by_kind = {file.kind: file for file in self.line.view.artifacts}
        return [(by_kind[kind], told) for kind, told in FILES.items() if kind in by_kind]

    @property
    def findings(self) -> Sequence[Finding]:
        """None where the results are of an older form or not there."""
        known = {"findings", "inputs", "belt"} <= set(self.results)
        return compare_findings(self.results) if known else ()

    @property
    def rose(self) -> Rose | None:
        return draw_rose(self.results)

    @property
    def figures(self) -> Sequence[FigureGroup]:
        if not self.results:
            return ()
        return (
            FigureGroup("How the burden lies", [_figure(self.results, name) for name in CHARGE_NUMBERS]),
            FigureGroup("Where the mass is", _mass_figures(self.results)),
            FigureGroup("Simulation", _simulation_figures(self.results)),
        )

    @property
    def assumed(self) -> Sequence[tuple[str, str]]:
        """What differs from the shipped plant."""
        spec = self.charge.spec
        changed = [
            (f"{part} {key}".replace("_", " "), f"{value:g}")
            for part, row in spec["plant"].items()
            for key, value in row.items()
        ]
        return [*changed, *((part, f"mesh {mesh['file_name']}") for part, mesh in spec["meshes"].items())]

    @cached_property
    def measured(self) -> Sequence[ChargeLine]:
        """Of the series, those with results."""
        return [line for line in self.series if line.charge.results]

    @property
    def comparison(self) -> Sequence[SeriesRow]:
        """Empty unless the series has two charges with results."""
        if len(self.measured) < 2:
            return ()
        summaries = [line.charge.results or {} for line in self.measured]
        rows = {row.name: row.groups["series"] for row in compare({"series": summaries})}
        return [
            SeriesRow(
                word.text,
                word.meaning,
                [tell(name, number_of(summary, name)) for summary in summaries],
                tell(name, rows[name].mean),
                tell(name, rows[name].sd),
            )
            for name, word in CHARGE_NUMBERS.items()
        ]


def read_charge_list(session: Session, before: int | None = None) -> ChargeListPage:
    """Charges newest first; `before`: the last id of the page that came before."""
    views = read_charges.list_charges(session, CHARGES_A_PAGE + 1, before)
    now = queries.now(session)
    shown = [ChargeLine(view, now) for view in views[:CHARGES_A_PAGE]]
    older = shown[-1].charge.id if len(views) > CHARGES_A_PAGE else None
    return ChargeListPage(shown, older, before is None)


def read_charge_page(session: Session, charge_id: int) -> ChargePage | None:
    """One charge with its series."""
    view = read_charges.open_charge(session, charge_id)
    if view is None:
        return None
    now = queries.now(session)
    series = [ChargeLine(one, now) for one in read_charges.open_series(session, view.charge.series)]
    return ChargePage(ChargeLine(view, now), series, dashboard_reads.open_jobs(session, charge_id=charge_id))


def tell(name: str, value: float | None) -> str:
    """One of demcore's NUMBERS as a person reads it; a dash for what is not there."""
    if value is None or not math.isfinite(value):
        return formats.NOTHING
    unit = NUMBERS[name][0]
    if unit == "m" and name.endswith("size_m"):
        return formats.length(value)
    if unit == "deg":
        return formats.degrees(value, 1)
    if unit != "1":
        return formats.quantity(value, unit)
    return formats.percent(value) if CHARGE_NUMBERS[name].is_share else f"{value:.3g}"


def _figure(results: Mapping[str, Any], name: str) -> Figure:
    word = CHARGE_NUMBERS[name]
    return Figure(word.text, tell(name, number_of(results, name)), word.meaning)


def _mass_figures(r: Mapping[str, Any]) -> Sequence[Figure]:
    squeezed = "grains that the paper's soft springs let through a wall; one in a hundred may"
    return (
        Figure("Fed", formats.quantity(r.get("fed_kg"), "kg", 5), ""),
        Figure("In the hopper", formats.quantity(r.get("in_hopper_kg"), "kg", 5), ""),
        Figure("On the belt, in flight", _sum(r, "on_belt_kg", "in_flight_kg"), "at the end"),
        Figure("Lost", formats.quantity(r.get("lost_kg"), "kg"), "beside the hopper or on its lid"),
        Figure("Pressed through walls", formats.count(r.get("squeezed_through_walls")), squeezed),
        Figure("Level if it lay even", formats.length(r.get("level_if_even_m")), "below the rim"),
        Figure("Bulk density", formats.quantity(r.get("bulk_density_kg_m3"), "kg/m³"), ""),
    )


def _sum(r: Mapping[str, Any], *names: str) -> str:
    values = [r.get(name) for name in names]
    there = [value for value in values if value is not None]
    return formats.quantity(sum(there), "kg") if there else formats.NOTHING


def _simulation_figures(r: Mapping[str, Any]) -> Sequence[Figure]:
    merged = "mass of grains that the scale would make larger than a third of the narrowest passage"
    return (
        Figure("Grains", formats.count(r.get("particles")), ""),
        Figure("Made smaller", formats.percent(r.get("merged_share_of_mass")), merged),
        Figure("Simulated time", formats.quantity(r.get("simulated_s"), "s"), ""),
        Figure("Time step", formats.quantity(r.get("time_step_s"), "s"), ""),
        Figure("Steps", formats.count(r.get("steps")), ""),
        Figure("Computing time", formats.duration(r.get("wall_s")), "by the clock"),
    )
