"""Two things of a kind beside each other: each number with its uncertainty, their difference beside the noise.

Notation: a, b the two values; s_a, s_b their standard deviations; d = b - a; the noise of d is
sqrt(s_a^2 + s_b^2) (the two are independent). A difference stands out beyond BEYOND times its noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from demcore.experiments.charge_comparison import BEYOND
from service.dashboard import formats
from service.dashboard.words import Word

Tell = Callable[[float], str]

WITHIN = Word("within the noise", f"the difference is at most {BEYOND:g} times its noise")
STANDS_OUT = Word("stands out", f"the difference is more than {BEYOND:g} times its noise")
UNKNOWN = Word("noise not known", "at least one of the two has no measured scatter")
NO_DIFFERENCE = Word("not compared", "see above why")
SET = Word("set", "chosen, not measured: it has no noise")
ONE_SIDED = Word("one has none", "only one of the two has this number")


@dataclass(frozen=True)
class Value:
    """A number with its standard deviation; None where it is not known."""

    value: float | None
    sd: float | None = None


@dataclass(frozen=True)
class ComparedRow:
    """A number of both, as it is told."""

    label: str
    meaning: str
    first: str
    second: str
    difference: str
    noise: str
    word: Word
    tone: str


@dataclass(frozen=True)
class Side:
    """One of the two. `facts`: what it is, as pairs; `picture`: the id of a stored one; `scene`: the address of
    what the 3D viewer draws; `outline`: a pile's radii and heights, m."""

    name: str
    address: str
    facts: Sequence[tuple[str, str]] = ()
    picture: int | None = None
    picture_told: str = ""
    scene: str | None = None
    outline: tuple[Sequence[float], Sequence[float]] | None = None


@dataclass(frozen=True)
class Comparison:
    """`refused`: why nothing of the two is told as a difference; their numbers stand beside each other all the
    same. `notes`: what to know before one reads the differences."""

    first: Side
    second: Side
    rows: Sequence[ComparedRow]
    refused: str | None = None
    notes: Sequence[str] = ()


class Table:
    """Collects rows; `is_compared` False leaves the differences out."""

    def __init__(self, is_compared: bool) -> None:
        self._is_compared = is_compared
        self.rows: list[ComparedRow] = []

    def add(self, label: str, meaning: str, both: Sequence[Value], tell: Tell, is_set: bool = False) -> None:
        """A row, unless neither has the number. `is_set`: somebody chose it, so that it has no noise."""
        a, b = both
        if a.value is None and b.value is None:
            return
        difference, noise = _difference(a, b)
        if difference is None:
            word = ONE_SIDED
        elif not self._is_compared:
            difference, noise, word = None, None, NO_DIFFERENCE
        elif is_set:
            word = SET
        elif noise is None:
            word = UNKNOWN
        else:
            word = STANDS_OUT if abs(difference) > BEYOND * noise else WITHIN
        tone = {STANDS_OUT: "doubt", WITHIN: "good"}.get(word, "quiet")
        told_noise = formats.NOTHING if noise is None else tell(noise)
        self.rows.append(
            ComparedRow(
                label,
                meaning,
                _told(a, tell),
                _told(b, tell),
                _signed(difference, tell),
                told_noise,
                word,
                tone,
            )
        )


def _difference(a: Value, b: Value) -> tuple[float | None, float | None]:
    if a.value is None or b.value is None:
        return None, None
    if a.sd is None or b.sd is None:
        return b.value - a.value, None
    return b.value - a.value, math.hypot(a.sd, b.sd)


def _told(one: Value, tell: Tell) -> str:
    if one.value is None:
        return formats.NOTHING
    sd = "" if one.sd is None else f"{formats.FIXED}±{formats.FIXED}{tell(one.sd)}"
    return tell(one.value) + sd


def _signed(value: float | None, tell: Tell) -> str:
    if value is None:
        return formats.NOTHING
    sign = "+" if value > 0 else "−" if value < 0 else ""
    return sign + tell(abs(value))


# The drawing of two outlines, in its own units.
WIDTH, HEIGHT, LEFT, TOP, BOTTOM = 640.0, 240.0, 46.0, 22.0, 36.0
MARGIN = 12.0


@dataclass(frozen=True)
class Outlines:
    """Two piles' mean heights as paths, and ticks: a place and its number; both axes in m, on one scale;
    `marks`: of each pile, places with what a reader is told there."""

    paths: tuple[str, str]
    x_ticks: Sequence[tuple[float, str]]
    y_ticks: Sequence[tuple[float, str]]
    width: float
    height: float = HEIGHT
    left: float = LEFT
    top: float = TOP
    bottom: float = HEIGHT - BOTTOM
    marks: Sequence[Sequence[tuple[float, float, str]]] = ()


def draw_outlines(first: Side, second: Side) -> Outlines | None:
    """None unless both are piles with a profile."""
    if first.outline is None or second.outline is None:
        return None
    widest = max(*first.outline[0], *second.outline[0])
    highest = max(*first.outline[1], *second.outline[1], 0.25 * widest)
    scale = min((WIDTH - LEFT - MARGIN) / widest, (HEIGHT - TOP - BOTTOM) / highest)

    def place(r: float, h: float) -> str:
        return f"{LEFT + scale * r:.1f} {HEIGHT - BOTTOM - scale * h:.1f}"

    def path(outline: tuple[Sequence[float], Sequence[float]]) -> str:
        return "M" + "L".join(place(r, h) for r, h in zip(*outline, strict=True))

    step = formats.round_step(widest / 5.0)
    x_ticks = [(LEFT + scale * step * k, f"{step * k:g}") for k in range(int(widest / step) + 1)]
    y_ticks = [(HEIGHT - BOTTOM - scale * step * k, f"{step * k:g}") for k in range(int(highest / step) + 1)]
    width = round(LEFT + scale * widest + MARGIN, 1)
    marks = [
        [
            (
                round(LEFT + scale * r, 1),
                round(HEIGHT - BOTTOM - scale * h, 1),
                f"{r:.3f} m from the axis: {h:.3f} m",
            )
            for r, h in zip(*outline, strict=True)
        ]
        for outline in (first.outline, second.outline)
    ]
    return Outlines((path(first.outline), path(second.outline)), x_ticks, y_ticks, width, marks=marks)
