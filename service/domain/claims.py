"""What became of the claims of a diagnosis: proposed, then confirmed or withdrawn by the one who made the check.

Checks are appended, never changed: a claim that was withdrawn stays visible, with all that was said of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, Self

from service.domain.errors import InvalidValue

# Levels as worker/diagnosis/result.py calls them: named; with a gain on held-out data; and confirmed by a check.
CLAIM, STRONG_CLAIM = "claim", "strong claim"
PROPOSED = "proposed"
LONGEST_NOTE = 1000


class CheckOutcome(Enum):
    """What a check makes of a claim."""

    CONFIRMED = "confirmed"
    WITHDRAWN = "withdrawn"


@dataclass(frozen=True)
class ClaimCheck:
    """One check: its outcome, what was seen, and when (seconds since 1970; None before it is stored)."""

    outcome: CheckOutcome
    note: str = ""
    at: float | None = None

    @classmethod
    def asked(cls, state: str, note: str) -> Self:
        """What a request says. Raises InvalidValue."""
        known = [outcome.value for outcome in CheckOutcome]
        if state not in known:
            raise InvalidValue("state", state, " or ".join(known))
        if len(note) > LONGEST_NOTE:
            raise InvalidValue("note", note, f"at most {LONGEST_NOTE} characters")
        return cls(CheckOutcome(state), note)


@dataclass(frozen=True)
class JudgedClaim:
    """A claim of an effect with its checks, the oldest first; the last one counts."""

    effect: str
    named_level: str
    checks: tuple[ClaimCheck, ...] = ()

    @property
    def state(self) -> str:
        return self.checks[-1].outcome.value if self.checks else PROPOSED

    @property
    def is_withdrawn(self) -> bool:
        return self.state == CheckOutcome.WITHDRAWN.value

    @property
    def level(self) -> str:
        """A claim whose check agreed is a strong one; of what is only named a check makes no more."""
        is_confirmed = self.state == CheckOutcome.CONFIRMED.value
        return STRONG_CLAIM if is_confirmed and self.named_level == CLAIM else self.named_level


def judged(
    results: Mapping[str, Any] | None, checks: Mapping[str, Sequence[ClaimCheck]]
) -> list[JudgedClaim]:
    """The claims of stored results, with their checks by effect."""
    return [
        JudgedClaim(claim["effect"], claim["level"], tuple(checks.get(claim["effect"], ())))
        for claim in (results or {}).get("claims", ())
    ]


def with_levels(results: Mapping[str, Any] | None, claims: Sequence[JudgedClaim]) -> dict[str, Any] | None:
    """Stored results with the levels that the checks made of their claims; the rows stay as they were written."""
    if results is None or not claims:
        return None if results is None else dict(results)
    levels = {claim.effect: claim.level for claim in claims}
    return {
        **results,
        "claims": [{**claim, "level": levels[claim["effect"]]} for claim in results["claims"]],
    }
