"""The verb: what it promises of seeds, workers and the order of subjects."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import few_pairs

import bayes_toe as bt
from bayes_toe.errors import InputError
from bayes_toe.groups import chains
from bayes_toe.groups.chains import Hamiltonian
from bayes_toe.groups.hyperprior import Hyperprior
from bayes_toe.groups.population import population
from bayes_toe.groups.subjects import unpooled
from bayes_toe.inference.diagnostics import errors, worst

pytestmark = pytest.mark.filterwarnings("ignore::bayes_toe.errors.ConvergenceWarning")

STUDY = few_pairs(["A", "B", "C"])
#: Close to what such a study tells, so that few draws do.
HYPERPRIOR = (
    Hyperprior()
    .for_study(STUDY)
    .changed({"mu1": {"mean_sd": 0.5, "sd_scale": 0.3}, "gamma": {"sd_scale": 0.3}, "width": {"sd_scale": 0.3}, "q0": {"sd_scale": 0.3}})
)


@pytest.fixture(scope="module")
def run():
    """A run that is short however the chains mix: what is asked here does not need more."""

    def short(study=STUDY, **more):
        return population(study, **{"model": "predictive update", "draws": 40, "seed": 1, "hyperprior": HYPERPRIOR, "workers": 1, **more})

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(chains, "LIMIT", 1)
        patch.setattr(chains, "MOST", 8)
        patch.setattr(Hamiltonian.warm_up, "__defaults__", ((20, 30),))
        yield short


@pytest.fixture(scope="module")
def found(run):
    return run()


def test_the_number_of_workers_changes_no_bit(found, run):
    other = run(workers=2)
    for name in ("mean", "scatter", "eta"):
        assert (getattr(found.chains, name) == getattr(other.chains, name)).all()
    assert (found.unpooled == other.unpooled).all()


def test_the_order_of_subjects_changes_what_chance_may_change(found, run):
    """16 z scores: false alarms once in 2000 runs."""
    other = run(STUDY.select(["C", "A", "B"]))
    pairs = [(getattr(found.chains, name)[..., j], getattr(other.chains, name)[..., j]) for name in ("mean", "scatter") for j in range(4)]
    pairs += [(found.chains.eta[:, :, 0, j], other.chains.eta[:, :, 1, j]) for j in range(4)]
    for one, two in pairs:
        assert abs(one.mean() - two.mean()) < 4.2 * np.hypot(errors(one).mean, errors(two).mean)


def test_the_stated_diagnostics_are_those_of_the_draws(found):
    own = found.chains
    (_, lowest), (_, highest) = worst(own.named(found.names, found.study.names))
    assert found.converged == (lowest >= 40 and highest < 1.01)
    assert set(own.convergence) == {(quantity, -1, j) for quantity in ("mean", "sd") for j in range(4)}
    assert own.mean.shape[0] == 16
    assert (own.scatter > 0.0).all()


def test_parameters_may_be_correlated_in_large_groups(found, run, monkeypatch):
    assert not found.settings.correlations
    monkeypatch.setattr("bayes_toe.groups.population.MANY", 3)
    fewest = min(one.total_trials for one in STUDY)
    monkeypatch.setattr("bayes_toe.groups.population.LONG", fewest)
    own = run()
    assert own.settings.correlations
    assert {key for key in own.chains.convergence if key[0] == "correlation"} == {("correlation", j, i) for i in range(4) for j in range(i)}
    assert np.linalg.eigvalsh(own.chains.correlation).min() > 0.0
    assert own.chains.z.std() > 0.1
    monkeypatch.setattr("bayes_toe.groups.population.LONG", fewest + 1)
    assert not run().settings.correlations


def test_a_subject_that_is_known_badly_alone_is_named(run, monkeypatch):
    def doubted(subject, *rest):
        return replace(unpooled(subject, *rest), trusted=subject.name != "B")

    monkeypatch.setattr("bayes_toe.groups.population.unpooled", doubted)
    found = run()
    assert found.rough == ("B",)
    assert found.shortfalls[0] == "subject 'B' alone: few of the draws count, so that its columns alone_ are rough"


# --- draws that are there already ---------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def stored():
    return bt.sample(STUDY, draws=1000, seed=1, workers=1)


def test_stored_draws_stand_in_the_place_of_subjects_alone(found, run, stored, monkeypatch):
    """24 z scores: false alarms once in 1500 runs."""

    def sampled(*_):
        raise AssertionError("a subject was sampled alone")

    monkeypatch.setattr("bayes_toe.groups.population.unpooled", sampled)
    other = run(posterior=stored, seed=None)
    assert (other.settings.seed, other.settings.prior, other.rough) == (1, stored.prior, ())
    pairs = [(getattr(found.chains, name)[..., j], getattr(other.chains, name)[..., j]) for name in ("mean", "scatter") for j in range(4)]
    pairs += [(found.chains.eta[:, :, i, j], other.chains.eta[:, :, i, j]) for i in range(2) for j in range(4)]
    for one, two in pairs:
        assert abs(one.mean() - two.mean()) < 4.2 * np.hypot(errors(one).mean, errors(two).mean)
    mine = stored.values("B", "mu1")
    assert other.unpooled.shape == found.unpooled.shape
    assert abs(np.median(other.unpooled[:, 1, 0]) - np.median(mine)) < 0.1 * mine.std()
    assert set(other.unpooled[:, 1, 3]) <= set(other.posterior("B").to_group(stored.points("B").reshape(-1, 4))[:, 3])


def test_of_draws_of_another_model_seed_and_prior_are_taken(run, stored):
    """That of `run` is the paper's, which has no place for none."""
    other = run(posterior=stored, seed=None, model="free weighting")
    assert (other.names, other.settings.seed, other.settings.prior) == (("offset", "gain", "width", "q0"), 1, stored.prior)
    assert (other.unpooled == run(model="free weighting", prior=stored.prior).unpooled).all()


def test_stored_draws_of_something_else_are_refused(run, stored):
    for what, said in (
        ({"study": few_pairs(["A", "B"])}, "posterior: found draws of subject 'C', whom .* does not have"),
        ({"prior": bt.Prior(mu1_sd=1.0)}, "posterior: found draws under .*; allowed: that prior, or none, given"),
    ):
        with pytest.raises(InputError, match=said):
            run(posterior=stored, **what)
