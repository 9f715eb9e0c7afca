"""What the charts are drawn from, as JSON: rows in the charts' own words, nothing computed from physics."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

from service.dashboard import words
from service.db.models import DesignRow, StudyRow
from service.domain.spec_record import primary_response
from service.domain.states import Verdict

# Where the scan fits its line, as shares of the base's radius (demcore/observables/repose_angle.py).
FIT_FROM, FIT_TO = 0.15, 0.90


def angle_chart(study: StudyRow, designs: Sequence[DesignRow], chosen: Collection[int]) -> dict[str, Any]:
    """Angle against simulation number. `chosen`: the numbers whose parameters are best or recommended."""
    response = primary_response(study.spec)
    return {
        "target": response["target"],
        "window": response["window"],
        "budget": study.budget,
        "parameters": {name: words.parameter_name(name) for name in study.spec["variables"]},
        "recommended": study.recommendation is not None,
        "points": [_point(row, row.number in chosen) for row in designs if row.verdict is not None],
    }


def _point(row: DesignRow, is_chosen: bool) -> dict[str, Any]:
    prediction = row.prediction or {}
    failure = None
    if row.verdict is Verdict.ERROR:
        failure = words.FAILURES.get(row.failure_class or "", row.failure_class or "error")
    return {
        "number": row.number,
        "id": row.id,
        "verdict": row.verdict.value if row.verdict else None,
        "origin": row.origin,
        "origin_word": words.look_up(words.ORIGINS, row.origin).text,
        "angle": row.angle_deg,
        "error": row.angle_sd_deg,
        "predicted": prediction.get("mean_deg"),
        "predicted_sd": prediction.get("sd_deg"),
        "x": row.x,
        "failure": failure,
        "chosen": is_chosen,
    }


def profile_chart(design: DesignRow | None) -> dict[str, Any] | None:
    """h(r) with its band and the line that was fitted; None where there is no pile."""
    results = (design.results if design is not None else None) or {}
    profile, rig = results.get("profile"), results.get("rig")
    if design is None or not profile or not rig:
        return None
    return {
        "number": design.number,
        "base_radius": rig["base_diameter"] / 2.0,
        "fit_from": FIT_FROM,
        "fit_to": FIT_TO,
        "r": profile["r_m"],
        "h": profile["h_m"],
        "low": profile["h_low_m"],
        "high": profile["h_high_m"],
        "angle": results["angle_deg"],
        "intercept": results.get("fit_intercept_m"),
    }


def sector_chart(design: DesignRow, target_deg: float, window_deg: Sequence[float]) -> dict[str, Any] | None:
    """The angle of each sector of the base, with their mean and its standard error."""
    sectors = (design.results or {}).get("sector_angles_deg")
    if not sectors or design.angle_deg is None:
        return None
    return {
        "angles": sectors,
        "mean": design.angle_deg,
        "error": design.angle_sd_deg,
        "target": target_deg,
        "window": list(window_deg),
    }
