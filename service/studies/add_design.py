"""Add a design by hand, or run one again, while the study runs or is paused.

A design by hand takes the next number of the study's one sequence, like a proposed one: it counts against the
budget, and proposals see its result by the same rule (design n sees designs up to n - parallel). An open proposal,
which was for that number, is withdrawn and asked for again with the next one. So a study is a function of its
specification and of what its user did at which number, whoever finishes first.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.db import queries
from service.db.models import DesignRow, StudyRow
from service.domain.errors import InvalidValue
from service.domain.search_space import SearchSpace
from service.domain.spec_record import design_hash, spec_from_record
from service.domain.states import ActionNotAllowed, DesignState, JobKind, StudyState
from service.studies.advance_study import add_job, advance_study, next_number, spent
from service.studies.record_event import record_design_event
from service.studies.withdraw_jobs import withdraw_decision

LARGEST_SEED = 2**31 - 1
BY_HAND = "Added by hand."


@dataclass(frozen=True)
class WantedDesign:
    """`seed` None: one that no other run of these parameters has. `supersedes`: see `DesignRow`."""

    x: Mapping[str, float]
    scale: float
    seed: int | None = None
    origin: str = "manual"
    reason: str = BY_HAND
    supersedes: int | None = None


def add_design(
    session: Session,
    study_id: int,
    x: Mapping[str, float],
    seed: int | None = None,
    idempotency_key: str | None = None,
) -> DesignRow | None:
    """None: no such study. The same key, or the same parameters with the same `seed`, give the stored design.

    Raises InvalidValue for parameters that are not the study's or lie outside its box, ActionNotAllowed when the
    study takes no designs (any more).
    """
    study = queries.lock_study(session, study_id)
    if study is None:
        return None
    space = spec_from_record(study.spec).space
    _check(space, x, seed)
    ordered = {name: float(x[name]) for name in space.names}
    return append(session, study, WantedDesign(ordered, float(study.spec["scale"]), seed), idempotency_key)


def rerun_design(
    session: Session, design_id: int, same_seed: bool, idempotency_key: str | None = None
) -> DesignRow | None:
    """The same parameters with another seed (a replicate), or, after an error, with the same. None: no such.

    The repetition of an error takes its place: proposals that see the new result no longer see the error.
    Raises ActionNotAllowed for the same seed where there was no error.
    """
    study_id = session.scalar(select(DesignRow.study_id).where(DesignRow.id == design_id))
    study = queries.lock_study(session, study_id) if study_id is not None else None
    if study is None:
        return None
    design = session.get_one(DesignRow, design_id, populate_existing=True)
    if not same_seed:
        again = WantedDesign(
            design.x,
            design.scale,
            None,
            "replicate",
            f"Another seed of design {design.number}, asked for by hand.",
        )
        return append(session, study, again, idempotency_key)
    if design.state is not DesignState.FAILED:
        text = "only a design that ended in error can be repeated with the same seed"
        raise ActionNotAllowed(f"{text}, and design {design.number} is {design.state.value}")
    reason = f"Design {design.number} again with its own seed, asked for by hand after its error."
    repeated = WantedDesign(design.x, design.scale, design.seed, design.origin, reason, design.number)
    return append(session, study, repeated, idempotency_key)


def append(session: Session, study: StudyRow, wanted: WantedDesign, key: str | None) -> DesignRow:
    """Needs the study's lock."""
    spec = spec_from_record(study.spec)
    x_hash = design_hash(spec.parameters_of(tuple(wanted.x[name] for name in spec.space.names)))
    stored = _stored(session, study, wanted, x_hash, key)
    if stored is not None:
        return stored
    if study.state not in (StudyState.RUNNING, StudyState.PAUSED):
        raise ActionNotAllowed(f"study {study.id} is {study.state.value} and takes no more designs")
    number = next_number(session, study.id)
    if spent(session, study) >= study.budget:
        raise ActionNotAllowed(f"the budget of {study.budget} simulations is spent: extend it first")
    design = DesignRow(
        study_id=study.id,
        number=number,
        x=dict(wanted.x),
        x_hash=x_hash,
        scale=wanted.scale,
        seed=_free_seed(session, study, number, x_hash) if wanted.seed is None else wanted.seed,
        origin=wanted.origin,
        reason=wanted.reason,
        supersedes=wanted.supersedes,
        idempotency_key=key,
        state=DesignState.WAITING,
    )
    session.add(design)
    session.flush()
    withdraw_decision(session, study, f"design {number} was added by hand")
    add_job(session, study.id, JobKind.SIMULATE, design.id)
    record_design_event(session, design, "design_proposed")
    advance_study(session, study)
    return design


def _stored(
    session: Session, study: StudyRow, wanted: WantedDesign, x_hash: str, key: str | None
) -> DesignRow | None:
    """What an earlier request of the same meaning has made."""
    mine = select(DesignRow).where(DesignRow.study_id == study.id)
    if key is not None:
        by_key = session.scalars(mine.where(DesignRow.idempotency_key == key)).one_or_none()
        if by_key is not None:
            if by_key.x_hash != x_hash or wanted.seed not in (None, by_key.seed):
                raise InvalidValue(
                    "Idempotency-Key", key, f"a new key: this one belongs to design {by_key.number}"
                )
            return by_key
    if wanted.seed is None:
        return None
    live = mine.where(
        DesignRow.x_hash == x_hash,
        DesignRow.scale == wanted.scale,
        DesignRow.seed == wanted.seed,
        DesignRow.state.not_in((DesignState.CANCELLED, DesignState.FAILED)),
    )
    return session.scalars(live).one_or_none()


def _free_seed(session: Session, study: StudyRow, number: int, x_hash: str) -> int:
    """Depends on the study's seed and the number alone, until it is new for these parameters."""
    same = select(DesignRow.seed).where(DesignRow.study_id == study.id, DesignRow.x_hash == x_hash)
    used, attempt = set(session.scalars(same)), 0
    while True:
        text = f"by hand {study.seed} {number} {attempt}".encode()
        seed = 1 + int.from_bytes(hashlib.sha256(text).digest()[:8]) % LARGEST_SEED
        if seed not in used:
            return seed
        attempt += 1


def _check(space: SearchSpace, x: Mapping[str, float], seed: int | None) -> None:
    for name in x:
        if name not in space.names:
            raise InvalidValue(
                f"x.{name}", x[name], "one of the study's variables: " + ", ".join(space.names)
            )
    for variable in space.variables:
        value = x.get(variable.name)
        allowed = f"{variable.lower:g} to {variable.upper:g}"
        if value is None:
            raise InvalidValue(f"x.{variable.name}", None, f"required, {allowed}")
        if not (math.isfinite(value) and variable.lower <= value <= variable.upper):
            raise InvalidValue(f"x.{variable.name}", value, allowed)
    if seed is not None and not 0 <= seed <= LARGEST_SEED:
        raise InvalidValue("seed", seed, f"a whole number from 0 to {LARGEST_SEED}")
