"""What quantities are called on the page: a short symbol and what it is in words."""

from __future__ import annotations

_QUANTITIES = {
    "mu1": ("μ₁", "where the first stimulus is pulled to: the prior's mean"),
    "sigma_p": ("σₚ", "noise that is added between the stimuli"),
    "sigma_l": ("σℓ", "noise of the measurement"),
    "q0": ("q₀", "P(equal) at the peak"),
    "gamma": ("γ", "σℓ²/σₚ²"),
    "sigma1": ("σ₁", "spread of the prior"),
    "gain": ("gain K", "weight of the first stimulus; 1: no pull"),
    "width": ("width w", "distance at which P(equal) has halved"),
    "offset": ("offset c", "constant part of the order effect"),
    "pull": ("pull p", "share by which the first stimulus is pulled; 0: none"),
    "rho": ("ρ", "what is kept of a memory"),
    "noise_slope": ("slope b", "how noise departs from Weber's law"),
    "lapse_rate": ("lapse λ", "share of answers that are guesses"),
    "exponent": ("exponent ν", "shape of the curve; 2: the bell"),
    "icc": ("ICC", "correlation of answers to one pair"),
}


def symbol(name: str) -> str:
    """What an axis is called.

    Examples
    --------
    >>> symbol("mu1"), symbol("q_13")
    ('μ₁', 'q_13')
    """
    return _QUANTITIES.get(name, (name, ""))[0]


def meaning(name: str) -> str:
    """In words; of a free frequency, which it is."""
    if name.startswith("q_"):
        return f"P(equal) of pair {name[2:]}"
    return _QUANTITIES.get(name, (name, ""))[1]
