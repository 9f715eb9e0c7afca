"""Small cases for the tests: grains of 8 to 16 mm in a tube of 50 mm radius on a plane."""

from __future__ import annotations

from dataclasses import replace

from demcore.case import Case
from demcore.charge import Feed, Fill
from demcore.geometry.walls import Wall
from demcore.interaction import GrainContact, Interaction, Interactions, Stiffness, Surface, WallContact
from demcore.material import Material, MixPart, SizeClass, SizeDistribution, WallRestitution
from demcore.region import DiscInlet, cylinder

# Soft, so that a step is long and a test short.
SOFT = Stiffness(1e6, 0.25)
GRAVEL = Material(
    name="gravel",
    bulk_density=1500.0,
    packing_fraction=0.6,
    youngs_modulus=SOFT.youngs_modulus,
    poisson_ratio=0.25,
    long_term_damping=0.5,
    dynamic_friction_ratio=0.9,
    wall_restitution=(WallRestitution(0.2, 0.25), WallRestitution(0.5, 0.75)),
    sizes=SizeDistribution((SizeClass(0.008, 0.016, 1.0),)),
)
SAND = replace(
    GRAVEL,
    name="sand",
    bulk_density=1600.0,
    grain_density=2600.0,
    wall_restitution=(WallRestitution(0.3),),
    sizes=SizeDistribution((SizeClass(0.006, 0.010, 1.0),)),
)
SAME = Interaction(0.3, 0.5, 0.45, 0.2)
OTHER = Interaction(0.5, 0.7, 0.55, 0.4)
TUBE = 0.05
WALLS = (Wall("plane"), Wall("cylinder", radius=TUBE, length=10.0))


def interactions(**changes) -> Interactions:
    """Gravel and sand, each with itself and with steel; unlike ones by the rule."""
    given = Interactions(
        (GrainContact("gravel", "gravel", SAME), GrainContact("sand", "sand", OTHER)),
        (WallContact("gravel", "steel", 0.4, 0.36, 0.2), WallContact("sand", "steel", 0.6, 0.5, 0.4)),
        (Surface("steel", SOFT),),
    )
    return replace(given, **changes)


def a_fill(**changes) -> Fill:
    """Half a kilogram of gravel in the tube."""
    given = Fill(cylinder((0.0, 0.0, 0.0), TUBE, 0.6), (MixPart("gravel"),), mass=0.5)
    return replace(given, **changes)


def a_feed(**changes) -> Feed:
    """A kilogram a second of both, through a disc above the tube's floor, for 0.4 s."""
    given = Feed(
        DiscInlet((0.0, 0.0, 0.4), 0.04),
        (MixPart("gravel", 0.65), MixPart("sand", 0.35)),
        rate=1.0,
        stop=0.4,
        velocity=(0.0, 0.0, -1.0),
    )
    return replace(given, **changes)


def a_case(**changes) -> Case:
    """A fill of gravel that comes to rest."""
    given = Case((GRAVEL, SAND), interactions(), 3.0, walls=WALLS, fills=(a_fill(),), seed=4)
    return replace(given, **changes)
