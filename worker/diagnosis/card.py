"""The card an engineer reads: four panels and a sentence, as one picture.

1 misfit by observable and condition after re-calibration, in sd; 2 probability that each effect is needed, with
the .95 line, what is not testable in grey; 3 the map with the named effects; 4 held-out gain by condition. The
sentence says "consistent with" and never "proved", with the size in plant words (effect_words.py), what is not
excluded and what would confirm it.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from service.domain.effect_words import estimate_in_words
from service.domain.effects import Library
from service.domain.misfit_words import place, reading
from service.domain.verdict_words import ONE_LIKELY
from worker.diagnosis.diagnose import Diagnosis
from worker.diagnosis.gain import fit_linear, named_directions
from worker.diagnosis.measured import Frame
from worker.diagnosis.result import AMBIGUOUS, CLAIM_FROM, NO_MISFIT, REFUSED, UNEXPLAINED, Claim, Result
from worker.diagnosis.simulator import FloatArray

WIDTH, HEIGHT, SHORT_HEIGHT = 1500, 1180, 680
_PANELS = ((40, 60), (790, 60), (40, 560), (790, 560))
_SIZE = (670, 440)
_INK, _FAINT, _GREY, _BAR, _LINE = "#1a1a1a", "#8a8a8a", "#c4c4c4", "#3b6ea5", "#b03030"
_FULL_COLOUR = 4.0
# Relative luminance (WCAG) below which white is read better than ink.
_DARK_BELOW = 0.2
_MOST_BARS = 9
_LEFT, _TOP = 165, 34
# Cells with less room than this, pixels, show their colour alone.
_ROOM_FOR_NUMBER = (34, 13)


class _Panel(NamedTuple):
    """Where one panel draws: upper left corner of its plot, its width and height, pixels."""

    draw: ImageDraw.ImageDraw
    x: int
    y: int
    width: int
    height: int

    def text(
        self, x: float, y: float, text: str, anchor: str = "lm", colour: str = _INK, size: int = 15
    ) -> None:
        font = ImageFont.load_default(size)
        self.draw.text((self.x + x, self.y + y), text, fill=colour, anchor=anchor, font=font)

    def box(self, x0: float, y0: float, x1: float, y1: float, colour: str) -> None:
        corners = (self.x + min(x0, x1), self.y + min(y0, y1), self.x + max(x0, x1), self.y + max(y0, y1))
        self.draw.rectangle(corners, fill=colour)

    def line(self, x0: float, y0: float, x1: float, y1: float, colour: str, width: int = 1) -> None:
        self.draw.line((self.x + x0, self.y + y0, self.x + x1, self.y + y1), fill=colour, width=width)


def draw_card(found: Diagnosis, result: Result, path: Path) -> None:
    """Writes the PNG. `result` is that of `found`, perhaps with its gain."""
    # Without a claim the lower panels have nothing to show.
    image = Image.new("RGB", (WIDTH, HEIGHT if result.claims else SHORT_HEIGHT), "white")
    draw = ImageDraw.Draw(image)
    draw.text(
        (40, 20), f"Diagnosis: {result.verdict.replace('_', ' ')}", fill=_INK, font=ImageFont.load_default(24)
    )
    panels = [
        _Panel(draw, x + _LEFT, y + _TOP, _SIZE[0] - _LEFT - 20, _SIZE[1] - _TOP - 60) for x, y in _PANELS
    ]
    if found.analysis is not None and found.measured is not None:
        frame = found.measured.frame
        before, after = misfits(found)
        _map(panels[0], "1 misfit after re-calibration, in sd", frame, before)
        _bars(panels[1], found, result)
        names = ", ".join(claim.effect for claim in result.claims)
        if result.claims:
            _map(panels[2], f"3 the same with {names}", frame, after)
            _gains(panels[3], result)
    known = None if found.setup is None else found.setup.known
    for k, line in enumerate(_wrapped(sentence(result, known), 150)):
        draw.text((40, image.height - 130 + 26 * k), line, fill=_INK, font=ImageFont.load_default(19))
    image.save(path, format="PNG")


def misfits(found: Diagnosis) -> tuple[FloatArray, FloatArray]:
    """Misfits (N,) in sd of noise, emulator and floor: re-calibrated alone, and with what is named."""
    assert found.analysis is not None
    problem, directions = found.analysis.problem, found.analysis.ranking.directions
    sd = np.sqrt(np.diag(problem.W))
    tables = []
    for rows in ((), named_directions(found)):
        fit = fit_linear(found, rows)
        left = problem.r - problem.J @ (fit.theta - 0.5)
        tables.append((left - directions.f[list(rows)].T @ fit.amplitudes if rows else left) / sd)
    return tables[0], tables[1]


def _map(panel: _Panel, title: str, frame: Frame, z: FloatArray) -> None:
    """Rows are summaries, columns conditions; white is 0, red above the model, blue below."""
    panel.text(0, -18, title, size=17)
    rows = list(
        dict.fromkeys((frame.conditions[c].test, frame.summary(i)) for i, c in enumerate(frame.condition))
    )
    columns = list(dict.fromkeys(frame.condition))
    high, wide = panel.height / max(len(rows), 1), panel.width / max(len(columns), 1)
    for i, c in enumerate(frame.condition):
        row, column = rows.index((frame.conditions[c].test, frame.summary(i))), columns.index(c)
        panel.box(
            column * wide, row * high, (column + 1) * wide - 1, (row + 1) * high - 1, colour_of(float(z[i]))
        )
        # Who does not see the colours apart reads the numbers.
        if wide >= _ROOM_FOR_NUMBER[0] and high >= _ROOM_FOR_NUMBER[1] and np.isfinite(z[i]):
            ink = _ink_on(colour_of(float(z[i])))
            panel.text((column + 0.5) * wide, (row + 0.5) * high, f"{z[i]:+.1f}", "mm", ink, size=12)
    for k, (_, name) in enumerate(rows):
        panel.text(-8, (k + 0.5) * high, reading(name), "rm", size=max(min(int(high), 14), 8))
    for k, c in enumerate(columns):
        panel.text((k + 0.5) * wide, panel.height + 12, frame.conditions[c].condition, "mm", size=13)
    panel.line(0, 0, panel.width, 0, _FAINT)
    panel.line(0, panel.height, panel.width, panel.height, _FAINT)
    for k, value in enumerate((-4, -2, 0, 2, 4)):
        panel.box(k * 46, panel.height + 26, k * 46 + 44, panel.height + 40, colour_of(float(value)))
        told, ink = f"{value:+d}" if value else "0", "white" if abs(value) == _FULL_COLOUR else _INK
        panel.text(k * 46 + 22, panel.height + 33, told, "mm", ink, size=12)


def colour_of(z: float) -> str:
    """White at 0, full red at +4 sd, full blue at -4; a missing number is grey."""
    if not np.isfinite(z):
        return _GREY
    share = min(abs(z) / _FULL_COLOUR, 1.0)
    end = (178, 24, 43) if z > 0.0 else (33, 102, 172)
    return "#" + "".join(f"{round(255 + (c - 255) * share):02x}" for c in end)


def _ink_on(colour: str) -> str:
    red, green, blue = (int(colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5))
    light = 0.2126 * red**2.2 + 0.7152 * green**2.2 + 0.0722 * blue**2.2
    return "white" if light < _DARK_BELOW else _INK


def _bars(panel: _Panel, found: Diagnosis, result: Result) -> None:
    assert found.analysis is not None
    ranking = found.analysis.ranking
    panel.text(0, -18, "2 probability that an effect is needed", size=17)
    told = [(e.id, float(p)) for e, p in zip(ranking.known.effects, ranking.inclusion, strict=True)]
    shown = [pair for pair in sorted(told, key=lambda pair: -pair[1]) if pair[0] not in result.not_testable]
    none, _, outside = ranking.probabilities
    bars = [("no effect", none), ("none of these", outside), *shown[:_MOST_BARS]]
    silent = list(result.not_testable)[:3]
    high = panel.height / (len(bars) + bool(silent))
    for k, (name, p) in enumerate(bars):
        panel.text(-8, (k + 0.5) * high, name, "rm", size=14)
        panel.box(0, (k + 0.15) * high, p * panel.width, (k + 0.85) * high, _FAINT if k < 2 else _BAR)
    if silent:
        more = (
            ""
            if len(result.not_testable) == len(silent)
            else f" and {len(result.not_testable) - len(silent)} more"
        )
        panel.text(
            0, (len(bars) + 0.5) * high, f"not testable: {', '.join(silent)}{more}", colour=_FAINT, size=14
        )
    panel.line(CLAIM_FROM * panel.width, 0, CLAIM_FROM * panel.width, panel.height, _LINE, 2)
    for value in (0.0, 0.5, CLAIM_FROM):
        panel.text(value * panel.width, panel.height + 12, f"{value:g}", "mm", size=13)


def _gains(panel: _Panel, result: Result) -> None:
    gain = result.gain
    if gain is None:
        panel.text(0, -18, "4 held-out gain: not opened", size=17)
        return
    title = (
        f"4 held-out gain {gain.log_score:+.1f} nats, rmse {gain.rmse_before:.2f} to {gain.rmse_after:.2f} sd"
    )
    panel.text(0, -18, title, size=17)
    top, bottom = max(*gain.by_condition.values(), 1.0), min(*gain.by_condition.values(), 0.0)
    wide, unit = panel.width / len(gain.by_condition), panel.height / (top - bottom)
    for k, (name, score) in enumerate(gain.by_condition.items()):
        panel.box((k + 0.2) * wide, top * unit, (k + 0.8) * wide, (top - score) * unit, _BAR)
        panel.text((k + 0.5) * wide, panel.height + 12, name, "mm", size=13)
    panel.line(0, top * unit, panel.width, top * unit, _INK)
    for value in (top, bottom):
        panel.text(-8, (top - value) * unit, f"{value:+.1f}", "rm", size=13)


def sentence(result: Result, known: Library | None) -> str:
    """What the diagnosis says, in plant words."""
    after = f" Next: {result.next_measurement[0].what}." if result.next_measurement else ""
    if result.verdict == REFUSED:
        return " ".join(result.sentences)
    if result.verdict == NO_MISFIT:
        said = "What was measured is consistent with the calibrated model: nothing larger than the limits of these"
        return f"{said} data was detected; what is smaller may hide.{after}"
    possible = ", ".join(p.effect for p in result.also_possible[:4])
    if result.verdict == AMBIGUOUS and len(result.also_possible) == 1:
        likely = result.also_possible[0].effect
        what = f"{known[likely].what} ({likely})" if known is not None and likely in known else likely
        return f"{ONE_LIKELY} Within this library: {what}.{after}"
    if result.verdict == AMBIGUOUS:
        return f"Within this library the misfit is consistent with any of: {possible}.{after}"
    if result.verdict == UNEXPLAINED:
        places = ", ".join(place(w.block) for w in result.unexplained)
        return f"Something is off in {places}, and no effect of this library explains it.{after}"
    stated = "; ".join(_stated(claim, known) for claim in result.claims)
    rest = f" Not excluded: {possible}." if possible else ""
    left = " Something else remains." if result.verdict != "named" else ""
    return (
        f"Within this library the misfit is consistent with: {stated}. In brackets the 90 % interval."
        f"{rest}{left}{after}"
    )


def _stated(claim: Claim, known: Library | None) -> str:
    what = claim.effect if known is None else known[claim.effect].what
    size = estimate_in_words(claim.effect, claim.amplitude.value, claim.amplitude.ci90, claim.amplitude.unit)
    confirm = "" if known is None else f"; to confirm: {known[claim.effect].check.what}"
    return f"{what}, equivalent to {size}{confirm}"


def _wrapped(text: str, width: int) -> list[str]:
    lines = [""]
    for word in text.split():
        if len(lines[-1]) + len(word) >= width:
            lines.append("")
        lines[-1] = f"{lines[-1]} {word}".strip()
    return lines
