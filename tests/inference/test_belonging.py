"""Saved draws are refused where they belong to another study, prior, seed or model; and tell the study that they are of."""

from dataclasses import replace

import numpy as np
import pytest

import bayes_toe as bt
from bayes_toe.analysis import smooth_curve_evidence
from bayes_toe.inference.belonging import require_belonging


def test_draws_tell_their_study(analysis, small_study):
    require_belonging(analysis.draws, "draws", study=small_study, prior=bt.Prior(), seed=5, model="predictive update")
    again = analysis.draws.study
    assert (again.names, again.source, again.synthetic) == (small_study.names, small_study.source, small_study.synthetic)
    require_belonging(analysis.draws, "draws", study=again.select(["C", "A", "B"]))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda one: replace(one, n_yes=np.minimum(one.n_yes + 1, one.n_trials)), "found draws of subject 'B' from other answers"),
        (lambda one: replace(one, name="X"), "found no draws of subject 'X'"),
        (lambda one: None, "found draws of subject 'B', whom three kinds does not have"),
        (lambda one: replace(one, isi=np.ones(one.n_pairs)), "found draws of subject 'B' from other answers"),
    ],
    ids=["counts", "name", "absent", "intervals"],
)
def test_another_study_is_refused(analysis, small_study, change, said):
    others = [small_study["A"], change(small_study["B"]), small_study["C"]]
    if others[1] is not None and others[1].isi is not None:
        others = [replace(one, isi=np.ones(one.n_pairs)) for one in others]
        said = said.replace("'B'", "'A', 'B', 'C'")
    study = bt.Study([one for one in others if one is not None], source="three kinds")
    with pytest.raises(bt.InputError, match=r"^file: ") as refused:
        require_belonging(analysis.draws, "file", study=study)
    assert said in str(refused.value)


def test_another_model_is_refused_for_figures(small_study):
    draws = bt.sample(small_study.select(["A"]), model="constant bias", draws=100, seed=1, workers=1)
    with pytest.raises(bt.InputError, match=r"^the paper's figures: found draws of the model 'constant bias'"):
        bt.plots.figures(draws)


def test_evidence_of_saved_draws_is_that_of_the_run(analysis):
    found = smooth_curve_evidence(analysis.draws, workers=1)
    assert [row.log_evidence_h1 for row in found] == [row.log_evidence_h1 for row in analysis.evidence]
