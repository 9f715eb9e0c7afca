"""The angle gauge: target, window and the result's interval on one number line, as per cents of its width."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

# Free space at both ends, as a share of what is shown.
MARGIN = 0.12


@dataclass(frozen=True)
class Mark:
    """A value, and where it stands on the line (0 to 100)."""

    value: float
    at: float


@dataclass(frozen=True)
class Gauge:
    """`interval` and `middle` None: there is no result yet. `runs`: single simulations of the result."""

    lower: Mark
    upper: Mark
    target: Mark
    middle: Mark | None
    interval: tuple[Mark, Mark] | None
    runs: tuple[Mark, ...]


def draw_gauge(
    window_deg: tuple[float, float],
    target_deg: float,
    middle_deg: float | None = None,
    half_width_deg: float | None = None,
    runs_deg: Sequence[float] = (),
) -> Gauge:
    """The line reaches as far as the window, the result and its simulations do."""
    half = half_width_deg or 0.0
    shown = [*window_deg, target_deg, *runs_deg]
    if middle_deg is not None:
        shown += [middle_deg - half, middle_deg + half]
    first, last = min(shown), max(shown)
    space = MARGIN * (last - first)
    first, last = first - space, last + space

    def mark(value: float) -> Mark:
        return Mark(value, round(100.0 * (value - first) / (last - first), 3))

    ends = None
    if middle_deg is not None and half_width_deg is not None:
        ends = (mark(middle_deg - half), mark(middle_deg + half))
    return Gauge(
        lower=mark(window_deg[0]),
        upper=mark(window_deg[1]),
        target=mark(target_deg),
        middle=None if middle_deg is None else mark(middle_deg),
        interval=ends,
        runs=tuple(mark(value) for value in runs_deg),
    )
