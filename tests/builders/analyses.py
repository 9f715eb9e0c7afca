"""Studies with designs all over the box and a report as a worker writes it, in closed form: nothing is fitted."""

from __future__ import annotations

import itertools
import random
from collections.abc import Callable, Sequence
from typing import Any

from sqlalchemy import select

from service.db.models import DesignRow, ReportRow
from service.db.session import Database
from service.domain.outcome import judge
from service.domain.states import DesignState, Verdict
from service.domain.study import StudySpec
from tests.builders.studies import a_spec, a_study, synthetic_angle

EVERY_FAILS = 13
LEVELS = 21
SD_DEG = 0.4
OPTIMUM = (0.5, 0.5, 0.35, 0.3)
DRAWS = 120


def a_scattered_study(database: Database, count: int = 40, with_report: bool = True) -> int:
    """`count` designs at random places, each 13th an error; angles by calibration.md's synthetic one."""
    spec = a_spec(budget=max(count, 12))
    study_id = a_study(database, budget=spec.budget)
    rng = random.Random(7)
    ends = [(v.lower, v.upper) for v in spec.space.variables]
    with database.writing() as session:
        for number in range(1, count + 1):
            x = tuple(round(rng.uniform(*end), 2) for end in ends)
            session.add(_design(study_id, number, spec, x))
        session.flush()
    if with_report:
        with database.writing() as session:
            session.add(
                ReportRow(study_id=study_id, designs=count, code_version="0" * 16, content=a_report(spec))
            )
    return study_id


def _design(study_id: int, number: int, spec: StudySpec, x: tuple[float, ...]) -> DesignRow:
    fails = number % EVERY_FAILS == 0
    angle = round(synthetic_angle(spec, x, number), 3)
    measured = None if fails else {"angle_deg": angle, "mass_on_base_kg": round(10 + angle / 2, 3)}
    return DesignRow(
        study_id=study_id,
        number=number,
        x=spec.space.as_dict(x),
        x_hash=f"{number:064x}",
        scale=2.0,
        seed=number,
        origin="doe" if number <= 6 else "model",
        reason="spread over the box",
        state=DesignState.FAILED if fails else DesignState.COMPLETE,
        verdict=Verdict.ERROR if measured is None else judge(spec.responses, measured),
        angle_deg=None if fails else angle,
        angle_sd_deg=None if fails else 0.2,
        responses=measured,
        failure_class="blow_up" if fails else None,
        ended_at=1.0,
    )


def numbers_inside(
    database: Database, study_id: int, inside: Callable[[dict[str, Any]], bool]
) -> Sequence[int]:
    """Numbers of the designs whose parameters and responses fulfil `inside`."""
    with database.reading() as session:
        rows = session.scalars(select(DesignRow).where(DesignRow.study_id == study_id))
        return [row.number for row in rows if inside({**row.x, **(row.responses or {})})]


def a_report(spec: StudySpec) -> dict[str, Any]:
    """The keys of worker.optimizer.report, as far as pages read them."""
    space, names = spec.space, list(spec.space.names)
    axes = [
        [v.lower + k * (v.upper - v.lower) / (LEVELS - 1) for k in range(LEVELS)] for v in space.variables
    ]

    def cut(chosen: Sequence[int]) -> dict[str, Any]:
        def at(values: Sequence[float]) -> float:
            x = list(OPTIMUM)
            for j, value in zip(chosen, values, strict=True):
                x[j] = value
            return synthetic_angle(spec, tuple(x), 1)

        if len(chosen) == 1:
            means: Any = [at((value,)) for value in axes[chosen[0]]]
            sds: Any = [SD_DEG] * LEVELS
        else:
            means = [[at((a, b)) for b in axes[chosen[1]]] for a in axes[chosen[0]]]
            sds = [[SD_DEG * (1 + abs(i - j) / LEVELS) for j in range(LEVELS)] for i in range(LEVELS)]
        return {
            "names": [names[j] for j in chosen],
            "axes": [axes[j] for j in chosen],
            "means": means,
            "sds": sds,
        }

    along = [cut((j,)) for j in range(len(names))]
    rng = random.Random(3)
    draws = [
        [
            min(v.upper, max(v.lower, rng.gauss(m, 0.2 * (v.upper - v.lower))))
            for v, m in zip(space.variables, OPTIMUM, strict=True)
        ]
        for _ in range(DRAWS)
    ]
    parameters = [
        {
            "name": v.name,
            "mean": m,
            "sd": 0.1,
            "lower_90": v.lower,
            "upper_90": v.upper,
            "sd_ratio": ratio,
            "label": label,
        }
        for v, m, (ratio, label) in zip(
            space.variables,
            OPTIMUM,
            [(0.3, "identified"), (0.98, "not identified"), (0.9, "not identified"), (0.5, "weak")],
            strict=True,
        )
    ]
    return {
        "version": 2,
        "enough": True,
        "posterior": {
            "parameters": parameters,
            "correlations": [
                [1.0 if i == j else -0.25 for j in range(len(names))] for i in range(len(names))
            ],
            "text": ["Identified only as a combination: friction + rolling."],
            "draws": {
                "names": names,
                "x": draws,
                "means": [synthetic_angle(spec, tuple(x), 1) for x in draws],
            },
        },
        "which_test_next": [],
        "optimum": {"x": space.as_dict(OPTIMUM)},
        "sensitivity": {
            "angle_deg": [
                {
                    "name": name,
                    "values": row["axes"][0],
                    "means": row["means"],
                    "sds": row["sds"],
                    "total_share": share,
                    "total_share_error": 0.02,
                    "total_share_emulator_error": 0.04,
                }
                for name, row, share in zip(names, along, (0.45, 0.1, 0.05, 0.4), strict=True)
            ]
        },
        "slices": {
            "along": along,
            "over": cut((0, 3)),
            "pairs": [cut(pair) for pair in itertools.combinations((0, 3, 1, 2), 2)],
        },
    }
