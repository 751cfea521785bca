"""Figures; the only room that imports matplotlib and corner.

The stub beside this file lists its public names, which load on first use.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
