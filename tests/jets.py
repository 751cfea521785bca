"""Second-order forward differentiation on mpmath numbers: an independent route to gradients and Hessians."""

import mpmath

NONE = mpmath.mpf(0)


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
        a, bend = self.slope, self.bend
        return Jet(value, [first * v for v in a], self._squares(lambda i, j, at: first * bend[at] + second * (a[i] * a[j])))

    def _lift(self, other):
        return other if isinstance(other, Jet) else Jet(other, [NONE] * len(self.slope), [NONE] * len(self.bend))

    def __add__(self, other):
        o = self._lift(other)
        sums = ([v + w for v, w in zip(mine, yours, strict=True)] for mine, yours in ((self.slope, o.slope), (self.bend, o.bend)))
        return Jet(self.value + o.value, *sums)

    def __mul__(self, other):
        o = self._lift(other)
        f, g, a, b = self.value, o.value, self.slope, o.slope
        bend = self._squares(lambda i, j, at: f * o.bend[at] + g * self.bend[at] + a[i] * b[j] + a[j] * b[i])
        return Jet(f * g, [f * w + g * v for v, w in zip(a, b, strict=True)], bend)

    def __neg__(self):
        return self * -1

    def __sub__(self, other):
        return self + -self._lift(other)

    def __rsub__(self, other):
        return self._lift(other) + -self

    def __truediv__(self, other):
        o = self._lift(other)
        return self * o._chain(1 / o.value, -1 / o.value**2, 2 / o.value**3)

    def __rtruediv__(self, other):
        return self._lift(other) / self

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
