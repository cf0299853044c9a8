"""Pages and their figures are tested with the layout that a user sees."""

import pytest

from shockrig.files import figures


@pytest.fixture(scope="module", autouse=True)
def figures_with_layout():
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(figures.RC, "figure.constrained_layout.use", True)
        yield
