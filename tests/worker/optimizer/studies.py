"""Small studies and a rig for them, shared by the optimizer's tests."""

from __future__ import annotations

from collections.abc import Callable

from service.domain.search_space import SearchSpace, Variable
from service.domain.study import Response, StudySpec
from worker.optimizer.history import Design, History, Pending
from worker.optimizer.proposal import propose
from worker.optimizer.proposed import Proposal
from worker.optimizer.stopping import Stop

PP = "particle_particle_static_friction"
PW = "particle_wall_static_friction"
ROLL = "rolling_resistance"

Rig = Callable[[tuple[float, ...], int], float | None]


def space(dimension: int, step: float | None = 0.01) -> SearchSpace:
    """The unit box of up to three variables, so that physical and unit values agree."""
    return SearchSpace(tuple(Variable(name, 0.0, 1.0, step) for name in (PP, ROLL, PW)[:dimension]))


def at(angle_deg: float | None) -> dict[str, float] | None:
    """The results of a run that gave this angle."""
    return None if angle_deg is None else {"angle_deg": angle_deg}


def spec_of(box: SearchSpace, target: float = 30.0, half_window: float = 1.5, **changes: object) -> StudySpec:
    angle = Response("angle_deg", target, (target - half_window, target + half_window), 0.5)
    given: dict[str, object] = {"budget": 30, "parallel": 1, "seed": 1, **changes}
    return StudySpec("test", 1.0, box, (angle,), **given)  # type: ignore[arg-type]


def play(spec: StudySpec, rig: Rig) -> tuple[list[Proposal], History, Stop]:
    """Run a study with the caller's contract: results up to number - parallel, the others pending."""
    proposals: list[Proposal] = []
    designs: list[Design] = []
    while True:
        number = len(designs) + 1
        known = number - spec.parallel if number <= spec.budget else number
        history = History(
            tuple(d for d in designs if d.number <= known),
            tuple(Pending(d.number, d.x, d.seed, d.origin) for d in designs if d.number > known),
        )
        answer = propose(spec, history, number)
        if isinstance(answer, Stop):
            return proposals, History(tuple(designs)), answer
        proposals.append(answer)
        results = at(rig(answer.x, answer.seed))
        designs.append(Design(number, answer.x, answer.seed, results, answer.origin))
