"""Effects: parameters with units and one additive contribution to one channel of the forward model.

Laws are functions of c, the `Context`, and v, the values of the parameters in their order.
"""

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

#: {channel that a contribution can be added to: its unit}.
CHANNELS = tomllib.loads(Path(__file__).with_name("channels.toml").read_text(encoding="utf-8"))
#: Usual values of parameters that a contribution is not linear in: s, 1, rad, A m2, rad.
USUAL = {"tau": 0.3, "damping": 0.02, "phase": 1.0, "limit": 27.0, "period": 0.021}
REVERSED = -3.0  # smallest relative excess of a scale that has a meaning: factor -2, the sign reversed


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect."""

    name: str  #: word used in settings, results and model files
    unit: str  #: SI
    meaning: str  #: what a positive value does
    prior_sigma: float  #: plausible one-sigma size, for injection and for regularised fits
    neutral: float = 0.0  #: value at which the effect vanishes
    lower: float = -np.inf  #: smallest value that has a meaning


@dataclass(frozen=True)
class Context:
    """Quantities that a contribution may depend on, at the epochs of its channel; those that do not apply are None."""

    time: np.ndarray  #: (n,) s, GPS
    rate_b: np.ndarray | None = None  #: (n, 3) rad s-1, body with respect to inertial
    rate_dot_b: np.ndarray | None = None  #: (n, 3) rad s-2
    gradient_b: np.ndarray | None = None  #: (n, 3, 3) s-2, gravity gradient dg/dr
    dipole_b: np.ndarray | None = None  #: (n, 3) A m2, commanded dipole
    field_b: np.ndarray | None = None  #: (n, 3) T, geomagnetic field
    linear_b: np.ndarray | None = None  #: (n, 3) m s-2, reading before this effect is added
    angular_b: np.ndarray | None = None  #: (n, 3) rad s-2, likewise
    inertia_b: np.ndarray | None = None  #: (3, 3) kg m2
    start: np.ndarray = field(default_factory=lambda: np.zeros(0))  #: (k,) s, manoeuvres
    stop: np.ndarray = field(default_factory=lambda: np.zeros(0))  #: (k,) s
    epoch: float = 0.0  #: s, from which drifts and phases count
    #: anything else, by name: mass (kg), non_gravitational_b and radiation_b (n, 3) m s-2, warmth (n,) 1 as of
    #: `orbit_environment.warmth`, axis_b (n, 3) 1 as of `orbit_environment.dipole_axis_i`; families add their own
    extra: Mapping = field(default_factory=dict)


@dataclass(frozen=True)
class Effect:
    """A physical or instrumental effect, shared by the simulator, the estimator and discovery."""

    slug: str  #: "family.name"
    channel: str  #: key of CHANNELS
    parameters: tuple[Parameter, ...]  #: its numbers
    contribution: Callable[[Context, np.ndarray], np.ndarray]  #: (context, values) -> array added to the channel
    reference: str  #: where the law stands
    linear: bool = True  #: the contribution is proportional to the parameters

    def plausible(self, share: Callable[[], float]) -> dict[str, float]:
        """{name: value}: neutral plus `share()` times the prior sigma, or that of `USUAL`."""
        sizes = ((p.name, float(p.neutral + p.prior_sigma * share())) for p in self.parameters)
        return {name: USUAL.get(name, size) for name, size in sizes}

    def values(self, numbers: Mapping[str, float]) -> np.ndarray:
        """Parameter values (p,) in order, from {name: SI value}; neutral ones where a name is missing."""
        return np.array([numbers.get(p.name, p.neutral) for p in self.parameters], dtype=float)

    def columns(self, context: Context, at: np.ndarray | None = None) -> np.ndarray:
        """Partial derivatives (..., p) of the contribution by the parameters; central differences where not linear.

        They are taken at the values ``at`` (p,), neutral by default; at a lower bound by a step of one prior sigma.
        """
        at = self.values({}) if at is None else np.asarray(at, dtype=float)
        parts = []
        for index, parameter in enumerate(self.parameters):
            unit = np.zeros(at.size)
            unit[index] = 1.0
            if self.linear:
                parts.append(self.contribution(context, unit))
            elif at[index] - 1e-3 * parameter.prior_sigma < parameter.lower:  # at the end of its range
                moved = self.contribution(context, at + parameter.prior_sigma * unit)
                parts.append((moved - self.contribution(context, at)) / parameter.prior_sigma)
            else:
                step = 1e-3 * parameter.prior_sigma * unit
                difference = self.contribution(context, at + step) - self.contribution(context, at - step)
                parts.append(difference / (2e-3 * parameter.prior_sigma))
        return np.stack(parts, axis=-1)


class Laws(list):
    """List of the effects of one family."""

    def law(self, slug: str, channel: str, parameters, reference: str, **more) -> Callable:
        """Decorator that adds an Effect with the decorated contribution (context, values); arguments are its fields."""

        def add(contribution):
            self.append(Effect(slug, channel, tuple(parameters), contribution, reference, **more))
            return contribution

        return add


def axes(name: str, unit: str, meaning: str, prior_sigma: float, **more) -> tuple[Parameter, ...]:
    """Parameters of the same kind along the three body axes, named `name_x`, `name_y`, `name_z` or `x`, `y`, `z`."""
    prefix = f"{name}_" if name else ""
    return tuple(Parameter(f"{prefix}{a}", unit, f"{meaning} {a}", prior_sigma, **more) for a in "xyz")


def each(names, unit: str, meaning: str, prior_sigma: float) -> tuple[Parameter, ...]:
    """Parameters of one kind, one for each name, which replaces "{0}" (or its first letter "{0[0]}") in the meaning."""
    return tuple(Parameter(name, unit, meaning.format(name), prior_sigma) for name in names)


def pairs(unit: str, meaning: str, prior_sigma: float) -> tuple[Parameter, ...]:
    """Parameters "x_from_y" of the nine pairs of axes, the elements of the matrix of `coupled` row by row."""
    return each([f"{a}_from_{b}" for a in "xyz" for b in "xyz"], unit, meaning, prior_sigma)


def symmetric(xy: float, xz: float, yz: float) -> np.ndarray:
    """Symmetric matrix (3, 3) of three off-diagonal elements, its diagonal zero."""
    return np.array([[0, xy, xz], [xy, 0, yz], [xz, yz, 0]])


# contributions (context, values) that several families share; `name` is the vector (n, 3) of the Context they act on


def scaled(name: str) -> Callable:
    """Contribution of scale errors: each component of a vector times its relative excess, values (3,)."""
    return lambda c, v: getattr(c, name) * v


def misaligned(name: str) -> Callable:
    """Contribution da = a x v to a vector a that is read in a frame turned by a small rotation v, values (3,) rad."""
    return lambda c, v: np.cross(getattr(c, name), v)


def coupled(name: str) -> Callable:
    """Contribution of couplings: matrix (3, 3), values (9,) row by row, times a vector."""
    return lambda c, v: getattr(c, name) @ np.asarray(v).reshape(3, 3).T


def constant(context: Context, values) -> np.ndarray:
    """Contribution (n, 3) of the same vector, values (3,), at every epoch."""
    return np.broadcast_to(values, (*context.time.shape, 3)).copy()


def warming(context: Context, values) -> np.ndarray:
    """Contribution (n, 3) of values (3,) times `warmth`, 0 to 1: sunlight through a first-order lag."""
    return context.extra["warmth"][:, None] * np.asarray(values)


def drifting(context: Context, values) -> np.ndarray:
    """Contribution (n, 3) of a drift, values (3,) per second, zero at the reference epoch."""
    return (context.time - context.epoch)[:, None] * np.asarray(values)
