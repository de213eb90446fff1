"""Drivers outside the catalogue that a reading may follow: products and waves of measured series, and laws of one.

A law takes a series through a nonlinearity, a kernel and a gate, named by its words; its constants are fitted.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numba
import numpy as np

from gravcal.effects.accelerometer import deflection


def products(values: np.ndarray, square: str = "product {0}{0}") -> Iterator[tuple[str, np.ndarray]]:
    """Pairs (words, product (...)) for all six products of two components of vectors (..., 3), squares included."""
    for i, j in itertools.combinations_with_replacement(range(3), 2):
        words = square.format("xyz"[i]) if i == j else f"product {'xyz'[i]}{'xyz'[j]}"
        yield words, values[..., i] * values[..., j]


def waves(argument: np.ndarray, orders=(1, 2, 3, 4)) -> Iterator[tuple[str, np.ndarray]]:
    """Pairs (words, cosine and sine (..., 2)) for multiples of an angle (...) rad, argument of a periodic driver."""
    for order in orders:
        yield f"wave of {order} times its argument", np.stack([np.cos(order * argument), np.sin(order * argument)], -1)


#: {words: (names of constants, function of a series x and these constants)}; kernels take the time s, too, gates `off`.
NONLINEAR = {
    "{}": ((), lambda x: x),
    "the square of {}": ((), lambda x: x**2),
    "the size of {}": ((), np.abs),
    "the cube of {}": ((), lambda x: x**3),
    "{} beyond a threshold": (("threshold",), lambda x, c: np.sign(x) * np.maximum(np.abs(x) - c, 0.0)),
    "the saturation of {}": (("level",), lambda x, c: c * np.tanh(x / c)),
    "waves in {}": (("cycles",), lambda x, c: np.stack([np.sin(c * x), np.cos(c * x)], axis=1)),
}
KERNELS = {
    "{}": ((), lambda _, x: x),
    "a memory of {}": (("tau",), lambda t, x, tau: lagged(t, x, tau)),
    "a delay of {}": (("delay",), lambda t, x, late: np.interp(t - late, t, x)),
    "a resonance with {}": (("frequency", "damping"), lambda t, x, f, d: deflection(t, x[:, None], f, d)[:, 0]),
}
GATES = {
    "{}": lambda _, x: x,
    "{} where it is positive": lambda _, x: np.maximum(x, 0.0),
    "{} while the torquers are off": lambda off, x: off * x,
}
MEMORY, WAVES = "a memory of {}", "waves in {}"
#: {constant: (unit, values to start a fit from, bounds)}.
CONSTANTS = {
    "threshold": ("1", (0.3, 0.6), (0.02, 0.98)),
    "level": ("1", (0.15, 0.5), (0.02, 5.0)),
    "cycles": ("1", tuple(np.arange(1.0, 101.0)), (0.3, 120.0)),
    "tau": ("s", (0.5, 2.0, 8.0, 30.0, 90.0), (0.05, 500.0)),
    "delay": ("s", (0.5, 2.0, 8.0), (0.05, 30.0)),
    "frequency": ("Hz", (0.02, 0.05, 0.12, 0.3), (0.005, 0.8)),
    "damping": ("1", (0.1,), (0.003, 0.99)),
}


@dataclass(frozen=True)
class Law:
    """Law of a driver: a series through a nonlinearity, a kernel and a gate, in this order."""

    base: str  #: words of the series
    nonlinear: str = "{}"  #: key of NONLINEAR
    kernel: str = "{}"  #: key of KERNELS
    gate: str = "{}"  #: key of GATES

    @property
    def words(self) -> str:
        """Description of the law, such as "a memory of the square of the current"."""
        return self.gate.format(self.kernel.format(self.nonlinear.format(self.base)))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its constants, those of the nonlinearity first."""
        return NONLINEAR[self.nonlinear][0] + KERNELS[self.kernel][0]

    @property
    def width(self) -> int:
        """Number of columns of `values`: 2 for waves, else 1."""
        return 2 if self.nonlinear == WAVES else 1

    def tried(self) -> Iterator[tuple[float, ...]]:
        """Sets of constants to start a fit from, in the order of `names`."""
        return itertools.product(*(CONSTANTS[name][1] for name in self.names))

    def told(self, constants) -> str:
        """Description of the law with values and units of its constants."""
        rows = zip(self.names, constants, strict=True)
        return ", ".join([self.words, *(f"{n} {v:.4g} {CONSTANTS[n][0]}".removesuffix(" 1") for n, v in rows)])

    def tells(self, words: str) -> bool:
        """True if words describe this law, with or without values of its constants."""
        return words == self.words or bool(self.names) and words.startswith(f"{self.words}, {self.names[0]} ")

    def values(self, time: np.ndarray, series: np.ndarray, constants, *, off: np.ndarray, rested: bool) -> np.ndarray:
        """Values (n, width) of the law for a series (n,) at (n,) s, with its constants; `off` (n,) bool: torquers off.

        `rested`: the series was zero before the first epoch, else a memory starts from its first value.
        """
        count, constants = len(NONLINEAR[self.nonlinear][0]), tuple(map(float, constants))
        x = NONLINEAR[self.nonlinear][1](series, *constants[:count])
        first = x[0]
        x = KERNELS[self.kernel][1](time, x, *constants[count:]) if constants[count:] else x
        if self.kernel == MEMORY and rested:
            x = x - first * np.exp(-(time - time[0] + np.median(np.diff(time))) / constants[-1])
        x = GATES[self.gate](off, x)
        return x if x.ndim == 2 else x[:, None]


def laws(base: str, waves_only: bool) -> list[Law]:
    """Laws of a series other than itself; of one that grows all the time, as latitude does, only its waves."""
    if waves_only:
        return [Law(base, WAVES)]
    filtered = [Law(base, n, k) for n in NONLINEAR if n != WAVES for k in KERNELS if (n, k) != ("{}", "{}")]
    return filtered + [Law(base, n, gate=g) for n in list(NONLINEAR)[:3] for g in GATES if g != "{}"]


@numba.njit(cache=True)
def lagged(time, values, lag_s):
    """Series (n,) at (n,) s through a first-order lag (s), settled at its first value."""
    out, state = np.empty_like(values), values[0]
    for k in range(values.size):
        step = time[k] - time[k - 1] if k else 0.0
        state = values[k] + (state - values[k]) * np.exp(-step / lag_s)
        out[k] = state
    return out


@numba.njit(cache=True)
def play(values, width):
    """Series (n,) through a play operator of a width (unit of the series): hysteresis, from a state of zero."""
    out, state = np.empty_like(values), 0.0
    for k in range(values.size):
        state = min(max(state, values[k] - width / 2), values[k] + width / 2)
        out[k] = state
    return out
