"""Responses of the channels of a day of S-GRS to effects of the catalogue, and the drivers in no list."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from gravcal.effects import Context, Effect, effect
from gravcal.effects.drivers import MEMORY, Law, products, waves
from gravcal.effects.gradient import EFFECTS, added_to_channels, reading_of

#: Effects of other families that such a satellite can have.
LINEAR = tuple(f"accelerometer.{n}" for n in ("scale", "misalignment", "cross_talk", "bias_drift", "temperature"))
ANGULAR = tuple(f"accelerometer.angular_{name}" for name in ("scale", "misalignment"))
TORQUE = tuple(f"torque.{name}" for name in ("aerodynamic", "gravity_gradient", "residual_dipole"))
POINTING = "attitude.star_camera_misalignment"
#: Drivers that torques do not move: motion answers a torque, and would explain any.
OUTSIDE = ("latitude", "time")
MEMORY_S = (100.0, 400.0, 1600.0)  # time constants of a memory of the drag, tried
SHORTEST_S, LONGEST_S = 30.0, 6000.0  # a bin, and what an orbit still shows


def effects_of(about: Context, channels: Sequence[str]) -> Iterator[tuple[Effect, int, dict[str, np.ndarray]]]:
    """Yield effect, number of its sensor (0: all), and derivatives by its parameters, {channel: (n, 3, q)}."""
    yield from ((entry, 0, added_to_channels(about, entry)) for entry in EFFECTS)
    for entry in map(effect, LINEAR if "linear" in channels else ()):
        for sensor, sign in enumerate((-1.0, 1.0)):
            columns = entry.columns(replace(about, linear_b=reading_of(about, sensor)))
            yield entry, sensor + 1, {"linear": sign * columns}
    others = (*ANGULAR, *(TORQUE if "torque" in channels else ()), POINTING)
    yield from ((entry, 0, added_to_channels(about, entry)) for entry in map(effect, others))


def drivers(about: Context) -> Iterator[tuple[str, str, np.ndarray]]:
    """Yield driver, form, and regressor of size near one, (n,) or, of waves, (n, 2).

    Readings and angular acceleration are in it by products alone: effects in proportion to them are in the catalogue.
    """
    for sensor in range(len(about.extra["positions"])):
        reading = reading_of(about, sensor)
        reading = reading / np.maximum(np.abs(reading).max(axis=0), 1e-300)
        for words, values in products(reading, "square of {}"):
            yield "reading", f"{words} of sensor {sensor + 1}", values
    drag, rate = about.extra["non_gravitational_b"], about.rate_b - about.rate_b.mean(axis=0)
    for name, values in (("drag", drag), ("rate", rate), ("angular_acceleration", about.rate_dot_b)):
        for axis, letter in enumerate("xyz"):
            component = values[:, axis] - values[:, axis].mean()
            component = component / max(np.abs(component).max(), 1e-300)
            if name != "angular_acceleration":
                yield name, f"component {letter}", component
            yield name, f"square of {letter}", component**2
    fastest = int(np.argmax(np.abs(about.rate_b.mean(axis=0))))
    argument = np.cumsum(about.rate_b[:, fastest] * np.diff(about.time, prepend=about.time[0]))  # along the orbit
    yield from (("latitude", *wave) for wave in waves(argument))
    yield "time", "straight line", (about.time - about.epoch) / (about.time[-1] - about.time[0])


def memories(about: Context) -> Iterator[tuple[Law, Callable[[float], np.ndarray]]]:
    """Yield the law of a component of the drag with memory, and the function of its constant s to values (n,)."""
    for driver, form, drag in drivers(about):
        if driver == "drag" and form.startswith("component"):
            law = Law(form, kernel=MEMORY)
            yield law, lambda tau, law=law, x=drag: law.values(about.time, x, (tau,), off=x, rested=False)[:, 0]
