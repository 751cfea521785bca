"""Bayesian inference for time-order effects in comparing two stimuli (arXiv 2604.19662).

Verbs and records are here, figures in `bt.plots`, studies still to be made in `bt.design`, the
equations in `bt.model`. The stub beside each of these files lists its public names; they load on
first use, so that importing the package costs next to nothing.

>>> import bayes_toe as bt
>>> study = bt.example_study()          # or bt.read_study("study.csv")
>>> table = bt.evidence(study.select(["S01"]), seed=1)
>>> table["S01"].log_bayes_factor > 0   # H1 (predictive update) against H0, natural log
True
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
