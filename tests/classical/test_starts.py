"""The few starts of a fit lead where many starts on a coarse grid do."""

import numpy as np
import pytest
from reference.hard_cases import hard_cases

import bayes_toe as bt
from bayes_toe.classical.bootstrap import resample
from bayes_toe.classical.maximum_likelihood import fit_counts, fit_subject
from bayes_toe.classical.penalised_likelihood import Counts, Design, first_starts, replicate_starts
from bayes_toe.model.prior import Prior

SUBJECTS = {**hard_cases(), **{subject.name: subject for subject in bt.example_study()}}
ROWS = 100
NAMES = ["S07", "S08", "S12", "S16", "very blunt observer", "perfect observer", "one batch", "one order missing", "reversed answers"]


def many_starts(design, counts):
    """Offsets, pulls and widths on a grid, and the edge gamma = 0: shape (4, rows, 96)."""
    scale = design.scale
    offsets, pulls, widths = scale * np.array([-2.0, -0.5, 0.0, 0.5, 2.0]), np.log([0.03, 0.3, 0.95]), np.log(scale) + np.arange(-2.0, 4.0)
    inside = np.stack([axis.ravel() for axis in np.meshgrid(offsets, pulls, widths)])
    grid = np.concatenate([inside, np.stack([np.zeros(6), np.full(6, -np.inf), widths])], axis=1)
    top = np.log(((counts.equal + 1) / (counts.equal + counts.different + 2)).max(axis=1))
    return np.stack([*np.broadcast_arrays(*grid[:, None, :], top[:, None])])


@pytest.fixture(scope="module", params=NAMES)
def case(request):
    """A design, replicates of a subject, its own fit, and the best values that many starts lead to."""
    subject = SUBJECTS[request.param]
    design, counts = Design.of(subject, Prior()), Counts.of(resample(subject, np.random.default_rng(2), ROWS), subject.n_trials)
    return design, counts, fit_subject(subject), fit_counts(design, counts, many_starts(design, counts)).objective


def test_starts_of_a_fit_lead_as_high_as_many(case):
    design, counts, _, best = case
    assert (fit_counts(design, counts, first_starts(design, counts)).objective >= best - 1e-8).all()


def test_starts_of_a_replicate_lead_as_high_as_many(case):
    design, counts, own, best = case
    assert (fit_counts(design, counts, replicate_starts(design, own.identified[0], counts)).objective < best - 1e-8).sum() <= 1
