"""Planning of studies: pairs, power, lists of trials, the next pair, simulated studies.

The stub beside this file lists its public names, which load on first use.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
