"""The library of effects that a diagnosis looks for: read-only, and the same for every data set."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from fastapi import APIRouter, Path
from pydantic import BaseModel, Field

from service.api.problems import problem_responses
from service.domain.effects import Clause, Effect, library
from service.domain.measured_pile import SIMULATED
from service.errors import NotFound

router = APIRouter(prefix="/v1", tags=["diagnoses"])

Made = Literal["simulation", "reading", "charge"]


class CheckAnswer(BaseModel):
    """The reference measurement that would settle an effect."""

    what: str
    cost: float = Field(description="in units of one pile test")


class EffectAnswer(BaseModel):
    """One candidate cause, with the one number that says how large it is."""

    id: str
    what: str
    law: str = Field(description="with its source")
    amplitude: str = Field(description="what the number means; 0 is the model without the effect, to the bit")
    unit: str
    lowest: float
    highest: float
    prior_scale: float = Field(description="of the half-normal prior of the amplitude")
    scope: list[dict[str, Any]] = Field(
        description="it acts on a condition where all of one of these hold; an object with `above` is a bound"
    )
    effect_class: str = Field(description="effects of one class are one statement about the plant")
    directions_deg: list[float] = Field(description="azimuths along which it is simulated; empty: none")
    made_by: Made = Field(
        description="simulation: a pile test is simulated with it; reading: a fault of the measurement, which"
        " needs no run; charge: charges alone are simulated with it, which no diagnosis asks for yet, so it is"
        " never named"
    )
    check: CheckAnswer

    @classmethod
    def of(cls, effect: Effect) -> Self:
        return cls(
            id=effect.id,
            what=effect.what,
            law=effect.law,
            amplitude=effect.amplitude,
            unit=effect.unit,
            lowest=effect.lowest,
            highest=effect.highest,
            prior_scale=effect.scale,
            scope=[_scope(clause) for clause in effect.scope],
            effect_class=effect.effect_class,
            directions_deg=list(effect.directions_deg),
            made_by=_made_by(effect),
            check=CheckAnswer(what=effect.check.what, cost=effect.check.cost),
        )


class SelfTestAnswer(BaseModel):
    """A change of the simulation's own settings that should change nothing: it is run with every diagnosis."""

    id: str
    what: str
    amplitude: float


class EffectList(BaseModel):
    """The whole library in its order."""

    version: int
    items: list[EffectAnswer]
    self_tests: list[SelfTestAnswer]


@router.get("/effects", operation_id="listEffects", responses=problem_responses())
def list_effects() -> EffectList:
    """The causes that a diagnosis can name, and the self-tests of the simulation."""
    known = library()
    return EffectList(
        version=known.version,
        items=[EffectAnswer.of(effect) for effect in known.effects],
        self_tests=[
            SelfTestAnswer(id=test.id, what=test.what, amplitude=test.amplitude) for test in known.self_tests
        ],
    )


@router.get("/effects/{effect_id}", operation_id="getEffect", responses=problem_responses(404, 422))
def get_effect(effect_id: Annotated[str, Path(max_length=64)]) -> EffectAnswer:
    """One of them."""
    known = library()
    if effect_id not in known:
        names = ", ".join(effect.id for effect in known.effects)
        raise NotFound(f"There is no effect {effect_id!r}; there are {names}.")
    return EffectAnswer.of(known[effect_id])


def _scope(clause: Clause) -> dict[str, Any]:
    return {**dict(clause.equal), **{name: {"above": value} for name, value in clause.above}}


def _made_by(effect: Effect) -> Made:
    if effect.is_reading:
        return "reading"
    return "simulation" if effect.id in SIMULATED["pile"] else "charge"
