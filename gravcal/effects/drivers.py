"""What a reading in no list may follow: products and waves of measured series, and laws with constants made of one.

A law takes a series through a nonlinearity, a kernel and a gate; its words say so, and its constants are fitted.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numba
import numpy as np

from gravcal.effects.accelerometer import deflection


def products(values: np.ndarray, square: str = "product {0}{0}") -> Iterator[tuple[str, np.ndarray]]:
    """Words and products (...) of every pair of axes of a vector (..., 3), its squares with words of their own."""
    for i, j in itertools.combinations_with_replacement(range(3), 2):
        words = square.format("xyz"[i]) if i == j else f"product {'xyz'[i]}{'xyz'[j]}"
        yield words, values[..., i] * values[..., j]


def waves(argument: np.ndarray, orders=(1, 2, 3, 4)) -> Iterator[tuple[str, np.ndarray]]:
    """Words, and waves (..., 2), cosine and sine, of multiples of an angle (...) rad along which something may vary."""
    for order in orders:
        yield f"wave of {order} times its argument", np.stack([np.cos(order * argument), np.sin(order * argument)], -1)


#: What a law does to a series x: words, and a function of x and of constants of these names.
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
#: Unit, values that are tried and bounds of a constant.
CONSTANTS = {
    "threshold": ("1", (0.3, 0.6), (0.02, 0.98)),
    "level": ("1", (0.15, 0.5), (0.02, 5.0)),
    "cycles": ("1", tuple(np.arange(1.0, 101.0)), (0.3, 120.0)),
    "tau": ("s", (0.5, 2.0, 8.0, 30.0, 90.0), (0.05, 500.0)),
    "delay": ("s", (0.5, 2.0, 8.0), (0.05, 30.0)),
    "frequency": ("Hz", (0.02, 0.05, 0.12, 0.3), (0.005, 0.8)),
    "damping": ("1", (0.1,), (0.003, 1.0)),
}


@dataclass(frozen=True)
class Law:
    """A series, by its words, through a nonlinearity, a kernel and a gate, each a key of its table."""

    base: str
    nonlinear: str = "{}"
    kernel: str = "{}"
    gate: str = "{}"

    @property
    def words(self) -> str:
        """The law in words."""
        return self.gate.format(self.kernel.format(self.nonlinear.format(self.base)))

    @property
    def names(self) -> tuple[str, ...]:
        """Its constants."""
        return NONLINEAR[self.nonlinear][0] + KERNELS[self.kernel][0]

    @property
    def width(self) -> int:
        """Number of series that it makes of one."""
        return 2 if self.nonlinear == WAVES else 1

    def tried(self) -> Iterator[tuple[float, ...]]:
        """Constants that are tried."""
        return itertools.product(*(CONSTANTS[name][1] for name in self.names))

    def told(self, constants) -> str:
        """The law in words, with its constants."""
        rows = zip(self.names, constants, strict=True)
        return ", ".join([self.words, *(f"{n} {v:.4g} {CONSTANTS[n][0]}".removesuffix(" 1") for n, v in rows)])

    def tells(self, words: str) -> bool:
        """True if these words are those of this law with some constants."""
        return words == self.words or bool(self.names) and words.startswith(f"{self.words}, {self.names[0]} ")

    def values(self, time: np.ndarray, series: np.ndarray, constants, *, off: np.ndarray, rested: bool) -> np.ndarray:
        """Values (n, w) of the law of a series (n,) at times s, by its constants, where the torquers are `off` (n,).

        `rested` says that the series was zero before the first epoch.
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
    """Laws of a series that differ from it; of one that grows all the time, as latitude does, its waves."""
    if waves_only:
        return [Law(base, WAVES)]
    both = [Law(base, n, k) for n in NONLINEAR if n != WAVES for k in KERNELS if (n, k) != ("{}", "{}")]
    return both + [Law(base, n, gate=g) for n in list(NONLINEAR)[:3] for g in GATES if g != "{}"]


@numba.njit(cache=True)
def lagged(time, values, lag_s):
    """Series (n,) through a first-order lag, s."""
    out, state = np.empty_like(values), values[0]
    for k in range(values.size):
        step = time[k] - time[k - 1] if k else 0.0
        state = values[k] + (state - values[k]) * np.exp(-step / lag_s)
        out[k] = state
    return out


@numba.njit(cache=True)
def play(values, width):
    """Series (n,) behind a play of some width: hysteresis."""
    out, state = np.empty_like(values), 0.0
    for k in range(values.size):
        state = min(max(state, values[k] - width / 2), values[k] + width / 2)
        out[k] = state
    return out
