"""The population of a real study."""

import pytest

import bayes_toe as bt
from bayes_toe.groups.population import population


def test_the_real_vibrotactile_subjects_hardly_pull(real_data):
    """Worked out with other code and a somewhat narrower hyperprior: probit gamma -1.65 (-2.26, -1.21), a pull of about 0.05."""
    study = bt.read_study(real_data / "vibrotactile_rate" / "trials.csv", bt.ReadOptions(equal_code="1"))
    found = population(study, model="predictive update", seed=1, draws=100, workers=1)
    assert found.converged
    gamma, pull = (found.table.some("mean", name)[0] for name in ("probit gamma", "pull"))
    assert gamma.q50 == pytest.approx(-1.65, abs=0.3)
    assert gamma.q05 < -1.9 < -1.5 < gamma.q95
    assert 0.02 < pull.q50 < 0.07
