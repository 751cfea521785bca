"""H0: one free frequency per pair, with a uniform prior; its evidence is known in closed form."""

from __future__ import annotations

from scipy.special import betaln

from bayes_toe.data.study import Subject


def frequency_evidence(subject: Subject) -> float:
    """Exact log evidence of H0, nats: the sum of ln B(n_yes + 1, n_no + 1) over the pairs."""
    n_no = subject.n_trials - subject.n_yes
    return float(betaln(subject.n_yes + 1.0, n_no + 1.0).sum())
