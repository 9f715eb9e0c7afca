"""What planned tests could show, before they are bought: a job that simulates them with each cause of the library.

Like a diagnosis it stores every simulated pile by its content, goes on after a stop, and uses the floor between
model and reality that a diagnosis of the same piles would use.
"""

from __future__ import annotations

from typing import Any

from service.db.session import Database
from service.domain.data_set.records import Condition
from service.domain.diagnosis import PLAN, DiagnosisOutcome, PlanSpec, expected_cost
from service.studies.claim_job import DiagnosisClaim
from worker import diagnose
from worker.diagnosis.diagnose import Options
from worker.diagnosis.identifiability import Identifiability, Outlook, Plan, identifiability
from worker.diagnosis.summaries import of_observables


def evaluate_plan(claim: DiagnosisClaim, report: diagnose.Report, database: Database) -> DiagnosisOutcome:
    """Judge the claimed plan.

    Raises Cancelled after a False of `report`, InvalidValue where the tests give none of the observables.
    """
    spec, conditions = claim.spec, claim.data.conditions
    assert spec.plan is not None, "a claim of a plan has one"
    runner = diagnose.StoredRuns(database, report, expected_cost(spec, conditions).runs)
    simulator, floor, sentences = diagnose.model_of(spec, runner, conditions)
    options = Options(floor=floor, first_wave=spec.first_wave, seed=spec.seed)
    found = identifiability(simulator, _plan(spec.plan, conditions), options)
    results = {
        "verdict": PLAN,
        "effects": [as_outlook(outlook) for outlook in found.effects],
        "adds": [{"condition": name, "nameable": list(effects)} for name, effects in found.adds.items()],
        "sentences": [*sentences, *_told(found, spec.plan)],
        "cost": {"runs": runner.asked, "simulated": runner.made},
        "model_version": simulator.version,
    }
    return DiagnosisOutcome(PLAN, results)


def _plan(spec: PlanSpec, conditions: tuple[Condition, ...]) -> Plan:
    return Plan(
        conditions=tuple(c for c in conditions if c.condition not in spec.candidates),
        replicates=spec.replicates,
        summaries=of_observables(spec.observables) if spec.observables else None,
        candidates=tuple(c for c in conditions if c.condition in spec.candidates),
    )


def as_outlook(outlook: Outlook) -> dict[str, Any]:
    """Plain JSON types only; an amplitude is null where it lies outside what is physical."""
    return {
        "effect": outlook.effect,
        "verdict": outlook.verdict,
        "unit": outlook.unit,
        "detectable_from": outlook.detectable_from,
        "nameable_from": outlook.nameable_from,
        "alike": list(outlook.alike),
    }


def _told(found: Identifiability, plan: PlanSpec) -> list[str]:
    """What an engineer asks first, in words."""
    count = len(found.effects)
    nameable = [o.effect for o in found.effects if o.verdict == "nameable"]
    silent = sum(o.verdict == "silent" for o in found.effects)
    told = [
        f"With {plan.replicates} replicates of each test {len(nameable)} of {count} causes could be named, each "
        f"from some amplitude on, and {silent} would stay silent. The noise is the simulation's own scatter: a "
        "plant that scatters more shows less."
    ]
    if plan.candidates:
        best, gained = next(iter(found.adds.items()))
        told.append(
            f"Of the candidates {best} adds most: it makes {', '.join(gained)} nameable."
            if gained
            else "None of the candidates makes another cause nameable."
        )
    return told
