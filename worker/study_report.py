"""A study's history becomes its report: mathematics with what demcore knows, time steps and literature."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from demcore.errors import InputError
from demcore.experiments.paper_tables import TABLE_5
from service.domain.history import StudyHistory
from service.domain.search_space import PAPER_PARAMETERS
from service.domain.study import StudySpec
from worker.evaluate import test_of
from worker.optimize import whole_history
from worker.optimizer.optimum import Preferences
from worker.optimizer.report import MEMBERS, study_report

# They shorten the step with the preset `paper` alone (physics.md section 1).
RESTITUTIONS = ("particle_particle_restitution", "particle_wall_restitution")


def report_of(
    history: StudyHistory,
    members: int = MEMBERS,
    level: float = 0.5,
    lab_sds: Mapping[str, float] | None = None,
) -> dict[str, Any]:
    """worker.optimizer.report.study_report of everything that is finished. `members` and `level` are the
    ensemble's size and least P(window), `lab_sds` the lab's sd of further tests by name."""
    spec = history.spec
    like = Preferences(time_step_of(spec), literature(spec.material))
    return study_report(spec, whole_history(history), like, lab_sds, members, level)


def time_step_of(spec: StudySpec) -> Callable[[tuple[float, ...]], float]:
    """`time_step_s` of designs, asked once for equal values, to two digits, of what decides about it."""
    deciding = {"youngs_modulus_pa", *(RESTITUTIONS if spec.time_step == "paper" else ())}
    known: dict[tuple[str, ...], float] = {}

    def ask(x: tuple[float, ...]) -> float:
        values = spec.parameters_of(x)
        key = tuple(f"{values[name]:.2g}" for name in sorted(deciding & set(values)))
        if key not in known:
            known[key] = time_step_s(spec, x)
        return known[key]

    return ask


def time_step_s(spec: StudySpec, x: tuple[float, ...]) -> float:
    """The time step of a design, s; 0 for one that no pile test takes."""
    try:
        return test_of(spec, x, spec.scale).dt
    except InputError:
        return 0.0


def literature(material: str) -> dict[str, float] | None:
    """The paper's Table 5 by parameter; None for a material that it lacks."""
    values = TABLE_5.get(material)
    return None if values is None else dict(zip(PAPER_PARAMETERS, values, strict=True))
