"""The pictures that a charge leaves, for its report and its page."""

from __future__ import annotations

from collections.abc import Mapping

# Pictures in the order of the page, with what they show.
PICTURES: Mapping[str, str] = {
    "burden": "The burden from above and from the front, by height (left) and by grain size (right).",
    "charge": "All grains at the end by size, from the front and from the side; green: the jet in closed form.",
    "curves": "By sector, over time, over the belt's height; the belt's section and the jet's spread.",
    "wear": "What the walls bear: energy of the grains that struck them (left), load at the end (right).",
    "plant": "The plant as it was simulated.",
}
