"""The verb: what it promises of seeds, workers and the order of subjects."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import few_pairs
from populations import made_population

import bayes_toe as bt
from bayes_toe.classical.frequencies import accuracy
from bayes_toe.data.tasks import WHICH_STRONGER
from bayes_toe.errors import InputError
from bayes_toe.groups import chains
from bayes_toe.groups.chains import Hamiltonian
from bayes_toe.groups.hyperprior import Hyperprior
from bayes_toe.groups.population import population
from bayes_toe.groups.predictive_check import predictive_check
from bayes_toe.groups.subjects import unpooled_from_draws
from bayes_toe.inference.diagnostics import errors, worst
from bayes_toe.records import packed

pytestmark = pytest.mark.filterwarnings("ignore::bayes_toe.errors.ConvergenceWarning")

STUDY = few_pairs(["A", "B", "C"])
#: Close to what such a study tells, so that few draws do.
HYPERPRIOR = (
    Hyperprior()
    .for_study(STUDY)
    .changed(
        {
            "mu1": {"mean_sd": 0.5, "sd_scale": 0.3},
            "gamma": {"sd_scale": 0.3},
            "width": {"sd_scale": 0.3},
            "q0": {"sd_scale": 0.3},
        }
    )
)


@pytest.fixture(scope="module")
def run():
    """A run that is short however the chains mix: what is asked here does not need more."""

    def short(study=STUDY, **more):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(chains, "LIMIT", 1)
            patch.setattr(chains, "MOST", 8)
            patch.setattr(Hamiltonian.warm_up, "__defaults__", ((20, 30),))
            common = {
                "model": "predictive update",
                "draws": 40,
                "seed": 1,
                "hyperprior": HYPERPRIOR,
                "workers": 1,
            }
            return population(study, **common | more)

    return short


@pytest.fixture(scope="module")
def found(run):
    return run()


@pytest.fixture(scope="module")
def stored():
    """Under another prior, which does not enter the joint posterior."""
    return bt.sample(STUDY, draws=1000, seed=1, prior="paper", workers=1)


def require_alike(one, other, same):
    """Means, scatters and subjects (place in one, place in the other): 24 z scores, false alarms once in 1500 runs."""
    values = [
        (getattr(one.chains, name), getattr(other.chains, name)) for name in ("mean", "scatter")
    ]
    values += [(one.chains.eta[:, :, i], other.chains.eta[:, :, j]) for i, j in same]
    for a, b in ((a[..., k], b[..., k]) for a, b in values for k in range(4)):
        assert abs(a.mean() - b.mean()) < 4.2 * np.hypot(errors(a).mean, errors(b).mean)


def test_the_number_of_workers_changes_no_bit(found, run):
    other = run(workers=2)
    for name in ("mean", "scatter", "eta"):
        assert (getattr(found.chains, name) == getattr(other.chains, name)).all()
    assert (found.unpooled == other.unpooled).all()


def test_the_order_of_subjects_changes_what_chance_may_change(found, run):
    require_alike(found, run(STUDY.select(["C", "A", "B"])), [(0, 1), (2, 0)])


def test_the_stated_diagnostics_are_those_of_the_draws(found):
    own = found.chains
    (_, lowest), (_, highest) = worst(own.named(found.names, found.study.names))
    assert found.converged == (lowest >= 40 and highest < 1.01)
    assert set(own.convergence) == {
        (quantity, -1, j) for quantity in ("mean", "sd") for j in range(4)
    }
    assert own.mean.shape[0] == 16
    assert (own.scatter > 0.0).all()


def test_parameters_may_be_correlated_in_large_groups(found, run, stored, monkeypatch):
    assert not found.settings.correlations
    monkeypatch.setattr("bayes_toe.groups.population.MANY", 3)
    fewest = min(one.total_trials for one in STUDY)
    monkeypatch.setattr("bayes_toe.groups.population.LONG", fewest)
    own = run(posterior=stored)
    assert own.settings.correlations
    assert {key for key in own.chains.convergence if key[0] == "correlation"} == {
        ("correlation", j, i) for i in range(4) for j in range(i)
    }
    assert np.linalg.eigvalsh(own.chains.correlation).min() > 0.0
    assert own.chains.z.std() > 0.1
    monkeypatch.setattr("bayes_toe.groups.population.LONG", fewest + 1)
    monkeypatch.setattr(
        "bayes_toe.groups.population.sample_group",
        lambda joint, *_: found.chains if not joint.correlated else None,
    )
    assert not run(posterior=stored).settings.correlations


@pytest.mark.parametrize(
    ("model", "names"), [("free weighting", ("offset", "gain")), ("update", ("mu1", "gamma"))]
)
def test_which_is_stronger(run, model, names, tmp_path):
    """Four subjects with a pull of a quarter, whose means are known by their own answers, not by the hyperprior."""
    eta = np.array([0.1, -0.32, -1.2, -1.8]) + 0.05 * np.random.default_rng(3).standard_normal(
        (4, 4)
    )
    study = made_population(eta, model="free weighting", task=WHICH_STRONGER).study
    found = run(study, model=model, hyperprior=None, draws=60)
    assert found.names == (*names, "width", "lapse_rate")
    low, high = np.quantile(found.quantities(found.chains.mean)["pull"], (0.005, 0.995))
    assert low < 0.25 < high < 0.5
    weighed = {
        row.parameter: row.bf_zero for row in found.table.some("mean") if row.bf_zero is not None
    }
    assert set(weighed) == (
        {"order effect", "pull", "constant error"} if model == "free weighting" else set()
    )
    assert min(weighed.values(), default=0.0) < 0.3
    again = bt.load(found.save(tmp_path / "population.nc"))
    assert (packed(again), again.study.task) == (packed(found), WHICH_STRONGER)
    check = predictive_check(found, groups=100)
    assert [one.of for one in check.statistics[-2:]] == ["share of 'second'"] * 2
    assert check.statistics[2].observed == pytest.approx(
        np.std([accuracy(one) for one in study], ddof=1)
    )


def test_a_subject_that_is_known_badly_alone_is_named(run, stored, monkeypatch):
    def doubted(subject, model, prior, centre, draws, seed):
        return replace(
            unpooled_from_draws(stored, subject.name, model, centre, seed),
            trusted=subject.name != "B",
        )

    monkeypatch.setattr("bayes_toe.groups.population.unpooled", doubted)
    found = run()
    assert found.rough == ("B",)
    assert (
        found.shortfalls[0]
        == "subject 'B' alone: few of the draws count, so that its columns alone_ are rough"
    )


# --- draws that are there already ---------------------------------------------------------------------------------------------------


def test_stored_draws_stand_in_the_place_of_subjects_alone(found, run, stored, monkeypatch):
    monkeypatch.setattr(
        "bayes_toe.groups.population.unpooled",
        lambda *_: pytest.fail("a subject was sampled alone"),
    )
    other = run(posterior=stored, seed=None)
    assert (other.settings.seed, other.settings.prior, other.rough) == (1, stored.prior, ())
    require_alike(found, other, [(0, 0), (1, 1)])
    mine = stored.values("B", "mu1")
    assert other.unpooled.shape == found.unpooled.shape
    assert abs(np.median(other.unpooled[:, 1, 0]) - np.median(mine)) < 0.1 * mine.std()
    assert set(other.unpooled[:, 1, 3]) <= set(
        other.posterior("B").to_group(stored.points("B").reshape(-1, 4))[:, 3]
    )


def test_of_draws_of_another_model_seed_and_prior_are_taken(run, stored):
    """That of `run` is the paper's, which has no place for none."""
    other = run(posterior=stored, seed=None, model="free weighting")
    assert (other.names, other.settings.seed, other.settings.prior) == (
        ("offset", "gain", "width", "q0"),
        1,
        stored.prior,
    )


@pytest.mark.parametrize(
    ("what", "said"),
    [
        (
            {"study": few_pairs(["A", "B"])},
            "posterior: found draws of subject 'C', whom .* does not have",
        ),
        (
            {"prior": bt.Prior(mu1_sd=1.0)},
            "posterior: found draws under .*; allowed: that prior, or none, given",
        ),
    ],
)
def test_stored_draws_of_something_else_are_refused(run, stored, what, said):
    with pytest.raises(InputError, match=said):
        run(posterior=stored, **what)
