"""Second-order forward differentiation on mpmath numbers: an independent route to gradients and Hessians."""

import mpmath

NONE = mpmath.mpf(0)


def times(v, w):
    """Their product: many slopes are 0, and a product of so many digits takes time."""
    return v * w if v and w else NONE


class Jet:
    """A number with its gradient and Hessian (row by row) in a few coordinates; arithmetic follows the product and chain rules."""

    def __init__(self, value, slope, bend):
        self.value, self.slope, self.bend = mpmath.mpf(value), slope, bend

    @classmethod
    def coordinates(cls, values):
        n = len(values)
        return [cls(v, [mpmath.mpf(i == j) for j in range(n)], [NONE] * n**2) for i, v in enumerate(values)]

    def _squares(self, entry):
        """All entries of a symmetric matrix from those above its diagonal."""
        n = range(len(self.slope))
        above = {(i, j): entry(i, j, i * len(n) + j) for i in n for j in n[i:]}
        return [above[min(i, j), max(i, j)] for i in n for j in n]

    def _chain(self, value, first, second):
        a, bend, curved = self.slope, self.bend, [times(second, v) for v in self.slope]
        return Jet(value, [times(first, v) for v in a], self._squares(lambda i, j, at: times(first, bend[at]) + times(curved[i], a[j])))

    def _scaled(self, factor):
        return Jet(
            factor * self.value, [times(factor, v) for v in self.slope], self._squares(lambda i, j, at: times(factor, self.bend[at]))
        )

    def __add__(self, other):
        if not isinstance(other, Jet):
            return Jet(self.value + other, self.slope, self.bend)
        sums = ([v + w for v, w in zip(mine, yours, strict=True)] for mine, yours in ((self.slope, other.slope), (self.bend, other.bend)))
        return Jet(self.value + other.value, *sums)

    def __mul__(self, other):
        if not isinstance(other, Jet):
            return self._scaled(other)
        f, g, a, b = self.value, other.value, self.slope, other.slope

        def entry(i, j, at):
            return times(f, other.bend[at]) + times(g, self.bend[at]) + times(a[i], b[j]) + times(a[j], b[i])

        return Jet(f * g, [times(f, w) + times(g, v) for v, w in zip(a, b, strict=True)], self._squares(entry))

    def __neg__(self):
        return self._scaled(-1)

    def __sub__(self, other):
        return self + -other

    def __rsub__(self, other):
        return -self + other

    def __truediv__(self, other):
        return self * (other**-1 if isinstance(other, Jet) else 1 / mpmath.mpf(other))

    def __rtruediv__(self, other):
        return other * self**-1

    def __pow__(self, power):
        v = self.value
        return self._chain(v**power, power * v ** (power - 1), power * (power - 1) * v ** (power - 2))

    __radd__, __rmul__ = __add__, __mul__

    def exp(self):
        e = mpmath.exp(self.value)
        return self._chain(e, e, e)

    def ndtr(self):
        """Standard normal distribution function."""
        density = mpmath.npdf(self.value)
        return self._chain(mpmath.ncdf(self.value), density, -self.value * density)

    def criterion(self):
        """k with 2 Phi(k) - 1 equal to this probability."""
        k = mpmath.sqrt(2) * mpmath.erfinv(self.value)
        rate = 1 / (2 * mpmath.npdf(k))
        return self._chain(k, rate, k * rate**2)

    def expit(self):
        return 1 / (1 + (-self).exp())

    def log(self):
        return self._chain(mpmath.log(self.value), 1 / self.value, -1 / self.value**2)
