"""The verdict from a ranking and its null calibration (rules 6 to 8).

p > .05 of min-p, or "no effect" the likeliest     no_misfit
inclusion >= .95 at every prior scale, p of the
library's evidence at most .02                     named; with what is left beyond the null's 99 %: with_remainder
the library likelier than the unexplained family,
and few effects hold .95 of it                     ambiguous
else                                               unexplained, with the blocks where
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from service.domain.effects import Library
from worker.diagnosis.limits import ALIKE_FROM
from worker.diagnosis.ranking import Ranking
from worker.diagnosis.result import CLAIM_FROM, Possible, Where
from worker.diagnosis.simulator import FloatArray

FLAGGED_AT = 0.05
NAMED_AT = 0.02
TAU_FACTORS = (0.5, 1.0, 2.0)
MOST_AMBIGUOUS = 5
_POSSIBLE_FROM = 0.02
_WHERE_FROM = 0.1


@dataclass(frozen=True)
class Named:
    """Which effects (indices) are named, with the inclusion of their class, and which others hold the rest."""

    effects: tuple[int, ...]
    inclusion: tuple[float, ...]
    possible: tuple[Possible, ...]
    doubles: tuple[int, ...] = ()


def named(rankings: tuple[Ranking, ...]) -> Named:
    """By the inclusion of its class at every scale of the prior; the middle ranking is the one reported.

    Effects of one class are one statement (rule 10): its likeliest effect speaks for it.
    """
    tables = [ranking.class_inclusion for ranking in rankings]
    middle = rankings[len(rankings) // 2]
    said = [name for name in tables[0] if min(table[name] for table in tables) >= CLAIM_FROM]
    classes = [effect.effect_class for effect in middle.known.effects]
    chosen = tuple(
        max((k for k, c in enumerate(classes) if c == name), key=lambda k: float(middle.inclusion[k]))
        for name in said
    )
    held = tuple(middle.class_inclusion[name] for name in said)
    rest = [
        Possible(middle.known.effects[k].id, float(middle.inclusion[k]))
        for k in np.argsort(-middle.inclusion)
        if k not in chosen and middle.inclusion[k] >= _POSSIBLE_FROM
    ]
    return Named(chosen, held, tuple(rest))


def distinct(found: Named, cosines: FloatArray, known: Library) -> Named:
    """Without the effects that look like one of another class in these observations (`cosines`, (E, E)).

    What was called indistinguishable before the data cannot be told apart by them: however likely, such an effect
    is possible and not named, and so are its `doubles`.
    """
    classes = np.array([effect.effect_class for effect in known.effects])
    alike = (cosines >= ALIKE_FROM) & (classes[:, None] != classes[None, :])
    clear = [bool(not alike[k].any()) for k in found.effects]
    unclear = [k for k, is_clear in zip(found.effects, clear, strict=True) if not is_clear]
    doubles = tuple(int(j) for k in unclear for j in np.flatnonzero(alike[k]))
    told = zip(found.effects, found.inclusion, strict=True)
    possible = [Possible(known.effects[k].id, p) for k, p in told if k in unclear]
    return Named(
        tuple(itertools.compress(found.effects, clear)),
        tuple(itertools.compress(found.inclusion, clear)),
        (*possible, *found.possible),
        doubles,
    )


def ambiguous_set(rankings: tuple[Ranking, ...]) -> tuple[int, ...]:
    """Effects, the most telling first, until .95 of the library's probability is in models with one of them, at
    every scale of the prior; a pair counts as soon as one of its two is in the set."""
    tables = [ranking.model_shares for ranking in rankings]
    averaged = (np.mean([t[0] for t in tables], axis=0), np.mean([t[1] for t in tables], axis=0))
    sets = [_holding(singles, pairs) for singles, pairs in (averaged, *tables)]
    return tuple(dict.fromkeys(itertools.chain(*sets)))


def _holding(singles: FloatArray, pairs: FloatArray) -> list[int]:
    """Greedy, by shares of single effects (E,) and of pairs (E, E; upper triangle)."""
    both = pairs + pairs.T
    chosen: list[int] = []
    held, left = 0.0, list(range(len(singles)))
    while held < CLAIM_FROM and left:
        outside = np.array([k not in chosen for k in range(len(singles))], dtype=float)
        gained = [singles[k] + float(both[k] @ outside) for k in left]
        best = left.pop(int(np.argmax(gained)))
        held += max(gained)
        chosen.append(best)
    return chosen


def where(ranking: Ranking) -> tuple[Where, ...]:
    """The blocks that hold at least a tenth of the unexplained family's probability, the likeliest first."""
    share = ranking.block_probabilities
    order = np.argsort(-share)
    kept = [k for k in order if share[k] >= _WHERE_FROM] or [order[0]]
    return tuple(Where(ranking.blocks[k].label, float(share[k])) for k in kept)
