"""The designs with which a study measures how it differs from a coarser or an earlier test (decision 7).

Two designs that the other test has run are run again here: the nearest to the target by that test's emulator,
and the next nearest that lies apart from it, so that neither rho nor c hangs on one place.
"""

from __future__ import annotations

import numpy as np

from service.domain.study import StudySpec
from worker.optimizer.design import X, initial_design, to_unit
from worker.optimizer.history import Design, History, grouped
from worker.optimizer.link import FEWEST_SOURCE
from worker.optimizer.outlook import Outlook, build_outlook

SHARED = 2
# Distance in the unit cube, per square root of its dimension, that the second shared design keeps.
APART = 0.15


def is_helped(spec: StudySpec, history: History) -> bool:
    """Whether another test stands in for the initial design: coarse runs that are made, or a stored study.

    Not any more once the study has enough designs of its own to tell that the other test misleads.
    """
    if _source(history) is None:
        return False
    own = history.groups()
    if sum(g.runs > 0 for g in own) <= SHARED:
        return True
    return build_outlook(spec, history).is_linked


def shared_designs(spec: StudySpec, history: History) -> list[X]:
    """Designs that the other test has run, the best to share first; the initial design where it has none."""
    source = _source(history)
    if source is None:
        return initial_design(spec.space, spec.seed, spec.initial_designs)
    alone = History(source)
    other = build_outlook(spec, alone)
    ran = [g for g in grouped(source) if g.runs and not g.failures and _is_inside(spec, g.x)]
    if not ran:
        return []
    return _apart(other, [g.x for g in ran])


def _source(history: History) -> tuple[Design, ...] | None:
    """The coarse runs, else the first stored study, with enough results."""
    tests = [history.coarse, *(w.finished for w in history.warm)]
    return next((t for t in tests if sum(g.runs > 0 for g in grouped(t)) >= FEWEST_SOURCE), None)


def _is_inside(spec: StudySpec, x: X) -> bool:
    """A stored study may have searched a wider box."""
    return all(v.lower <= a <= v.upper for v, a in zip(spec.space.variables, x, strict=True))


def _apart(other: Outlook, xs: list[X]) -> list[X]:
    """By expected miss; each next one at a distance from those before, the rest behind."""
    belief = other.believe(xs)
    order = np.argsort(other.miss(belief) / np.maximum(belief.ok, 1e-3), kind="stable")
    u = to_unit(other.spec.space, xs)
    least = APART * np.sqrt(u.shape[1])
    chosen: list[int] = []
    for i in order.tolist():
        if all(np.linalg.norm(u[i] - u[k]) >= least for k in chosen):
            chosen.append(i)
    rest = [i for i in order.tolist() if i not in chosen]
    return [xs[i] for i in (*chosen, *rest)]
