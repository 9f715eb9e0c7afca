"""python -m worker.deflector: search a better deflector for both materials, pick by weights, confirm it.

It leaves record.jsonl and confirmation.jsonl (every charge), pareto.png, study.json, and of the chosen device
chosen.stl, chosen.toml (for --plant) and chosen.png, the plant drawn with its dimensions. Called again it goes on.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from demcore.errors import InputError
from demcore.experiments.charge_case import ChargeTest, charge_names, load_charge
from demcore.geometry.mesh_file import save_mesh
from demcore.plant.parts import Plant
from demcore.plant.plant_file import key_of, load_plant
from demcore.plant.surfaces import deflector_mesh
from worker.deflector import charges
from worker.deflector.confirmation import Confirmation, as_records, confirm, sentences
from worker.deflector.designs import Space
from worker.deflector.pareto import pick
from worker.deflector.picture import draw_pareto
from worker.deflector.record import Record
from worker.deflector.spread import on_processes
from worker.deflector.study import OBJECTIVES, StudyPlan, Tried, arrays_of, front_of, run_study
from worker.evaluate import plain


def parser() -> argparse.ArgumentParser:
    """The arguments."""
    made = argparse.ArgumentParser(prog="python -m worker.deflector", description=__doc__.splitlines()[0])
    made.add_argument("--scale", type=float, default=10.0, help="of the study (default 10)")
    made.add_argument("--designs", type=int, default=20, help="beside the present device (default 20)")
    made.add_argument("--initial", type=int, default=12, help="of them spread over the box (default 12)")
    made.add_argument("--materials", default="coke,iron", help=", ".join(charge_names()))
    made.add_argument("--seed", type=int, default=1)
    made.add_argument("--plant", type=Path, help="what differs from the shipped plant, as TOML")
    made.add_argument("--weights", default="0.5,0.5", help="of evenness of mass and of size, for the choice")
    made.add_argument(
        "--confirm-scale", type=float, help="charge present and chosen device with fresh seeds at it"
    )
    made.add_argument("--confirm-seeds", type=int, default=3)
    made.add_argument("--processes", type=int, default=1, help="charges at once, each on a core (default 1)")
    made.add_argument("--estimate", action="store_true", help="only tell what the study would cost")
    made.add_argument("--out", type=Path, default=Path("deflector"), help="folder for the files")
    return made


def main(arguments: Sequence[str] | None = None) -> int:
    """The exit status: 2 for what is refused."""
    given = parser().parse_args(arguments)
    try:
        return study(given)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2


def study(given: argparse.Namespace) -> int:
    """Run or go on with the study, choose, confirm, write."""
    plan = StudyPlan(given.designs, given.initial, tuple(given.materials.split(",")), given.seed)
    space = Space(load_plant(given.plant))
    weights = _weights(given.weights)
    for material in plan.materials:
        ChargeTest(load_charge(material), space.plant, scale=given.scale)
    if given.estimate:
        return _estimate(space.plant, plan, given.scale)
    if given.processes < 1:
        raise InputError("processes", given.processes, "1 or more")
    spread = on_processes(given.processes)
    given.out.mkdir(parents=True, exist_ok=True)
    designs = run_study(
        space,
        plan,
        charges.Evaluation(space, given.scale),
        Record(given.out / "record.jsonl"),
        lambda line: print(line, flush=True),
        spread,
    )
    good = [k for k, t in enumerate(designs) if t.has_result]
    if not good:
        print("error: no charge came to an end", file=sys.stderr)
        return 1
    chosen = good[pick(arrays_of([designs[k] for k in good])[1], weights)]
    facts: dict[str, Any] = {"weights": weights, "scale": given.scale, "confirmed": None}
    # Before the confirmation, which takes long, and after.
    write(given.out, space, designs, chosen, facts)
    if given.confirm_scale is not None:
        plan_of = Confirmation(plan.materials, given.confirm_scale, given.confirm_seeds)
        plants = {"present": space.plant, "chosen": space.plant_of(designs[chosen].u)}
        record = Record(given.out / "confirmation.jsonl")
        found = confirm(plants, plan_of, charges.charge_of, record, designs[chosen].u, spread)
        for material, rows in found.items():
            print("\n".join(sentences(material, rows, plan_of)))
        confirmed = {material: as_records(rows) for material, rows in found.items()}
        write(given.out, space, designs, chosen, facts | {"confirmed": confirmed})
    print(
        f"chosen: design {chosen} of {len(designs)}; files in {given.out}: pareto.png, study.json, chosen.stl"
    )
    return 0


def _weights(text: str) -> list[float]:
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise InputError("weights", text, "two numbers with a comma, as .5,.5") from None


def _estimate(plant: Plant, plan: StudyPlan, scale: float) -> int:
    from demcore.experiments.charge_test import estimate_cost

    hours = 0.0
    for material in plan.materials:
        cost = estimate_cost(ChargeTest(load_charge(material), plant, scale=scale))
        print(f"{material}: {cost.sentence()}")
        hours += (plan.designs + 1) * cost.seconds / 3600.0
    print(f"{plan.designs + 1} devices: about {hours:.1f} h")
    return 0


def write(folder: Path, space: Space, designs: Sequence[Tried], chosen: int, more: Mapping[str, Any]) -> None:
    """The study's files."""
    from demcore.experiments.plant_drawing import draw_plant

    device = space.deflector(designs[chosen].u)
    draw_pareto(designs, folder / "pareto.png", chosen=chosen)
    save_mesh(deflector_mesh(device), folder / "chosen.stl")
    draw_plant(replace(space.plant, deflector=device), folder / "chosen.png")
    lines = [f"{key_of(name)[0]} = {value / key_of(name)[1]:.9g}" for name, value in asdict(device).items()]
    (folder / "chosen.toml").write_text("[deflector]\n" + "\n".join(lines) + "\n", encoding="utf-8")
    rows = [
        {
            "number": k,
            "deflector": asdict(space.plant.deflector if k == 0 else space.deflector(t.u)),
            "objectives": dict(zip(OBJECTIVES, t.objectives, strict=True)),
            "by_material": t.by_material,
        }
        for k, t in enumerate(designs)
    ]
    content = {"designs": rows, "front": front_of(designs), "chosen": chosen, **more}
    (folder / "study.json").write_text(json.dumps(plain(content), indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
