"""Figures. No other subpackage imports matplotlib or corner.

`__init__.pyi` lists the public names; they load on first use.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
