"""A look at the answers before they are pooled, and at what a file may have meant otherwise."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from bayes_toe.data.answers import Reading
from bayes_toe.data.findings import Finding, answer_findings
from bayes_toe.data.messages import bare, listed
from bayes_toe.data.options import LOOKED_AT, looks_like
from bayes_toe.data.study import Study, require_study
from bayes_toe.experiments.checks import check_study
from bayes_toe.model.prior import Prior
from bayes_toe.model.study_prior import preset_or_file

#: Natural-log intensities beyond which stimuli look raw.
LARGEST_LOG = 5.0
#: Codes of findings that are no warnings.
NOTES = frozenset({"columns_ignored"})

_Rule = Iterable[tuple[str, str]]


def check(study: Study, prior: Prior | str | None = None) -> tuple[Finding, ...]:
    """What a study cannot tell, and what speaks against pooling its answers: :func:`check_study`, then :func:`check_answers`.

    Examples
    --------
    >>> from bayes_toe.data.study import Subject
    >>> [finding.code for finding in check(Study([Subject("S01", [20, 80], [80, 20], [90, 20], [99, 99])]))]
    ['few_pairs', 'no_equal_pairs', 'design_rank', 'raw_stimuli']
    """
    given = prior if prior is None or isinstance(prior, Prior) else preset_or_file(prior)
    return (*check_study(study, given), *check_answers(study, given))


def check_answers(study: Study, prior: Prior | None = None) -> tuple[Finding, ...]:
    """What speaks against pooling the answers of a study as they were read, of the file first, then of each subject.

    One without single answers is looked at by its counts; a prior says where it expects the stimuli to lie.
    """
    require_study(study)
    file = (*_raw(study), *(() if prior is None else _far(study, prior)), *_columns(study.reading))
    of_subjects = (
        one for one in answer_findings(study) if one.code != "one_order"
    )  # which check_study says pair by pair
    return (*(Finding("", code, message) for code, message in file), *of_subjects)


def _raw(study: Study) -> _Rule:
    stimuli = np.concatenate([values for subject in study for values in (subject.s1, subject.s2)])
    low, high = float(stimuli.min()), float(stimuli.max())
    if "i1" not in study.reading.read and (high - low > LARGEST_LOG or low > LARGEST_LOG):
        yield (
            "raw_stimuli",
            f"Stimuli from {low:.4g} to {high:.4g} are read as natural logs, e^{low:.4g} to e^{high:.4g} in intensity: if they "
            "are raw, did you mean --intensity REF, with --columns i1=NAME,i2=NAME?",
        )


def _far(study: Study, prior: Prior) -> _Rule:
    if prior.of_stimuli("mu1"):
        return
    mu1 = prior.distribution("mu1")
    low, high = (float(mu1.quantile(p)) for p in (0.05, 0.95))
    centre = float(
        np.mean(
            [
                np.average((subject.s1 + subject.s2) / 2, weights=subject.n_trials)
                for subject in study
            ]
        )
    )
    if not low <= centre <= high:
        yield (
            "far_from_prior",
            f"The stimuli's mean {centre:.4g} lies outside {low:.4g} to {high:.4g}, where the prior has mu1 with probability 0.9 "
            f"({mu1.describe()}): give the prior another centre, or the stimuli another reference.",
        )


def _columns(reading: Reading) -> _Rule:
    for ours in ("isi", *LOOKED_AT):
        alike = [
            name for name in reading.ignored if ours not in reading.read and looks_like(name, ours)
        ]
        unit = " (seconds)" if ours == "isi" else ""
        if alike:
            yield (
                "column_alike",
                f"Column {bare(alike[0])} looks like {ours}{unit}: use --columns {ours}={bare(alike[0])}, or it is ignored.",
            )
    if reading.ignored:
        yield (
            "columns_ignored",
            f"Columns ignored: {listed([bare(name) for name in reading.ignored])}.",
        )
