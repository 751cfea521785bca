"""The models of the observer, their parameters and priors.

The stub beside this file lists its public names, which load on first use.

Examples
--------
>>> import bayes_toe as bt
>>> float(bt.model.gain(2.0))
0.5
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
