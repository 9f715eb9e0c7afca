"""One design as its page shows it: the pile, how its angle was read, what was predicted, what it cost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy.orm import Session

from demcore.rig import FEWEST_DIAMETERS
from service.dashboard import charts, formats
from service.dashboard.study_page import picture_of
from service.db import dashboard_reads, read_models
from service.db.dashboard_reads import OpenJob
from service.db.models import ArtifactRow, DesignRow, RunRow, StudyRow
from service.db.read_models import DesignView
from service.domain.explanation import Comparison, compare
from service.domain.spec_record import primary_response
from service.domain.states import StudyState, is_over


@dataclass(frozen=True)
class Figure:
    """A number of the results with its unit, and what it means."""

    label: str
    value: str
    meaning: str


@dataclass(frozen=True)
class FigureGroup:
    """Figures that belong together."""

    title: str
    figures: Sequence[Figure]


@dataclass(frozen=True)
class DesignPage:
    """Everything that the templates of a design read. `neighbours`: ids of the ones before and after it."""

    view: DesignView
    study: StudyRow
    runs: Sequence[RunRow]
    jobs: Sequence[OpenJob]
    neighbours: tuple[int | None, int | None]
    cursor: int

    @property
    def design(self) -> DesignRow:
        return self.view.design

    @property
    def is_over(self) -> bool:
        return is_over(self.design.state)

    @property
    def picture(self) -> ArtifactRow | None:
        return picture_of(self.view)

    @property
    def fixed(self) -> Mapping[str, float]:
        """Contact parameters of the pile that the study did not search."""
        known = (self.design.results or {}).get("parameters") or self.study.spec.get("fixed") or {}
        return {n: value for n, value in known.items() if n not in self.design.x and value is not None}

    @property
    def compared(self) -> Sequence[Comparison]:
        """What was predicted of each response, and what came out."""
        fit = self.view.surrogate
        return compare(
            self.design.prediction, fit.hyperparameters if fit is not None else None, self.design.responses
        )

    @property
    def can_be_run_again(self) -> bool:
        return self.is_over and self.study.state in (StudyState.RUNNING, StudyState.PAUSED)

    @property
    def charts(self) -> dict[str, Any]:
        response = primary_response(self.study.spec)
        return {
            "profile": charts.profile_chart(self.design),
            "sectors": charts.sector_chart(self.design, response["target"], response["window"]),
        }

    @property
    def figures(self) -> Sequence[FigureGroup]:
        return figure_groups(self.design.results) if self.design.results else ()


def read_design_page(session: Session, design_id: int) -> DesignPage | None:
    """None: there is no such design."""
    view = read_models.open_design(session, design_id)
    if view is None:
        return None
    snapshot = dashboard_reads.open_study(session, view.design.study_id)
    assert snapshot is not None
    ids = {row.number: row.id for row in snapshot.designs}
    number = view.design.number
    return DesignPage(
        view=view,
        study=snapshot.study,
        runs=read_models.runs_of_job(session, view.job.id) if view.job else (),
        jobs=[job for job in snapshot.jobs if job.job.design_id == design_id],
        neighbours=(ids.get(number - 1), ids.get(number + 1)),
        cursor=snapshot.cursor,
    )


def figure_groups(results: Mapping[str, Any]) -> Sequence[FigureGroup]:
    """All numbers of a pile test that are there, in the order in which a reader asks for them."""
    groups = (
        FigureGroup("Angle", _angle_figures(results)),
        FigureGroup("Pile", _pile_figures(results)),
        FigureGroup("Simulation", _simulation_figures(results)),
    )
    shown = [
        FigureGroup(group.title, [figure for figure in group.figures if figure.value != formats.NOTHING])
        for group in groups
    ]
    return [group for group in shown if group.figures]


def _angle_figures(r: Mapping[str, Any]) -> Sequence[Figure]:
    angle = formats.degrees_within(r.get("angle_deg"), r.get("angle_standard_error_deg"))
    literal = formats.degrees_within(r.get("literal_angle_deg"), r.get("literal_standard_error_deg"))
    few = formats.percent(r.get("literal_share_of_bins_under_3"))
    return (
        Figure("Repose angle by surface scan", angle, "mean slope over 24 sectors ± its standard error"),
        Figure(
            "Literal reading", literal, "highest particle centre per bin, as the paper words it; reads low"
        ),
        Figure(
            "Literal bins under 3 particles", few, "bins that hold too few particles to read a height from"
        ),
        Figure(
            "Height of the fitted line at the axis",
            formats.length(r.get("fit_intercept_m")),
            "intercept of h(r)",
        ),
    )


def _pile_figures(r: Mapping[str, Any]) -> Sequence[Figure]:
    rig = r.get("rig") or {}
    return (
        Figure("Mass on the base", formats.quantity(r.get("mass_on_base_kg"), "kg"), "after the discharge"),
        Figure(
            "Mass filled in", formats.quantity(r.get("mass_filled_kg"), "kg"), "bulk density times volume"
        ),
        Figure("Height of the apex", formats.length(r.get("apex_height_m")), "highest surface of a particle"),
        Figure("Height of the fill", formats.length(r.get("fill_height_m")), "before the cylinder vanished"),
        Figure(
            "Particles on the base", formats.count(r.get("particles_on_base")), "of all that were filled in"
        ),
        Figure("Particles filled in", formats.count(r.get("particles_filled")), ""),
        Figure(
            "Discharge, 90 %",
            formats.quantity(r.get("discharge_t90_s"), "s"),
            "until 90 % of what left had left",
        ),
        Figure("Base diameter", formats.length(rig.get("base_diameter")), "of the round steel base"),
        Figure(
            "Mean diameters along the base radius",
            formats.quantity(r.get("diameters_across_base_radius")),
            f"below {FEWEST_DIAMETERS:g} the angle feels the size of the particles",
        ),
    )


def _simulation_figures(r: Mapping[str, Any]) -> Sequence[Figure]:
    return (
        Figure("Time step", formats.quantity(r.get("time_step_s"), "s"), str(r.get("time_step_preset", ""))),
        Figure("Steps", formats.count(r.get("steps")), ""),
        Figure(
            "Simulated time", formats.quantity(r.get("simulated_s"), "s"), "filling, settling and discharge"
        ),
        Figure(
            "Cylinder removed at", formats.quantity(r.get("settled_at_s"), "s"), "when the bed was at rest"
        ),
        Figure("Computing time", formats.duration(r.get("wall_s")), "by the clock"),
        Figure("Particle steps", formats.quantity(r.get("particle_steps")), "particles times steps"),
        Figure(
            "Neighbour searches", formats.count(r.get("neighbour_searches")), "rebuilds of the contact list"
        ),
        Figure(
            "Random seed",
            str(r.get("seed", formats.NOTHING)),
            "the same seed gives the same bits",
        ),
    )
