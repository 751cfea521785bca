"""The default prior: scales from the stimuli, densities, independence of units."""

import numpy as np
import pytest
from conftest import BOTH_TASKS, five_pairs, made_subject, refused
from numpy.random import default_rng

import bayes_toe as bt
from bayes_toe.model.parameters import SCALES
from bayes_toe.model.prior import DEFAULT
from bayes_toe.model.prior_file import preset_or_file, prior_for

STUDY = bt.Study([five_pairs(name="A"), five_pairs(name="B")])


def test_a_subject_without_different_stimuli_has_no_default_prior():
    """Subject L has a single pair of equal stimuli. The paper's prior needs no scale of stimuli."""
    study = bt.Study([five_pairs(), made_subject("0.4 0.4 1 2", "L")])
    message = "^subject 'L': the prior takes its scale from pairs of different stimuli, found none"
    with refused(f"{message}; .*--prior p"):
        prior_for(study)

    posterior = bt.model.paper_posterior(study["L"], prior_for(study, "paper"))
    assert np.isfinite(posterior.log_density([[0.1, 0.0, 0.0, 0.0]])).all()

    posterior = bt.model.observer_posterior(study["L"], model="constant-error")
    message = "subject 'L': no pair has two different stimuli, so no order effect can be seen"
    with refused(message):
        posterior.log_density(np.zeros((1, 6)))


@pytest.mark.parametrize("factor, shift", [(3.0, 2.0), (1.0, 6.0), (0.25, -3.0)])
@BOTH_TASKS
def test_the_unit_of_intensity_changes_nothing(task, factor, shift):
    # Stimuli are multiplied by the factor and moved. The prior is the default, which does the same.
    expected = bt.model.paper_posterior(five_pairs(task))
    changed = bt.model.paper_posterior(five_pairs(task, factor=factor, shift=shift))
    x = default_rng(5).normal(size=(30, 4)) * 0.5
    assert changed.log_likelihood(x) == pytest.approx(expected.log_likelihood(x), rel=1e-9)
    assert changed.log_density(x) == pytest.approx(expected.log_density(x), rel=1e-9)


def test_presets_are_named():
    for preset in (None, "default"):
        assert preset_or_file(preset) == prior_for(STUDY, preset) == DEFAULT
    assert prior_for(STUDY, "paper") == prior_for(STUDY, bt.Prior()) == bt.Prior()


def test_a_prior_is_described_with_its_scales():
    prior = prior_for(STUDY, bt.Prior(mu1_mean="stimuli", mu1_sd=3.0))
    assert prior.describe() == (
        "mu1 ~ Normal(M, 3), sigma_p ~ HalfNormal(1), gamma ~ Uniform(0, 1), q0 ~ Uniform(0, 1); "
        f"M is the mean of the stimuli, {SCALES}"
    )


def test_a_path_is_a_file_even_if_it_ends_with_the_name_of_a_preset(tmp_path):
    path = tmp_path / "default"
    path.write_text("[paper]\nsigma_p_scale = 0.5")
    assert preset_or_file(str(path)) == bt.Prior(sigma_p_scale=0.5)
