"""Numbers as a person reads them: with units, with their uncertainty, with as many digits as it allows."""

from __future__ import annotations

import math
import re
from datetime import UTC, datetime

from markupsafe import Markup, escape

from service.domain.observables import OBSERVABLES
from service.domain.spec_record import primary_response, upgraded

NOTHING = "–"
THIN = "\u202f"  # narrow no-break space: between a number and its unit, and between thousands
FIXED = "\u00a0"  # no-break space


def _decimals(spread: float | None) -> int:
    """One digit behind the point for a spread of a degree or more, two below."""
    return 1 if spread is not None and spread >= 1.0 else 2


def degrees(value: float | None, digits: int = 2) -> str:
    """25.43°"""
    return NOTHING if value is None else f"{value:.{digits}f}°"


def degrees_within(value: float | None, spread: float | None, digits: int | None = None) -> str:
    """25.43° ± 0.21°; `digits` where numbers stand below each other."""
    if value is None or spread is None:
        return degrees(value)
    digits = _decimals(spread) if digits is None else digits
    return f"{value:.{digits}f}°{FIXED}±{FIXED}{spread:.{digits}f}°"


def with_unit(value: float, unit: str, spread: float | None = None) -> str:
    """25.43° ± 0.21° or 12.3 kg ± 0.4 kg: a response in its own unit."""
    if unit == "deg":
        return degrees(value) if spread is None else degrees_within(value, spread)
    text = f"{value:.3g}{THIN}{unit}"
    return text if spread is None else f"{text}{FIXED}±{FIXED}{spread:.2g}{THIN}{unit}"


def in_unit_of(value: float, observable: str) -> str:
    """As many digits as were asked for, in the observable's unit."""
    unit = OBSERVABLES[observable].unit if observable in OBSERVABLES else ""
    return plain_degrees(value) if unit == "deg" else f"{value:g}{THIN}{unit}"


def plain_degrees(value: float) -> str:
    """As many digits as were asked for: 25.5°, 26°"""
    return f"{value:g}°"


def parameter(value: float | None) -> str:
    """0.35; two digits as the search space has them, three where the value needs them; 1e+07 of a modulus."""
    if value is None:
        return NOTHING
    if abs(value) >= 1000.0:
        return f"{value:.3g}"
    return f"{value:.2f}" if abs(value * 100 - round(value * 100)) < 1e-6 else f"{value:.3f}"


def round_step(raw: float) -> float:
    """The least of 1, 2 and 5 times a power of ten that is not below `raw`."""
    power = 10.0 ** math.floor(math.log10(raw))
    return next(power * m for m in (1.0, 2.0, 5.0, 10.0) if power * m >= raw * (1.0 - 1e-9))


def percent(share: float | None) -> str:
    """97 %; near the ends with a digit, so that 99.6 is not shown as certain."""
    if share is None:
        return NOTHING
    value = 100.0 * share
    digits = 1 if 0.0 < value < 1.0 or 99.0 < value < 100.0 else 0
    return f"{value:.{digits}f}{THIN}%"


def chance(probability: float | None) -> str:
    """81 %; a model is never sure, so that a rounded 1 is told as > 99.9 %."""
    if probability is not None and probability > 0.9995:
        return f"> 99.9{THIN}%"
    if probability is not None and probability < 0.0005:
        return f"< 0.1{THIN}%"
    return percent(probability)


def length(metres: float | None) -> str:
    """35 mm, 1.20 m"""
    if metres is None:
        return NOTHING
    return f"{1000 * metres:.3g}{THIN}mm" if abs(metres) < 0.9995 else f"{metres:.3g}{THIN}m"


def quantity(value: float | None, unit: str = "", digits: int = 3) -> str:
    """A number with `digits` significant digits and its unit; very small and large ones as a power of ten."""
    if value is None:
        return NOTHING
    tail = f"{THIN}{unit}" if unit else ""
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g}{tail}"
    exponent = math.floor(math.log10(abs(value)))
    if -4 <= exponent < 6:
        decimals = max(0, digits - 1 - exponent)
        return f"{value:,.{decimals}f}".replace(",", THIN) + tail
    raised = str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"{value / 10.0**exponent:.{digits - 1}f} · 10{raised}{tail}"


def count(value: int | None) -> str:
    """1 050"""
    return NOTHING if value is None else f"{value:,}".replace(",", THIN)


def duration(seconds: float | None) -> str:
    """42 s, 3 min 20 s, 1 h 05 min"""
    if seconds is None:
        return NOTHING
    whole = max(0, round(seconds))
    if whole < 60:
        return f"{whole}{THIN}s"
    if whole < 3600:
        return f"{whole // 60}{THIN}min {whole % 60:02d}{THIN}s"
    if whole < 48 * 3600:
        return f"{whole // 3600}{THIN}h {whole % 3600 // 60:02d}{THIN}min"
    return f"{whole // 86400}{THIN}days"


def size(amount: int | None) -> str:
    """1.3 MB"""
    if amount is None:
        return NOTHING
    for unit, scale in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if amount >= scale:
            return f"{amount / scale:.3g}{THIN}{unit}"
    return f"{amount}{THIN}bytes"


def moment(seconds: float | None) -> Markup:
    """A <time> in UTC, which the page's script turns into the reader's own zone."""
    if seconds is None:
        return Markup(NOTHING)
    then = datetime.fromtimestamp(seconds, UTC)
    shown = then.strftime("%Y-%m-%d %H:%M")
    return Markup('<time datetime="{}" data-local>{} UTC</time>').format(
        then.isoformat("T", "seconds"), shown
    )


def sentence(text: str | None) -> Markup:
    """A stored sentence, which is plain ASCII, with degree and plus-minus signs."""
    found = str(escape(text or ""))
    found = re.sub(r"(\d) deg\b", r"\1°", found).replace("+- ", "±" + FIXED).replace("+-", "±")
    return Markup(re.sub(r"(\d) %", rf"\1{THIN}%", found))


def listed(words: list[str]) -> str:
    """a, b and c"""
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " and " + words[-1] if words else ""


FILTERS = {
    "degrees": degrees,
    "degrees_within": degrees_within,
    "plain_degrees": plain_degrees,
    "primary_response": primary_response,
    "with_unit": with_unit,
    "in_unit_of": in_unit_of,
    "upgraded": upgraded,
    "parameter": parameter,
    "percent": percent,
    "chance": chance,
    "length_of": length,
    "quantity": quantity,
    "number": count,
    "duration": duration,
    "size": size,
    "moment": moment,
    "sentence": sentence,
    "listed": listed,
}
