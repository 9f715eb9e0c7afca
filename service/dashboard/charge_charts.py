"""What the charts of a charge are drawn from, as JSON: by sector, over time, over the belt's height."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

ACCOUNT = ("fed", "on_belt", "in_flight", "in_hopper", "lost")


def charge_charts(results: Mapping[str, Any]) -> dict[str, Any]:
    """By the name of the chart; None where the results hold nothing for it."""
    return {
        "burden": _burden(results),
        "account": _account(results),
        "belt": _belt(results),
    }


def _burden(results: Mapping[str, Any]) -> dict[str, Any] | None:
    """Height above the bell's seat, m, and mean grain, mm, of each sector, with where the piles were found."""
    sectors = results.get("sectors")
    if not sectors:
        return None
    seat = float(results["inputs"]["plant"]["hopper"]["seat_depth"])
    return {
        "azimuth": sectors["azimuth_deg"],
        "height": [None if z is None else z + seat for z in sectors["height"]],
        "size": _in_mm(sectors["size"]),
        "mass": sectors["mass"],
        "piles": [pile["azimuth_deg"] for pile in results.get("piles", ())],
    }


def _account(results: Mapping[str, Any]) -> dict[str, Any] | None:
    """Where the mass is, kg, over time, s."""
    account = results.get("account")
    return {name: account[name] for name in ("time", *ACCOUNT)} if account else None


def _belt(results: Mapping[str, Any]) -> dict[str, Any] | None:
    """Of each layer on the belt: height of its middle, mm, share of the mass, mean grain, mm."""
    belt = results.get("belt") or {}
    if "layer_height_m" not in belt:
        return None
    return {
        "height": _in_mm(belt["layer_height_m"]),
        "share": belt["layer_share"],
        "size": _in_mm(belt["layer_size_m"]),
    }


def _in_mm(lengths: Sequence[float | None]) -> list[float | None]:
    return [None if length is None else 1e3 * length for length in lengths]
