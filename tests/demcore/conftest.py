"""Small beds in many slabs, as large ones are: what happens between slabs and threads needs few grains then."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from demcore import neighbours


@pytest.fixture(scope="session", autouse=True)
def thin_slabs() -> Iterator[None]:
    """For all tests of this folder alike, fixtures of modules included."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(neighbours, "LEAST_IN_SLAB", 1)
        yield
