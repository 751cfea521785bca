"""What commands draw costs as much as what they simulate."""

import pytest

from bayes_toe.plots.style import new_figure


@pytest.fixture
def blank_figure(monkeypatch):
    """The figure of power has no panels: for what stands beside it."""
    monkeypatch.setattr("bayes_toe.plots.power_figure", lambda *_: new_figure(1.0, 1.0))
