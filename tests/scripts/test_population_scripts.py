"""The programs behind docs/population_calibration.md: observers answer as they should, ranks are ranks, verdicts can fail."""

import numpy as np
import pandas as pd
import population_calibration as calibration
import population_hard_cases as cases
import pytest

from bayes_toe.groups.hyperprior import Hyperprior
from bayes_toe.model.ladder import PREDICTIVE_UPDATE
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior


def test_answers_are_those_of_the_members():
    """Of four hundred observers alike: frequencies of every pair, within 4.5 standard errors."""
    names, design = [str(i) for i in range(400)], calibration._design()
    eta = np.tile([0.9, 0.3, -1.0, 1.2], (400, 1))
    counts = calibration._answers(PREDICTIVE_UPDATE, names, design, eta, np.random.default_rng(1))
    study = calibration._study(names, design, counts)
    posterior = Posterior(study.subjects[0], PREDICTIVE_UPDATE, Prior())
    q = np.exp(posterior.log_answers(posterior.from_group(eta[:1])[0])[0][0])
    seen = np.mean([one.n_equal for one in study], axis=0) / calibration.TRIALS
    assert np.abs((seen - q) / np.sqrt(q * (1.0 - q) / (400 * calibration.TRIALS))).max() < 4.5


def test_hard_cases_have_answers_of_their_population():
    one = cases.answered(1, 1_000_000, sd=0.0 * cases.SD)[0]
    posterior = Posterior(one, PREDICTIVE_UPDATE, Prior())
    q = np.exp(posterior.log_answers(posterior.from_group(cases.MEAN[None])[0])[0][0])
    assert one.n_equal / 1e6 == pytest.approx(q, abs=3e-3)


@pytest.mark.parametrize("case", [name for name, (make, *_) in cases.CASES.items() if make is not None and "200" not in name])
def test_every_hard_case_is_a_study(case):
    study = cases.CASES[case][0]()
    assert len(study.names) >= 2
    assert Hyperprior().for_study(study).scaled(cases.CASES[case][3])


def test_a_rank_is_a_place_among_draws():
    draws, rng = np.arange(32.0), np.random.default_rng(2)
    ranks = np.array([calibration._rank(draws, 10.5, rng) for _ in range(200)])
    assert 11 / 33 <= ranks.min() < ranks.max() <= 12 / 33
    ties = np.array([calibration._rank(np.zeros(32), 0.0, rng) for _ in range(200)])
    assert 0.0 <= ties.min() < 0.1 < 0.9 < ties.max() <= 1.0


def test_as_many_draws_of_each_chain():
    draws = np.arange(16)[:, None] * 1000 + np.arange(50)
    used = calibration._used(draws)
    assert len(set(used.tolist())) == calibration.USED
    assert set((used // 1000).tolist()) == set(range(16))


def test_verdicts():
    rng, names = np.random.default_rng(3), ["mean of mu1", "sd of mu1", "effect of mu1", "first of mu1", "new of mu1", "log likelihood"]
    table = pd.DataFrame({"subjects": 4, **{name: rng.uniform(size=200) for name in names}})
    assert (calibration.judged(table)["verdict"] == "inside").all()
    table["sd of mu1"] **= 1.6
    found = calibration.judged(table).set_index("quantity")["verdict"]
    assert (found == "outside").tolist() == [name == "sd of mu1" for name in names]
    assert len(calibration.figure(table).axes) == len(names)
