from .contrast import contrast as contrast
from .corner import corner as corner
from .curves import curves as curves
from .figure_files import save_figure as save_figure
from .order_effect import order_effect as order_effect
from .population import population as population
from .power import power as power
from .serial import serial as serial
