"""Shipped materials and rigs: data of demcore, read-only."""

from __future__ import annotations

from fastapi import APIRouter

from demcore.material import Material, load_material, material_names
from demcore.rig import load_rig, rig_names
from service.api.problems import problem_responses
from service.api.views import (
    MaterialAnswer,
    MaterialList,
    RigAnswer,
    RigList,
    SizeClassAnswer,
    WallRestitutionAnswer,
)
from service.errors import NotFound

router = APIRouter(prefix="/v1", tags=["materials"])


@router.get("/materials", operation_id="listMaterials", responses=problem_responses())
def list_materials() -> MaterialList:
    """The materials that a study can name."""
    return MaterialList(items=[_material(load_material(name)) for name in material_names()])


@router.get("/materials/{name}", operation_id="getMaterial", responses=problem_responses(404, 422))
def get_material(name: str) -> MaterialAnswer:
    """One material."""
    if name not in material_names():
        raise NotFound(f"There is no material {name[:64]!r}; there are {', '.join(material_names())}.")
    return _material(load_material(name))


@router.get("/rigs", operation_id="listRigs", responses=problem_responses())
def list_rigs() -> RigList:
    """The pile-test rigs (the paper's Table 2)."""
    rigs = [load_rig(name) for name in rig_names()]
    return RigList(
        items=[
            RigAnswer(
                name=rig.name,
                base_diameter_m=rig.base_diameter,
                cylinder_diameter_m=rig.cylinder_diameter,
                cylinder_height_m=rig.cylinder_height,
                circular_sectors=rig.circular_sectors,
                radial_sectors=rig.radial_sectors,
            )
            for rig in rigs
        ]
    )


def _material(material: Material) -> MaterialAnswer:
    return MaterialAnswer(
        name=material.name,
        target_deg=material.target_deg,
        window_deg=material.window_deg,
        bulk_density_kg_m3=material.bulk_density,
        particle_density_kg_m3=round(material.particle_density, 3),
        packing_fraction=material.packing_fraction,
        youngs_modulus_pa=material.youngs_modulus,
        poisson_ratio=material.poisson_ratio,
        long_term_damping=material.long_term_damping,
        dynamic_friction_ratio=material.dynamic_friction_ratio,
        wall_restitution=[
            WallRestitutionAnswer(value=mix.value, mass_share=mix.mass_share)
            for mix in material.wall_restitution
        ],
        sizes=[
            SizeClassAnswer(lower_m=size.lower, upper_m=size.upper, mass_share=size.mass_share)
            for size in material.sizes.classes
        ],
        constraints=list(material.constraints),
    )
