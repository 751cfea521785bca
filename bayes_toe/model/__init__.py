"""What is assumed of the observer. The stub beside this file lists its public names, which load on first use.

`EQUATIONS` is the index: from the label of an equation of the paper to the function that computes it.

>>> import bayes_toe as bt
>>> bt.model.EQUATIONS["mod:q"] is bt.model.equal_probability
True
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
