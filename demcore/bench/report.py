"""The bench as a whole: every bed, law and thread count in turn, against LIGGGHTS in the same minutes, as rows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from demcore.bench.beds import LAWS, Bed, load_bed
from demcore.bench.liggghts import LiggghtsCourse, find_programs, run_liggghts
from demcore.bench.rates import Course, Runner, check_threads, peak_of_search
from demcore.dormancy import Dormancy
from demcore.errors import InputError

# About a second of either program on one core.
PARTICLE_STEPS = 4_000_000
REPEATS = 3
# Contact counts of the two programs must agree to this share, or the ratio compares different work.
SAME_CONTACTS = 0.05


@dataclass(frozen=True)
class Bench:
    """What to measure: beds by name, laws, thread counts, rounds; LIGGGHTS beside it or not. `dormancy`: each law
    with the option too, all of them on beds that have come to lie still."""

    beds: Sequence[str]
    laws: Sequence[str] = LAWS
    threads: Sequence[int] = (1, 2)
    against_liggghts: bool = False
    folder: Path | None = None
    repeats: int = REPEATS
    particle_steps: int = PARTICLE_STEPS
    dormancy: bool = False

    def __post_init__(self) -> None:
        for law in self.laws:
            if law not in LAWS:
                raise InputError("law", law, "one of " + ", ".join(LAWS))
        for threads in self.threads:
            check_threads(threads)
            if self.against_liggghts:
                find_programs(threads)
        if not 1 <= self.repeats <= 100:
            raise InputError("repeats", self.repeats, "1 to 100")
        if not 1 <= self.particle_steps <= 10**12:
            raise InputError("particle_steps", self.particle_steps, "1 to 1e12")


@dataclass(frozen=True)
class Row:
    """One bed under one law on so many threads; `theirs` is None where LIGGGHTS was not run, `dormant_share`, of
    the particles at the end, without the option."""

    bed: str
    law: str
    threads: int
    particles: int
    steps: int
    ours: Course
    memory_bytes: int
    first_call_seconds: float
    theirs: LiggghtsCourse | None
    dormant_share: float | None = None

    @property
    def rate(self) -> float:
        """Particle-steps per second."""
        return self.particles * self.steps / self.ours.seconds

    @property
    def liggghts_rate(self) -> float | None:
        return None if self.theirs is None else self.particles * self.steps / self.theirs.seconds

    @property
    def has_same_contacts(self) -> bool | None:
        """Whether both programs had the same work. Asked under `hertz` only: LIGGGHTS lacks the paper's law."""
        if self.theirs is None or self.law != "hertz":
            return None
        return abs(self.ours.contacts - self.theirs.contacts) <= SAME_CONTACTS * self.theirs.contacts

    def record(self) -> dict[str, Any]:
        """The row as JSON: issue 3's keys first. `memory_bytes` is the total, also given per particle."""
        n, ours, theirs = self.particles, self.ours, self.theirs
        return {
            "bed": self.bed,
            "law": self.law,
            "threads": self.threads,
            "rate": self.rate,
            "contacts_per_particle": ours.contacts / n,
            "memory_bytes": self.memory_bytes,
            "ratio_to_liggghts": None if theirs is None else theirs.seconds / ours.seconds,
            "particles": n,
            "steps": self.steps,
            "pairs_per_particle": ours.pairs / n,
            "rebuilds": ours.rebuilds,
            "memory_bytes_per_particle": self.memory_bytes / n,
            "share_of_search": ours.search_seconds / ours.seconds,
            "share_of_forces_and_motion": 1.0 - ours.search_seconds / ours.seconds,
            "first_call_s": self.first_call_seconds,
            "liggghts_rate": self.liggghts_rate,
            "liggghts_contacts_per_particle": None if theirs is None else theirs.contacts / n,
            "liggghts_rebuilds": None if theirs is None else theirs.rebuilds,
            "has_same_contacts": self.has_same_contacts,
            "dormant_share": self.dormant_share,
        }


def measure(bench: Bench, report: Callable[[Row], None]) -> list[Row]:
    """Measure every combination; each row is reported as soon as it is known."""
    beds = [load_bed(name, bench.folder) for name in bench.beds]
    rows = []
    for bed in beds:
        for threads in bench.threads:
            for row in _rows(bench, bed, threads):
                report(row)
                rows.append(row)
    return rows


def _rows(bench: Bench, bed: Bed, threads: int) -> list[Row]:
    """All laws on one bed, in turns with LIGGGHTS, so that a busy spell of the machine meets everybody.

    Of each, the fastest turn counts: what else runs on the machine can only slow one down.
    """
    count = len(bed.radii)
    steps = max(1, bench.particle_steps // count)
    options = (None, Dormancy()) if bench.dormancy else (None,)
    runners = {
        (law, option): Runner(bed, law, threads, option, bench.dormancy)
        for law in bench.laws
        for option in options
    }
    ours: dict[tuple[str, Dormancy | None], list[Course]] = {variant: [] for variant in runners}
    theirs = []
    for _ in range(bench.repeats):
        for variant, runner in runners.items():
            ours[variant].append(runner.course(steps))
        if bench.against_liggghts:
            theirs.append(run_liggghts(bed, threads, steps))
    fastest = min(theirs, key=lambda course: course.seconds, default=None)
    rows = []
    for (law, option), runner in runners.items():
        best = min(ours[law, option], key=lambda course: course.seconds)
        share = None if option is None else runner.simulation.dormant_count / count
        memory = peak_of_search(runner.simulation)
        first_call = runner.first_call_seconds
        rows.append(Row(bed.name, law, threads, count, steps, best, memory, first_call, fastest, share))
    return rows


HEADER = (
    f"{'bed':<9}{'law':<7}{'threads':>7} {'particle-steps/s':>17} {'contacts':>8} {'pairs':>6} {'rebuilds':>8} "
    f"{'bytes':>6} {'search':>7} {'first call':>10}   LIGGGHTS: rate, contacts, ratio"
)


def line(row: Row) -> str:
    """A row of the printed table; contacts, pairs and bytes per particle."""
    r = row.record()
    text = (
        f"{row.bed:<9}{row.law:<7}{row.threads:>7} {row.rate:>17.3e} {r['contacts_per_particle']:>8.3f} "
        f"{r['pairs_per_particle']:>6.2f} {row.ours.rebuilds:>8} {r['memory_bytes_per_particle']:>6.0f} "
        f"{r['share_of_search']:>7.1%} {row.first_call_seconds:>8.2f} s   "
    )
    if row.theirs is not None:
        text += f"{row.liggghts_rate:.3e}, {r['liggghts_contacts_per_particle']:.3f}, {r['ratio_to_liggghts']:.2f}"
    if row.dormant_share is not None:
        text += f"  with dormancy, {row.dormant_share:.0%} of the particles dormant"
    if row.has_same_contacts is False:
        text += "  CONTACTS DIFFER: not the same work"
    return text


def size_ratio_lines(rows: Sequence[Row]) -> list[str]:
    """Cost per particle with a size ratio of 10, in costs of the monodisperse bed (issue 3: at most 2)."""
    rates = {(r.bed, r.law, r.threads): r.rate for r in rows if r.dormant_share is None}
    return [
        f"cost per particle with a size ratio of 10, {law}, {threads} thread{'s' if threads > 1 else ''}: "
        f"{rates['mono', law, threads] / rate:.2f} times that of equal spheres"
        for (bed, law, threads), rate in rates.items()
        if bed == "ratio10" and ("mono", law, threads) in rates
    ]
