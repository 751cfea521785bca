"""Second-order forward differentiation on mpmath numbers: an independent route to gradients and Hessians."""

import mpmath


class Jet:
    """A number with its gradient and Hessian in a few coordinates; arithmetic follows the product and chain rules."""

    def __init__(self, value, slope, bend):
        self.value, self.slope, self.bend = mpmath.mpf(value), slope, bend

    @classmethod
    def coordinates(cls, values):
        n = len(values)
        none = mpmath.matrix(n, n)
        return [cls(v, mpmath.matrix([mpmath.mpf(i == j) for j in range(n)]), none) for i, v in enumerate(values)]

    def _chain(self, value, first, second):
        return Jet(value, first * self.slope, first * self.bend + second * (self.slope * self.slope.T))

    def _lift(self, other):
        n = self.slope.rows
        return other if isinstance(other, Jet) else Jet(other, mpmath.matrix(n, 1), mpmath.matrix(n, n))

    def __add__(self, other):
        o = self._lift(other)
        return Jet(self.value + o.value, self.slope + o.slope, self.bend + o.bend)

    def __mul__(self, other):
        o = self._lift(other)
        cross = self.slope * o.slope.T
        return Jet(
            self.value * o.value,
            self.value * o.slope + o.value * self.slope,
            self.value * o.bend + o.value * self.bend + cross + cross.T,
        )

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
