"""How a study is shown in a terminal: the live table while it runs, the closing table beside the paper's."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from service.client.paper import PAPER
from service.client.study_view import DesignLine, StudyView

SHORT_NAMES = {
    "particle_particle_static_friction": "friction p-p",
    "particle_wall_static_friction": "friction p-wall",
    "particle_particle_restitution": "restitution",
    "rolling_resistance": "rolling",
}
COLOURS = {"feasible": "green", "unfeasible": "yellow", "error": "red"}


def short(name: str) -> str:
    return SHORT_NAMES.get(name, name)


def minutes(seconds: float | None) -> str:
    return "-" if seconds is None else f"{int(seconds) // 60}:{int(seconds) % 60:02d}"


def status(line: DesignLine) -> str:
    """The last column: the verdict, or how far the simulation is."""
    if line.verdict is not None:
        return line.verdict if line.failure is None else f"{line.verdict} ({line.failure})"
    if line.state == "RUNNING" and line.fraction is not None:
        return f"{line.phase or 'running'} {100 * line.fraction:.0f} %"
    return line.state.lower()


def plain_line(view: StudyView, line: DesignLine, now: float) -> str:
    """One design in one line, for a log."""
    values = "  ".join(f"{short(name)} {line.x[name]:.2f}" for name in view.parameters if name in line.x)
    angle = "angle      -" if line.angle_deg is None else f"angle {line.angle_deg:6.2f}"
    best = view.best
    tail = "" if best is None else f"  best {best.angle_deg:.2f} (design {best.number})"
    left = view.seconds_left(now)
    tail += "" if left is None else f"  at most {minutes(left)} left"
    mark = "" if line.is_of_the_budget else f" ({line.origin})"
    return f"design {line.number:3d}  {values}  {angle}  {status(line)}{mark}{tail}"


@dataclass
class LiveTable:
    """Draws the view anew each time that rich asks, so that the clock goes on between events."""

    view: StudyView
    title: str
    rows: int = 40

    def __rich__(self) -> RenderableType:
        view, now = self.view, time.monotonic()
        table = Table(title=self.title, title_justify="left", header_style="bold")
        table.add_column("design", justify="right")
        for name in view.parameters:
            table.add_column(short(name), justify="right")
        table.add_column("angle °", justify="right")
        table.add_column("verdict")
        best = view.best
        for number in sorted(view.designs)[-self.rows :]:
            line = view.designs[number]
            values = [f"{line.x[name]:.2f}" if name in line.x else "" for name in view.parameters]
            angle = "" if line.angle_deg is None else f"{line.angle_deg:.2f}"
            told = Text(status(line), style=COLOURS.get(line.verdict or "", "cyan"))
            table.add_row(str(number), *values, angle, told, style="bold" if line is best else None)
        return Group(table, Text(self._foot(best, now)))

    def _foot(self, best: DesignLine | None, now: float) -> str:
        view = self.view
        shown = "none yet" if best is None else f"{best.angle_deg:.2f}° (design {best.number})"
        left = view.seconds_left(now)
        return (
            f"target {view.target_deg:g}°   best so far {shown}   "
            f"{view.finished} of at most {view.budget} done   "
            f"{minutes(now - view.started)} gone, at most {minutes(left)} left"
        )


def found_lines(recommendation: Mapping[str, Any]) -> list[str]:
    """What the optimum gives, a line for each response."""
    verdict = "certified" if recommendation["certified"] else "not certified"
    return [
        f"{name} {met['mean']:.4g} {met['unit']}, {verdict}: "
        f"within ±{met['half_width_90']:.2g} {met['unit']} (90 %)."
        for name, met in recommendation["responses"].items()
    ]


def studies_table(studies: Iterable[Mapping[str, Any]]) -> Table:
    """What came out of each study, beside its window; of several responses the first. Fits 80 columns."""
    table = Table(
        *("study", "material", "state", "runs", "found", "window", "ended by", "created"),
        box=None,
        pad_edge=False,
        padding=(0, 2, 0, 0),
    )
    for study in studies:
        spec, counters = study["spec"], study["counters"]
        failed = f", {counters['error']} failed" if counters["error"] else ""
        first = spec["responses"][0]
        met = (study["recommendation"] or {"responses": {}})["responses"].get(first["observable"])
        table.add_row(
            str(study["id"]),
            f"{study['material']} ×{spec['scale']:g}",
            study["state"],
            f"{sum(counters.values())}/{spec['budget']}{failed}",
            "-" if met is None else _within(met),
            "{:g}–{:g}".format(*first["window"]),
            (study["stop"] or {}).get("reason") or "",
            f"{datetime.fromisoformat(study['created_at']):%m-%d %H:%M}",
        )
    return table


def _within(met: Mapping[str, Any]) -> str:
    unit = "°" if met["unit"] == "deg" else f" {met['unit']}"
    return f"{met['mean']:.4g} ± {met['half_width_90']:.2g}{unit}"


def noise_lines(study: Mapping[str, Any]) -> list[str]:
    """How far runs of one design scatter beside what the certificate allows, a line for each response."""
    return [
        f"{noise['observable']} scatters between runs: {noise['text']}; tolerance "
        f"{noise['tolerance']:g} {noise['unit']}"
        for noise in study.get("noise") or ()
    ]


def closing_table(material: str, outcome: Mapping[str, Any]) -> Table:
    """Optimum, simulations and repeats of demo.json beside the paper's Tables 5 to 7."""
    paper = PAPER.get(material)
    table = Table(title=f"{material}: this study beside the paper", title_justify="left", header_style="bold")
    table.add_column("")
    table.add_column("this study", justify="right")
    table.add_column("paper", justify="right")
    optimum: Mapping[str, float] = outcome["optimum"]
    for name, value in optimum.items():
        there = paper.optimum.get(name) if paper else None
        table.add_row(f"{short(name)} (Table 5)", f"{value:.2f}", "-" if there is None else f"{there:.2f}")
    table.add_section()
    counts: Mapping[str, int] = outcome["simulations"]
    table.add_row("simulations (Table 6)", str(sum(counts.values())), str(paper.total) if paper else "-")
    for name, count in counts.items():
        table.add_row(f"  {name}", str(count), str(getattr(paper, name)) if paper else "-")
    table.add_section()
    ours: list[float] = outcome["repeats_deg"]
    theirs = paper.repeats_deg if paper else ()
    for n in range(max(len(ours), len(theirs))):
        row = [f"{angles[n]:.1f}°" if n < len(angles) else "-" for angles in (ours, theirs)]
        table.add_row(f"repose angle, repeat {n + 1} (Table 7)", *row)
    return table
