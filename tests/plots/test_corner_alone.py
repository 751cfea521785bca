"""corner without ArviZ."""

import subprocess
import sys

_DRAWN = """
import hashlib, sys, warnings
import numpy as np
from matplotlib.figure import Figure
from bayes_toe.plots.corner_alone import corner_alone
from bayes_toe.plots.figure_files import png
{before}
x = np.random.default_rng(1).normal(size=(2000, 2))
def drawn(draw, data):
    return hashlib.sha256(png(draw(data, fig=Figure(figsize=(3, 3)), bins=20), dpi=50)).hexdigest()
ours = drawn(corner_alone(), x)
print("arviz" in sys.modules)
warnings.simplefilter("ignore", FutureWarning)
import corner
print(ours == drawn(corner.corner, x))
print(len(corner.corner({{"a": x[None, :, 0], "b": x[None, :, 1]}}, fig=Figure()).axes), "arviz" in sys.modules)
"""


def _says(before: str) -> list[str]:
    done = subprocess.run([sys.executable, "-c", _DRAWN.format(before=before)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def test_arviz_comes_when_corner_is_given_more_than_an_array():
    assert _says("") == ["False", "True", "4", "True"]


def test_what_is_loaded_already_stays_as_it_is():
    assert _says("warnings.simplefilter('ignore', FutureWarning); import corner") == ["True", "True", "4", "True"]
