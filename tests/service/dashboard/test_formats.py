"""Numbers as a person reads them."""

from __future__ import annotations

import pytest

from service.dashboard import formats
from service.dashboard.gauge import draw_gauge


@pytest.mark.parametrize(
    ("got", "wanted"),
    [
        (formats.degrees(25.434), "25.43°"),
        (formats.degrees(None), "–"),
        (formats.degrees_within(25.434, 0.21), "25.43°\u00a0±\u00a00.21°"),
        (formats.degrees_within(25.434, 1.26), "25.4°\u00a0±\u00a01.3°"),
        (formats.degrees_within(25.434, 1.26, 2), "25.43°\u00a0±\u00a01.26°"),
        (formats.degrees_within(25.434, None), "25.43°"),
        (formats.plain_degrees(26.0), "26°"),
        (formats.parameter(0.35), "0.35"),
        (formats.parameter(0.355), "0.355"),
        (formats.parameter(None), "–"),
        (formats.percent(0.5), "50\u202f%"),
        (formats.percent(0.996), "99.6\u202f%"),
        (formats.percent(0.004), "0.4\u202f%"),
        (formats.percent(1.0), "100\u202f%"),
        (formats.chance(0.81), "81\u202f%"),
        (formats.chance(0.99999), "> 99.9\u202f%"),
        (formats.chance(0.0001), "< 0.1\u202f%"),
        (formats.chance(None), "–"),
        (formats.length(0.0352), "35.2\u202fmm"),
        (formats.length(1.2), "1.2\u202fm"),
        (formats.quantity(0.0), "0"),
        (formats.quantity(50.84, "kg"), "50.8\u202fkg"),
        (formats.quantity(123456.0), "123\u202f456"),
        (formats.quantity(-3.5e-5, "s"), "-3.50 · 10⁻⁵\u202fs"),
        (formats.count(1050), "1\u202f050"),
        (formats.duration(41.6), "42\u202fs"),
        (formats.duration(200), "3\u202fmin 20\u202fs"),
        (formats.duration(3900), "1\u202fh 05\u202fmin"),
        (formats.duration(4 * 86400), "4\u202fdays"),
        (formats.size(77_800), "77.8\u202fkB"),
        (formats.size(12), "12\u202fbytes"),
        (formats.moment(None), "–"),
        (formats.listed(["a", "b", "c"]), "a, b and c"),
        (formats.sentence("25.4 deg +-0.4 deg, 9 % <b>"), "25.4° ±0.4°, 9\u202f% &lt;b&gt;"),
    ],
)
def test_formats(got: str, wanted: str) -> None:
    assert got == wanted


def test_a_moment_says_its_zone_and_carries_it_for_the_script() -> None:
    assert str(formats.moment(0.0)) == (
        '<time datetime="1970-01-01T00:00:00+00:00" data-local>1970-01-01 00:00 UTC</time>'
    )


def test_the_gauge_holds_all_marks_in_their_order() -> None:
    gauge = draw_gauge((25.0, 26.0), 25.5, 25.7, 0.6, (25.1, 25.9))
    assert gauge.middle is not None and gauge.interval is not None
    places = [gauge.lower, gauge.interval[0], gauge.runs[0], gauge.target, gauge.middle, gauge.runs[1]]
    in_order = sorted(places, key=lambda mark: mark.value)
    assert [mark.at for mark in in_order] == sorted(mark.at for mark in places)
    assert all(0.0 < mark.at < 100.0 for mark in [*places, gauge.upper, gauge.interval[1]])
    # One number line: equal steps in degrees are equal steps on it.
    assert gauge.target.at - gauge.lower.at == pytest.approx(gauge.upper.at - gauge.target.at, abs=1e-2)
