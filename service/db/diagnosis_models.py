"""The tables of diagnoses: measured data sets, what was made of them, versions of the model, stored runs.

Append-only, but for a data set's one opening, a diagnosis' state and a version's withdrawal.
"""

from __future__ import annotations

from typing import Any

from sqlalchemy import ForeignKey, Index, String, Text, UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column

from service.db.base import Base, Id, OfProject, stored_enum
from service.db.clock import database_now
from service.domain.claims import CheckOutcome
from service.domain.states import DesignState


class DataSetRow(OfProject, Base):
    """Measured tables as they were read, in the units of their columns. `facts`: what is shown of them without
    reading `content`. `opened_by`: the one diagnosis that may look at the held-out conditions."""

    __tablename__ = "data_sets"
    __table_args__ = (UniqueConstraint("split_hash", "project"), {"sqlite_autoincrement": True})

    id: Mapped[int] = mapped_column(Id, primary_key=True)
    name: Mapped[str] = mapped_column(String(100))
    split_hash: Mapped[str] = mapped_column(String(64))
    content: Mapped[dict[str, Any]]
    facts: Mapped[dict[str, Any]]
    opened_by: Mapped[int | None]
    opened_at: Mapped[float | None]
    created_at: Mapped[float] = mapped_column(default=database_now())


class DiagnosisRow(OfProject, Base):
    """One diagnosis of a data set. `cost`: what it was expected to take; `results`: the published form of what it
    says, with the limits, sentences and p value behind it."""

    __tablename__ = "diagnoses"
    __table_args__ = (
        UniqueConstraint("idempotency_key", "project"),
        Index("ix_diagnoses_data_set_id", "data_set_id"),
        {"sqlite_autoincrement": True},
    )

    id: Mapped[int] = mapped_column(Id, primary_key=True)
    data_set_id: Mapped[int] = mapped_column(ForeignKey("data_sets.id", ondelete="CASCADE"))
    state: Mapped[DesignState] = mapped_column(stored_enum(DesignState, "state"), default=DesignState.WAITING)
    spec: Mapped[dict[str, Any]]
    cost: Mapped[dict[str, Any]]
    verdict: Mapped[str | None] = mapped_column(String(32))
    results: Mapped[dict[str, Any] | None]
    failure_class: Mapped[str | None] = mapped_column(String(32))
    failure_text: Mapped[str | None] = mapped_column(Text)
    code_version: Mapped[str | None] = mapped_column(String(64))
    idempotency_key: Mapped[str | None] = mapped_column(String(200))
    request_hash: Mapped[str | None] = mapped_column(String(64))
    created_at: Mapped[float] = mapped_column(default=database_now())
    started_at: Mapped[float | None]
    ended_at: Mapped[float | None]


class ModelVersionRow(OfProject, Base):
    """The model extended with named effects: `effects` by id, each with its amplitude and 90 % interval;
    `parameters`: the contact parameters calibrated beside them, with their joint posterior. `base` names the
    simulator and its code. A version that is withdrawn stays visible and can no longer be used."""

    __tablename__ = "model_versions"
    __table_args__ = (
        UniqueConstraint("name", "project"),
        Index("ix_model_versions_diagnosis_id", "diagnosis_id"),
        {"sqlite_autoincrement": True},
    )

    id: Mapped[int] = mapped_column(Id, primary_key=True)
    name: Mapped[str] = mapped_column(String(100))
    parent_id: Mapped[int | None] = mapped_column(ForeignKey("model_versions.id"))
    diagnosis_id: Mapped[int] = mapped_column(ForeignKey("diagnoses.id", ondelete="CASCADE"))
    base: Mapped[str] = mapped_column(String(100))
    effects: Mapped[dict[str, Any]]
    parameters: Mapped[dict[str, Any] | None]
    withdrawn_at: Mapped[float | None]
    created_at: Mapped[float] = mapped_column(default=database_now())


class ClaimCheckRow(Base):
    """What a check made of a claimed effect. The last of a claim counts; none is changed or removed."""

    __tablename__ = "claim_checks"
    __table_args__ = (Index("ix_claim_checks_diagnosis_id", "diagnosis_id"), {"sqlite_autoincrement": True})

    id: Mapped[int] = mapped_column(Id, primary_key=True)
    diagnosis_id: Mapped[int] = mapped_column(ForeignKey("diagnoses.id", ondelete="CASCADE"))
    effect: Mapped[str] = mapped_column(String(64))
    outcome: Mapped[CheckOutcome] = mapped_column(stored_enum(CheckOutcome, "outcome"))
    note: Mapped[str] = mapped_column(Text)
    created_at: Mapped[float] = mapped_column(default=database_now())


class SimulatorRunRow(Base):
    """What a pile test told, by the content of the test and the code: no run is made twice."""

    __tablename__ = "simulator_runs"

    key: Mapped[str] = mapped_column(String(64), primary_key=True)
    reading: Mapped[dict[str, Any]]
    created_at: Mapped[float] = mapped_column(default=database_now())


class NullCalibrationRow(Base):
    """Statistics of effect-free runs through the whole diagnosis, by the design and library that they hold for."""

    __tablename__ = "null_calibrations"

    key: Mapped[str] = mapped_column(String(200), primary_key=True)
    content: Mapped[dict[str, Any]]
    created_at: Mapped[float] = mapped_column(default=database_now())
