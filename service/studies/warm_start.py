"""Earlier studies of the same test that a study starts from: which may, and what they know.

The same test: material (and with it the rig), scale, fill level, time step and version of the model; and designs
that say the same of every parameter that this study does not search. Such a study is over, so that what it knows
never changes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.db.models import DesignRow, StudyRow
from service.domain.errors import InvalidValue
from service.domain.history import FinishedDesign, WarmHistory
from service.domain.model_use import ModelUse
from service.domain.noise import pooled
from service.domain.observables import NoiseLevel
from service.domain.spec_record import spec_from_record
from service.domain.states import DesignState, is_over
from service.domain.study import StudySpec

PROTOCOL = ("material", "scale", "fill_level", "time_step", "model")


def check_warm_start(session: Session, spec: StudySpec) -> None:
    """Raises InvalidValue, saying what differs, for a study that `spec` cannot start from."""
    for study_id in spec.warm_start:
        study = session.get(StudyRow, study_id)
        if study is None:
            raise InvalidValue("warm_start", study_id, "the number of a stored study")
        if not is_over(study.state):
            raise InvalidValue(
                "warm_start", study_id, f"a study that is over; this one is {study.state.value}"
            )
        source = spec_from_record(study.spec)
        for name in PROTOCOL:
            here, there = getattr(spec, name), getattr(source, name)
            if here != there:
                allowed = f"a study of the same test: its {name} is {_told(there)}, here it is {_told(here)}"
                raise InvalidValue("warm_start", study_id, allowed)
        designs = _designs(session, study_id)
        if not any(_translated(spec, source, design) for design in designs if design.responses):
            allowed = "a study with a result inside this study's space, all its other parameters alike"
            raise InvalidValue("warm_start", study_id, f"{allowed}{_difference(spec, source)}")


def _told(value: object) -> object:
    return value.name if isinstance(value, ModelUse) else "the baseline" if value is None else value


def read_warm_start(session: Session, study: StudyRow) -> tuple[WarmHistory, ...]:
    """The finished designs of each study that this one starts from, in its variables.

    None for a study that was read in: the numbers in its spec are those of another installation.
    """
    if study.import_hash is not None:
        return ()
    return earlier_studies(session, spec_from_record(study.spec))


def earlier_studies(session: Session, spec: StudySpec) -> tuple[WarmHistory, ...]:
    """The finished designs of each study that `spec` names; `check_warm_start` says whether it may."""
    found = []
    for study_id in spec.warm_start:
        source = spec_from_record(session.get_one(StudyRow, study_id).spec)
        translated = [_translated(spec, source, design) for design in _designs(session, study_id)]
        found.append(WarmHistory(study_id, tuple(design for design in translated if design is not None)))
    return tuple(found)


def pooled_noise(warm: Sequence[WarmHistory]) -> dict[str, NoiseLevel]:
    """By observable, the pooled sd inside their designs of several seeds."""
    groups: dict[str, dict[tuple[int, tuple[float, ...]], list[float]]] = {}
    for study in warm:
        for design in study.finished:
            for name, value in (design.results or {}).items():
                groups.setdefault(name, {}).setdefault((study.study_id, design.x), []).append(value)
    found = {name: pooled(values.values()) for name, values in groups.items()}
    return {name: level for name, level in found.items() if level is not None}


def _designs(session: Session, study_id: int) -> Sequence[DesignRow]:
    over = (DesignState.COMPLETE, DesignState.FAILED)
    statement = select(DesignRow).where(DesignRow.study_id == study_id, DesignRow.state.in_(over))
    return session.scalars(statement.order_by(DesignRow.number)).all()


def _translated(spec: StudySpec, source: StudySpec, design: DesignRow) -> FinishedDesign | None:
    """The design in the variables of `spec`; None where it is none of them or differs in another parameter."""
    if design.scale != spec.scale:
        return None
    values = source.parameters_of(tuple(float(design.x[name]) for name in source.space.names))
    if any(name not in values for name in spec.space.names):
        return None
    x = tuple(values[name] for name in spec.space.names)
    if not all(v.lower <= a <= v.upper for v, a in zip(spec.space.variables, x, strict=True)):
        return None
    if not _alike(values, spec.parameters_of(x)):
        return None
    results = None if design.state is DesignState.FAILED else dict(design.responses or {})
    return FinishedDesign(design.number, x, design.seed, results, "warm", design.scale)


def _alike(a: Mapping[str, float], b: Mapping[str, float]) -> bool:
    return a.keys() == b.keys() and all(math.isclose(a[name], b[name], rel_tol=1e-9) for name in a)


def _difference(spec: StudySpec, source: StudySpec) -> str:
    """A fixed parameter that differs, if that is what it is."""
    for name, value in spec.fixed.items():
        there = source.fixed.get(name)
        if there is not None and there != value:
            return f": {name} is {there:g} there and {value:g} here"
    return ""
