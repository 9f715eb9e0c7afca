"""What ended in the last day, of every kind, newest first: the first thing that a morning asks for."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy.orm import Session

from demcore.experiments.charge_findings import compare_findings
from service.dashboard import formats
from service.dashboard.words import (
    CHARGE_STATES,
    DIAGNOSIS_STATES,
    DIAGNOSIS_TONES,
    STOPS,
    STUDY_STATES,
    Word,
    diagnosis_verdict,
    look_up,
)
from service.db import dashboard_reads
from service.db.models import ChargeRow, DiagnosisRow, StudyRow
from service.domain.effects import library
from service.domain.states import DesignState, StudyState

DAY_S = 86_400.0
MOST = 12


@dataclass(frozen=True)
class Ended:
    """One line: what it was, how it ended, what came out, and when."""

    address: str
    name: str
    about: str
    word: Word
    tone: str
    outcome: str
    when: float
    seconds: float | None


def read_ended(session: Session, now: float) -> Sequence[Ended]:
    """At most MOST lines."""
    rows = dashboard_reads.ended_since(session, now - DAY_S, MOST)
    return [LINES[type(row)](row) for row in rows]


def _study(row: StudyRow) -> Ended:
    found = row.recommendation or {}
    is_certified = bool(found.get("certified"))
    word = STOPS["certified"] if is_certified else look_up(STOPS, row.stop_reason)
    if row.state is StudyState.CANCELLED:
        word = STUDY_STATES["cancelled"]
    tone = "good" if is_certified else "bad" if row.state is StudyState.FAILED else "doubt"
    outcome = "no repose angle"
    if found.get("mean_deg") is not None:
        outcome = formats.degrees_within(found["mean_deg"], found.get("half_width_90_deg"))
    used = row.feasible + row.unfeasible + row.error
    outcome += f" after {used} {'simulation' if used == 1 else 'simulations'}"
    address, name = f"/studies/{row.id}", f"Study {row.id}"
    return Ended(address, name, row.material, word, tone, outcome, *_times(row.created_at, row.ended_at))


def _charge(row: ChargeRow) -> Ended:
    results: Mapping[str, Any] = row.results or {}
    outcome = row.failure_text or ""
    if {"findings", "inputs", "belt"} <= set(results):
        found = compare_findings(results)
        alike = [finding.name.lower() for finding in found if finding.agrees]
        outcome = f"as in the plant: {', '.join(alike) or 'none'} ({len(alike)} of {len(found)} findings)"
    about = f"{row.charge}, scale {row.scale:g}, seed {row.seed}"
    word, tone = look_up(CHARGE_STATES, row.state), _tone(row.state)
    address, name = f"/charges/{row.id}", f"Charge {row.id}"
    return Ended(address, name, about, word, tone, outcome, *_times(row.started_at, row.ended_at))


def _diagnosis(row: DiagnosisRow) -> Ended:
    results: Mapping[str, Any] = row.results or {}
    word, tone = look_up(DIAGNOSIS_STATES, row.state), _tone(row.state)
    if row.verdict:
        word, tone = diagnosis_verdict(row.verdict, results), DIAGNOSIS_TONES.get(row.verdict, "")
    known = library()
    named = [known[claim["effect"]].what for claim in results.get("claims", ()) if claim["effect"] in known]
    outcome = ", ".join(named) or word.meaning
    address, name, about = f"/diagnoses/{row.id}", f"Diagnosis {row.id}", f"data set {row.data_set_id}"
    return Ended(address, name, about, word, tone, outcome, *_times(row.started_at, row.ended_at))


def _tone(state: DesignState) -> str:
    return {DesignState.COMPLETE: "good", DesignState.FAILED: "bad"}.get(state, "doubt")


def _times(began: float | None, ended: float | None) -> tuple[float, float | None]:
    """When it ended, and after how many seconds; None: it never began."""
    assert ended is not None
    return ended, None if began is None else ended - began


LINES: Mapping[type, Callable[[Any], Ended]] = {
    StudyRow: _study,
    ChargeRow: _charge,
    DiagnosisRow: _diagnosis,
}
