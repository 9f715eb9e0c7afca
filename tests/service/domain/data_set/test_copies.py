"""A copied replicate is refused and an honest one is not, however coarsely it is rounded: of simulated labs."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping, Sequence

import pytest

from service.domain.data_set.copies import copied_replicates, copied_scans
from service.domain.data_set.records import Observation, Profile

# What a lab reads: the mean in a condition by its number, the sd between replicates, the step of the rounding.
Reading = tuple[Callable[[int], float], float, float]
ANGLE = (lambda k: 31.0 + 1.3 * k), 0.8
MASS = (lambda k: 123.0), 1.0
APEX = (lambda k: 0.31 + 0.021 * k), 0.006
DENSITY = (lambda k: 650.0 + 12.0 * k), 11.0
D50 = (lambda k: 0.0475), 0.0
COARSE: Mapping[str, tuple[int, int, dict[str, Reading]]] = {
    "angle .5, mass .5": (6, 4, {"repose_angle_deg": (*ANGLE, 0.5), "mass_on_base_kg": (*MASS, 0.5)}),
    "angle .5, apex 5 mm, density 10": (
        6, 4,
        {
            "repose_angle_deg": (*ANGLE, 0.5),
            "apex_height_m": (*APEX, 0.005),
            "bulk_density_kg_m3": (*DENSITY, 10.0),
        },
    ),
    "angle .1, d50 constant": (6, 3, {"repose_angle_deg": (*ANGLE, 0.1), "d50_on_base_m": (*D50, 0.0005)}),
    "angle .1, mass .1": (6, 4, {"repose_angle_deg": (*ANGLE, 0.1), "mass_on_base_kg": (*MASS, 0.1)}),
}  # fmt: skip
FINE: Mapping[str, dict[str, Reading]] = {
    "24.37 deg, 48.213 kg": {
        "repose_angle_deg": (*ANGLE, 0.01),
        "mass_on_base_kg": ((lambda k: 48.0 + 7.0 * k), 0.4, 0.001),
    },
    "24.37 deg, 48.21 kg, .1234 m": {
        "repose_angle_deg": (*ANGLE, 0.01),
        "mass_on_base_kg": ((lambda k: 48.0 + 7.0 * k), 0.4, 0.01),
        "apex_height_m": (*APEX, 0.0001),
    },
    "123.4 kg, .312 m, 654 kg/m3, 12.34 s": {
        "mass_on_base_kg": (*MASS, 0.1),
        "apex_height_m": (*APEX, 0.001),
        "bulk_density_kg_m3": (*DENSITY, 1.0),
        "discharge_t90_s": ((lambda k: 12.0 + k), 0.5, 0.01),
    },
}


def lab(
    stream: random.Random, conditions: int, replicates: int, readings: Mapping[str, Reading]
) -> list[Observation]:
    """One honest data set, each reading rounded to its step."""
    return [
        Observation(f"p{k}", str(i), name, round(stream.gauss(mean(k), sd) / step) * step)
        for k in range(conditions)
        for i in range(replicates)
        for name, (mean, sd, step) in readings.items()
    ]


def repeated(
    data: Sequence[Observation], copies: Mapping[tuple[str, str], tuple[str, str]]
) -> list[Observation]:
    """The data with some replicates replaced by what others read."""
    values = {(o.condition, o.replicate, o.observable): o.value for o in data}
    places = [(copies.get((o.condition, o.replicate), (o.condition, o.replicate)), o) for o in data]
    return [
        Observation(o.condition, o.replicate, o.observable, values[(*place, o.observable)])
        for place, o in places
    ]


@pytest.mark.parametrize("scatter", [0.3, 1.0, 3.0])
@pytest.mark.parametrize("design", COARSE)
def test_honest_rounded_readings_are_no_copies(design: str, scatter: float) -> None:
    stream = random.Random(3)
    conditions, replicates, readings = COARSE[design]
    readings = {name: (mean, scatter * sd, step) for name, (mean, sd, step) in readings.items()}
    refused = sum(any(copied_replicates(lab(stream, conditions, replicates, readings))) for _ in range(400))
    assert refused == 0


@pytest.mark.parametrize("unit", [57.29577951308232 * 0.01, 0.0254 / 16.0])
def test_a_step_of_another_unit_is_a_step_too(unit: float) -> None:
    """Angles to .01 rad and heights to a sixteenth of an inch have many digits once they are converted."""
    stream = random.Random(4)
    readings = {"apex_height_m": (ANGLE[0], 0.8 * unit, unit), "repose_angle_deg": (ANGLE[0], unit, unit)}
    assert not any(any(copied_replicates(lab(stream, 6, 4, readings))) for _ in range(200))


@pytest.mark.parametrize("shift", [0.0, 0.01234])
def test_honest_readings_that_vary_together_or_are_shifted_are_no_copies(shift: float) -> None:
    """Angle and apex of one pile follow each other; heights are read above a plate of some thickness."""
    stream, refused = random.Random(5), 0
    for _ in range(400):
        data = []
        for k in range(6):
            for i in range(4):
                high = stream.gauss(0.0, 1.0)
                apex = 0.3 + 0.02 * k + 0.006 * (0.9 * high + 0.44 * stream.gauss(0.0, 1.0))
                data.append(Observation(f"p{k}", str(i), "repose_angle_deg", round(30.0 + k + 0.8 * high, 1)))
                data.append(Observation(f"p{k}", str(i), "apex_height_m", round(apex, 3) - shift))
        refused += any(copied_replicates(data))
    assert refused <= 1


def test_a_condition_that_scatters_less_than_the_others_is_no_copy() -> None:
    """One of six conditions reads the same to a step or two in every observable."""
    stream, refused = random.Random(6), 0
    for _ in range(300):
        data = lab(stream, 5, 4, FINE["123.4 kg, .312 m, 654 kg/m3, 12.34 s"])
        for i in range(4):
            for name, value, step in (("mass_on_base_kg", 80.0, 0.1), ("apex_height_m", 0.2, 0.001)):
                data.append(Observation("quiet", str(i), name, value + step * stream.choice((0, 0, 1))))
        refused += any(copied_replicates(data))
    assert refused == 0


@pytest.mark.parametrize(("replicates", "least"), [(3, 90), (4, 97)])
@pytest.mark.parametrize("readings", FINE)
def test_a_copy_of_readings_with_digits_is_refused(readings: str, replicates: int, least: int) -> None:
    """Nearly always: of three replicates, two are left to tell the scatter, and may be near each other."""
    stream, told = random.Random(7), 0
    for _ in range(100):
        honest = lab(stream, 6, replicates, FINE[readings])
        assert not any(copied_replicates(honest))
        found = list(copied_replicates(repeated(honest, {("p2", "2"): ("p2", "1")})))
        told += found == [(("p2", "2"), "an experiment of its own; it repeats replicate 1 of p2")]
    assert told >= least


def test_a_copy_from_another_condition_is_refused() -> None:
    stream = random.Random(8)
    honest = lab(stream, 6, 3, FINE["24.37 deg, 48.21 kg, .1234 m"])
    found = list(copied_replicates(repeated(honest, {("p4", "0"): ("p1", "2")})))
    assert found == [(("p4", "0"), "an experiment of its own; it repeats replicate 2 of p1")]


def test_replicates_that_are_all_one_are_refused() -> None:
    """Then nothing tells the scatter."""
    stream = random.Random(9)
    for readings in FINE.values():
        honest = lab(stream, 6, 3, readings)
        copies = {(f"p{k}", str(i)): (f"p{k}", "0") for k in range(6) for i in (1, 2)}
        assert len(list(copied_replicates(repeated(honest, copies)))) == 12


def scans(stream: random.Random, step: float = 0.001, rough: float = 0.006) -> list[Profile]:
    """Three scans of each of two piles, rounded to `step`, m, on one grid of 12 by 8 points."""
    points = [(30.0 * a, 0.05 * (b + 1)) for a in range(12) for b in range(8)]
    theta, r = zip(*points, strict=True)
    return [
        Profile(name, str(i), theta, r, tuple(
            round(max(apex - 0.7 * at + stream.gauss(0.0, rough), 0.0) / step) * step for at in r
        ))
        for name, apex in (("p0", 0.25), ("p1", 0.33))
        for i in range(3)
    ]  # fmt: skip


def test_a_scan_under_another_name_is_refused() -> None:
    stream = random.Random(10)
    for _ in range(20):
        honest = scans(stream)
        assert not any(copied_scans(honest))
        first = honest[0]
        again = Profile("p0", "2", first.theta_deg[::-1], first.r_m[::-1], first.h_m[::-1])
        expected = [(("p0", "2"), "a scan of its own; it repeats replicate 0 of p0")]
        assert list(copied_scans([*honest[:2], again, *honest[3:]])) == expected
        thrice = [
            Profile(p.condition, str(i), p.theta_deg, p.r_m, p.h_m) for p in honest[::3] for i in range(3)
        ]
        assert [place for place, _ in copied_scans(thrice)] == [
            ("p0", "1"),
            ("p0", "2"),
            ("p1", "1"),
            ("p1", "2"),
        ]


def test_scans_that_can_hardly_differ_are_no_copies() -> None:
    """Of a few points, and of a bare plate."""
    flat = [Profile("p0", str(i), (0.0, 90.0), (0.1, 0.1), (0.0, 0.0)) for i in range(3)]
    assert not any(copied_scans(flat))
    two = [Profile("p0", str(i), (0.0, 90.0), (0.1, 0.1), (0.3, 0.31)) for i in range(3)]
    assert not any(copied_scans(two))


def test_many_replicates_that_meet_are_gone_through_fast() -> None:
    """Readings so coarse that thousands agree, and thousands of the same tiny scan."""
    stream = random.Random(11)
    data = lab(stream, 250, 80, {"repose_angle_deg": (*ANGLE, 1.0)})
    assert not any(copied_replicates(data))
    tiny = [Profile("p0", str(i), (0.0,), (0.1,), (0.3,)) for i in range(4000)]
    assert not any(copied_scans(tiny))
