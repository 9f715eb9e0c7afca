"""axe-core on a page as it stands: what it calls serious or critical is a fault, contrast (AA) included."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from playwright.sync_api import Page

WORST = ("serious", "critical")


def serious_faults(page: Page) -> list[str]:
    """A line each: the rule, and the elements that break it."""
    from axe_playwright_python.sync_playwright import Axe

    found = Axe().run(page).response["violations"]
    return [
        f"{one['id']}: " + "; ".join(" ".join(map(str, node["target"])) for node in one["nodes"][:5])
        for one in found
        if one["impact"] in WORST
    ]
