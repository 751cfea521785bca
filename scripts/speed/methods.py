"""Every method of the race, in the order of its tables. None is ever left out because its row looks bad."""

from __future__ import annotations

from speed import ensembles, global_move, laplace, nested, numpyro_models, pymc_models
from speed.method import IDENTIFIED, NATURAL, Method

GLOBAL = "global move"
MANY = f"emcee stretch, {ensembles.MANY_WALKERS} walkers"
STRETCH, NUTPIE, NUMPYRO, NUMPYRO_JIT = "emcee stretch", "nutpie NUTS", "NumPyro NUTS", "NumPyro NUTS in one jit"

METHODS = (
    Method("Laplace", NATURAL, "draws", (20_000,), 3, laplace.prepare_natural),
    Method("Laplace", IDENTIFIED, "draws", (20_000,), 3, laplace.prepare_identified),
    Method(STRETCH, NATURAL, "steps", (1000,), 4, ensembles.natural(ensembles.default_moves)),
    Method(MANY, NATURAL, "steps", (1000,), 4, ensembles.natural(ensembles.default_moves, ensembles.MANY_WALKERS)),
    Method(STRETCH, IDENTIFIED, "steps", (200, 800), 4, ensembles.identified(ensembles.default_moves)),
    Method("emcee DE + stretch", IDENTIFIED, "steps", (200, 800), 4, ensembles.identified(ensembles.differential_moves)),
    Method(GLOBAL, IDENTIFIED, "effective draws", (4000, 10_000, 40_000), 6, global_move.prepare_global),
    Method("importance sampling", IDENTIFIED, "draws", (5000, 20_000, 80_000), 12, global_move.prepare_importance),
    Method(NUTPIE, NATURAL, "draws a chain", (1000, 4000, 16_000), 6, pymc_models.prepare_natural, "nutpie"),
    Method(NUTPIE, IDENTIFIED, "draws a chain", (1000, 4000, 16_000), 6, pymc_models.prepare_identified, "nutpie"),
    Method(NUMPYRO, NATURAL, "draws a chain", (1000,), 3, numpyro_models.prepare_natural(numpyro_models.called), "numpyro"),
    Method(NUMPYRO, IDENTIFIED, "draws a chain", (1000,), 3, numpyro_models.prepare_identified(numpyro_models.called), "numpyro"),
    Method(NUMPYRO_JIT, NATURAL, "draws a chain", (4000,), 6, numpyro_models.prepare_natural(numpyro_models.jitted), "numpyro"),
    Method(NUMPYRO_JIT, IDENTIFIED, "draws a chain", (4000,), 6, numpyro_models.prepare_identified(numpyro_models.jitted), "numpyro"),
    Method("dynesty", NATURAL, "live points", (500,), 3, nested.dynesty_with(nested.natural_cube), "dynesty"),
    Method("dynesty", IDENTIFIED, "live points", (500,), 3, nested.dynesty_with(nested.identified_cube), "dynesty"),
    Method("nautilus", NATURAL, "effective draws", (4000,), 1, nested.nautilus_with(nested.natural_cube), "nautilus"),
    Method("nautilus", IDENTIFIED, "effective draws", (4000,), 1, nested.nautilus_with(nested.identified_cube), "nautilus"),
)
