"""Temporary: the levels' posterior; see branch compareparts."""

import numpy as np
from scipy.special import logsumexp

from bayes_toe.comparison.exact_random_effects import exact_random_effects


def levels_of(records):
    by = {}
    for m in records:
        for part, level in m.levels:
            by.setdefault(part, {})[level] = None
    return [(p, l) for p, ls in by.items() if len(ls) > 1 for l in ls]


def level_probabilities(values, records):
    if np.isnan(values).any():
        return {}
    w = np.exp(values - logsumexp(values))
    return {(p, l): float(sum(x for x, m in zip(w, records) if (p, l) in m.levels)) for p, l in levels_of(records)}


def study_probabilities(values, records):
    out = {}
    ok = values[~np.isnan(values).any(axis=1)]
    if not len(ok):
        return {}
    for part in dict.fromkeys(p for p, _ in levels_of(records)):
        lv = [l for p, l in levels_of(records) if p == part]
        fam = np.stack(
            [
                logsumexp(ok[:, [(part, l) in m.levels for m in records]], axis=1) - np.log(sum((part, l) in m.levels for m in records))
                for l in lv
            ],
            axis=1,
        )
        out |= {(part, l): float(v) for l, v in zip(lv, exact_random_effects(fam).expected)}
    return out
