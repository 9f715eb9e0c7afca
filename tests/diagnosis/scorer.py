"""Scores answers against what was hidden: the marks of the design, with binomial intervals, and the utility.

An answer is the published JSON of a diagnosis. Right: every claim is a hidden effect (base and liner friction are
one statement). Imports nothing of the analyser.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import beta

from tests.diagnosis.hider import Case

Answer = Mapping[str, Any]
Pair = tuple[Case, Answer]
_WALL = {"base_rough": "wall", "liner_wear": "wall"}
MOST_USEFUL = 3


@dataclass(frozen=True)
class Mark:
    """One line of the table: `value` with its 90 % interval, and the mark, at most or at least."""

    measure: str
    kind: str
    snr: float | None
    count: int
    value: float
    low: float
    high: float
    mark: float | None
    at_most: bool

    @property
    def met(self) -> bool | None:
        if self.mark is None or not self.count:
            return None
        return self.value <= self.mark if self.at_most else self.value >= self.mark

    def as_dict(self) -> dict[str, Any]:
        named = ("measure", "kind", "snr", "count", "value", "low", "high", "mark")
        return {**{name: getattr(self, name) for name in named}, "met": self.met}


def statement(effect: str) -> str:
    """Effects that are one statement about the plant."""
    return _WALL.get(effect, effect)


def claims(answer: Answer) -> list[str]:
    return [statement(claim["effect"]) for claim in answer["claims"]]


def truth(case: Case) -> set[str]:
    return {statement(effect) for effect in case.hidden}


def wrong(case: Case, answer: Answer) -> bool:
    """A claim that is none of the hidden effects."""
    return any(name not in truth(case) for name in claims(answer))


def right(case: Case, answer: Answer) -> bool:
    """All hidden effects claimed, and nothing else."""
    return bool(case.hidden) and set(claims(answer)) == truth(case)


def ambiguous_set(answer: Answer) -> list[str]:
    return list(dict.fromkeys(statement(p["effect"]) for p in answer["also_possible"]))


def flagged(answer: Answer) -> bool:
    return answer["verdict"] not in ("no_misfit", "refused")


def located(case: Case, answer: Answer) -> bool:
    """The likeliest block, of what is unexplained or remains, is one of the cause's places."""
    found = answer["unexplained"] or (answer["remainder"] or {}).get("where") or []
    return bool(found) and found[0]["block"] in case.places


def is_outside(case: Case) -> bool:
    return case.kind in ("outside", "left_out")


def worth(case: Case, answer: Answer) -> float:
    """Utility of one answer; a pair of which one is named and nothing wrong is half right."""
    named = claims(answer)
    if named and case.kind in ("null", "decoy"):
        return -3.0
    if named and wrong(case, answer):
        return -2.0
    if named:
        return 1.0 if right(case, answer) else 0.5
    if answer["verdict"] == "ambiguous" and truth(case):
        held = ambiguous_set(answer)
        return 0.4 if truth(case) & set(held) and len(held) <= MOST_USEFUL else 0.0
    return 0.4 if answer["verdict"] == "unexplained" and is_outside(case) else 0.0


def score(pairs: Sequence[Pair]) -> dict[str, Any]:
    """`utility` and `marks`."""
    utility = float(np.mean([worth(case, answer) for case, answer in pairs])) if pairs else 0.0
    return {"utility": utility, "marks": [mark.as_dict() for mark in marks(pairs)]}


Test = Callable[[Case, Answer], bool]


def _share(
    measure: str,
    kind: str,
    chosen: Sequence[Pair],
    test: Test,
    mark: float | None,
    at_most: bool,
    snr: float | None = None,
) -> Mark:
    hits, n = sum(test(case, answer) for case, answer in chosen), len(chosen)
    low = float(beta.ppf(0.05, hits, n - hits + 1)) if hits else 0.0
    high = float(beta.ppf(0.95, hits + 1, n - hits)) if hits < n else 1.0
    return Mark(measure, kind, snr, n, hits / n if n else 0.0, low, high, mark, at_most)


def _mean(measure: str, kind: str, values: Sequence[float], mark: float, at_most: bool) -> Mark:
    n = len(values)
    middle = float(np.mean(values)) if n else 0.0
    half = 1.645 * float(np.std(values, ddof=1)) / np.sqrt(n) if n > 1 else 0.0
    return Mark(measure, kind, None, n, middle, middle - half, middle + half, mark, at_most)


def marks(pairs: Sequence[Pair]) -> list[Mark]:
    """The table of the design."""

    def of(*kinds: str) -> list[Pair]:
        return [p for p in pairs if p[0].kind in kinds]

    inside = [p for p in of("single") if p[0].snr >= 5.0] + of("pair")
    lacking = of("left_out", "outside")
    found = [
        _share("flagged", "null", of("null"), lambda c, a: flagged(a), 0.05, True),
        _share("named", "null", of("null"), lambda c, a: bool(claims(a)), 0.01, True),
        _share("claimed", "decoy", of("decoy"), lambda c, a: bool(claims(a)), 0.02, True),
    ]
    for snr, mark in ((3.0, None), (5.0, 0.40), (8.0, 0.85), (12.0, 0.93)):
        chosen = [p for p in of("single") if p[0].snr == snr and p[0].identifiable]
        found.append(_share("named right", "single identifiable", chosen, right, mark, False, snr))
    found += [
        _share("wrong name", "cause in the library", inside, wrong, 0.03, True),
        _share(
            "wrong name", "outside, no mimic", [p for p in lacking if not p[0].mimicked], wrong, 0.03, True
        ),
        _share("wrong name", "outside, mimicked", [p for p in lacking if p[0].mimicked], wrong, None, True),
    ]
    unsure = [p for p in of("single", "pair") if p[1]["verdict"] == "ambiguous"]
    found += [
        _share(
            "set holds the truth",
            "ambiguous",
            unsure,
            lambda c, a: bool(truth(c) & set(ambiguous_set(a))),
            0.95,
            False,
        ),
        _mean("size of the set", "ambiguous", [float(len(ambiguous_set(a))) for _, a in unsure], 3.0, True),
        _share("both named", "pair", of("pair"), right, 0.60, False, 8.0),
        _share("any wrong name", "pair", of("pair"), wrong, 0.10, True, 8.0),
    ]
    strange = [p for p in of("outside", "left_out") if not p[0].mimicked]
    said = ("unexplained", "named_with_remainder")
    found.append(
        _share("unexplained or remainder", "outside", strange, lambda c, a: a["verdict"] in said, 0.90, False)
    )
    placed = [p for p in strange if p[0].places and p[1]["verdict"] in said]
    found.append(_share("right place", "outside", placed, located, 0.80, False))
    return [*found, *_calibration(pairs), *_gains(pairs)]


def _calibration(pairs: Sequence[Pair]) -> list[Mark]:
    """Stated inclusion against how often it was right, of single effects, pairs, nulls and decoys."""
    stated = [
        (float(value), statement(effect) in truth(case))
        for case, answer in pairs
        if not is_outside(case)
        for effect, value in _inclusions(answer).items()
    ]
    high = [hit for value, hit in stated if value >= 0.95]
    hits = sum(high)
    low = float(beta.ppf(0.05, hits, len(high) - hits + 1)) if hits else 0.0
    top = float(beta.ppf(0.95, hits + 1, len(high) - hits)) if hits < len(high) else 1.0
    share = hits / len(high) if high else 0.0
    bins: dict[int, list[tuple[float, bool]]] = {}
    for value, hit in stated:
        bins.setdefault(min(int(10 * value), 9), []).append((value, hit))
    gaps = [len(b) * abs(np.mean([v for v, _ in b]) - np.mean([h for _, h in b])) for b in bins.values()]
    error = float(sum(gaps) / len(stated)) if stated else 0.0
    return [
        Mark("inclusion of .95 is right", "all inside", None, len(high), share, low, top, 0.93, False),
        Mark("expected calibration error", "all inside", None, len(stated), error, error, error, 0.05, True),
    ]


def _inclusions(answer: Answer) -> dict[str, float]:
    found = {p["effect"]: p["inclusion"] for p in answer["also_possible"]}
    return found | {claim["effect"]: claim["inclusion"] for claim in answer["claims"]}


def _gains(pairs: Sequence[Pair]) -> list[Mark]:
    opened = [
        p
        for p in pairs
        if p[0].kind == "single" and p[0].snr >= 8.0 and right(*p) and p[1]["gain"] is not None
    ]
    above = _share(
        "gain above 4 nats", "named right", opened, lambda c, a: a["gain"]["log_score"] > 4.0, 0.90, False
    )
    return [above]
