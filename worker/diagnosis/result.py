"""What a diagnosis says: verdict, claims, what it cannot say. Nothing is claimed without a null calibration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from service.domain.errors import InvalidValue
from worker.diagnosis.null_calibration import NullCalibration

NO_MISFIT, NAMED, NAMED_WITH_REMAINDER = "no_misfit", "named", "named_with_remainder"
AMBIGUOUS, UNEXPLAINED, REFUSED = "ambiguous", "unexplained", "refused"
VERDICTS = (NO_MISFIT, NAMED, NAMED_WITH_REMAINDER, AMBIGUOUS, UNEXPLAINED, REFUSED)
LEVELS = ("named", "claim", "strong claim")
CLAIM_FROM = 0.95


@dataclass(frozen=True)
class Amplitude:
    """Equivalent to, within this model; `ci90` the central 90 % interval."""

    value: float
    unit: str
    ci90: tuple[float, float]


@dataclass(frozen=True)
class Claim:
    """One named effect. `level`: named; claim with a held-out gain above the null's 95 %; strong claim when the
    confirming experiment agreed too."""

    effect: str
    effect_class: str
    inclusion: float
    amplitude: Amplitude
    level: str = LEVELS[0]

    def __post_init__(self) -> None:
        if self.inclusion < CLAIM_FROM:
            raise InvalidValue(
                f"claim of {self.effect}", self.inclusion, f"an inclusion of {CLAIM_FROM} or more"
            )
        if self.level not in LEVELS:
            raise InvalidValue("claim.level", self.level, ", ".join(LEVELS))


@dataclass(frozen=True)
class Possible:
    """An effect that is not excluded, with its inclusion probability."""

    effect: str
    inclusion: float


@dataclass(frozen=True)
class Limit:
    """The smallest amplitude that would show at 4 sigma in these observations, in the effect's unit."""

    effect: str
    detectable_from: float
    unit: str


@dataclass(frozen=True)
class Where:
    """A block of the misfit (kind:name) with its probability within the unexplained family."""

    block: str
    probability: float


@dataclass(frozen=True)
class Gain:
    """On the held-out block: log scores (nats) by condition, RMSE in sd of the measured means before and after,
    share of cells in their 90 % bands, and the share of the improvement that replicates would allow."""

    log_score: float
    by_condition: Mapping[str, float]
    conditions_better: int
    rmse_before: float
    rmse_after: float
    coverage_90: float
    share_of_ceiling: float
    null_95: float


@dataclass(frozen=True)
class Proposal:
    """The next measurement: what, for which effects, expected information (nats) and cost (pile tests)."""

    what: str
    kind: str
    information: float
    cost: float


@dataclass(frozen=True)
class Remainder:
    """What is left after the named effects are taken out: p against the null runs, and where."""

    p_value: float
    where: tuple[Where, ...] = ()


@dataclass(frozen=True)
class Result:
    """The diagnosis of one data set. `calibration` is the null calibration of this design and library; a verdict
    other than a refusal without one is not allowed, nor one for another design.

    Raises InvalidValue for it, for an unknown verdict and for claims that the verdict does not make.
    """

    verdict: str
    model_version: str
    design: str
    calibration: NullCalibration | None
    claims: tuple[Claim, ...] = ()
    also_possible: tuple[Possible, ...] = ()
    not_testable: tuple[str, ...] = ()
    indistinguishable: tuple[tuple[str, ...], ...] = ()
    unexplained: tuple[Where, ...] = ()
    remainder: Remainder | None = None
    gain: Gain | None = None
    next_measurement: tuple[Proposal, ...] = ()
    limits: tuple[Limit, ...] = ()
    cost: Mapping[str, float] = field(default_factory=dict)
    p_value: float | None = None
    sentences: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.verdict not in VERDICTS:
            raise InvalidValue("verdict", self.verdict, ", ".join(VERDICTS))
        if self.verdict != REFUSED and self.calibration is None:
            raise InvalidValue("null calibration", None, "one for this design and library")
        if self.calibration is not None and self.calibration.key != self.design:
            raise InvalidValue("null calibration", "of another design or library", "one for this one")
        if bool(self.claims) != (self.verdict in (NAMED, NAMED_WITH_REMAINDER)):
            raise InvalidValue("claims", [c.effect for c in self.claims], f"what {self.verdict} allows")

    def as_dict(self) -> dict[str, Any]:
        """The published form."""
        return {
            "verdict": self.verdict,
            "claims": [_claim(claim) for claim in self.claims],
            "also_possible": [asdict(p) for p in self.also_possible],
            "not_testable": list(self.not_testable),
            "indistinguishable": [list(group) for group in self.indistinguishable],
            "unexplained": [asdict(w) for w in self.unexplained],
            "remainder": None if self.remainder is None else asdict(self.remainder),
            "gain": None if self.gain is None else asdict(self.gain),
            "next_measurement": [asdict(p) for p in self.next_measurement],
            "cost": dict(self.cost),
            "model_version": self.model_version,
        }


def _claim(claim: Claim) -> dict[str, Any]:
    return {
        "effect": claim.effect,
        "class": claim.effect_class,
        "inclusion": claim.inclusion,
        "amplitude": asdict(claim.amplitude),
        "level": claim.level,
    }
