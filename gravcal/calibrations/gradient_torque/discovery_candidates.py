"""Columns of every effect that a day of S-GRS can show, and of what changes along the orbit."""

from __future__ import annotations

import numpy as np

from gravcal.calibrations.gradient_torque.discovery_effects import listed
from gravcal.calibrations.gradient_torque.discovery_series import along_orbit
from gravcal.calibrations.gradient_torque.discovery_view import View, binned, places
from gravcal.effects.entries import each_alone

#: Drivers that torques do not move: motion answers a torque, and would explain any.
OUTSIDE = ("latitude", "time")
UNITS = {"linear": "m s-2", "attitude": "rad s-2", "torque": "N m"}


def candidates(seen: View) -> list[dict]:
    """Fields of `gravcal.discovery.blocks.Candidate`: effects, then regressors of orbit, drag, attitude and time.

    Parameters
    ----------
    seen : View
    """
    place = places(seen)
    found = [_of(entry, sensor, cut(seen, place, added)) for entry, sensor, added in listed(seen.fine, seen.rows)]
    return [one for whole in found for one in each_alone(whole)] + _drivers(seen, place)


def _of(entry, sensor, columns):
    """An effect with all its parameters."""
    names = [f"{p.name}_{sensor}" if sensor else p.name for p in entry.parameters]
    words = {"cause": entry.slug, "form": f"sensor {sensor}" if sensor else "", "names": names}
    words |= {"units": [p.unit for p in entry.parameters], "prior": [p.prior_sigma for p in entry.parameters]}
    return words | {"columns": columns}


def cut(seen: View, place: list[dict], added: dict[str, np.ndarray]) -> list[np.ndarray | None]:
    """Columns of every block from what is added to the channels, {channel: (n, 3, q)}.

    Parameters
    ----------
    seen : View
    place : of `discovery_view.places`
    added : SI
    """
    known = {name: binned(seen, name, values) for name, values in added.items() if name in seen.rows}
    width = next(iter(added.values())).shape[2]
    columns = []
    for one in place if known else ():
        parts = [known[c][p] if c in known else np.zeros((p.size, width)) for c, p in one.items()]
        columns.append(np.concatenate(parts))
    return [*(columns or [None] * len(place)), None]


def _drivers(seen, place):
    """Functions of orbit, drag, attitude and time, added to what each channel reads."""
    found = []
    for channel in seen.rows:
        for driver, form, shape in shapes(seen):
            if channel == "torque" and driver not in OUTSIDE:
                continue
            columns = cut(seen, place, {channel: shape[:, None, None] * np.eye(3)})
            words = {"cause": f"unknown:{driver}", "form": f"{channel}, {form}", "prior": []}
            names = [f"{channel}_{a}" for a in "xyz"]
            found.append(words | {"names": names, "units": [UNITS[channel]] * 3, "columns": columns})
    return found


def shapes(seen: View) -> list[tuple[str, str, np.ndarray]]:
    """Drivers, their forms, and what follows them, (n,) 1 of a size near one.

    Parameters
    ----------
    seen : View
    """
    about = seen.fine
    drag, rate = about.extra["non_gravitational_b"], about.rate_b - about.rate_b.mean(axis=0)
    rows = []
    for name, values in (("drag", drag), ("rate", rate), ("angular_acceleration", about.rate_dot_b)):
        for axis, letter in enumerate("xyz"):
            one = values[:, axis] - values[:, axis].mean()
            one = one / max(np.abs(one).max(), 1e-300)
            rows += [(name, f"component {letter}", one), (name, f"square of {letter}", one**2)]
    turned = along_orbit(about)
    for order in (1, 2):
        rows += [("latitude", f"cosine of {order} times its argument", np.cos(order * turned))]
        rows += [("latitude", f"sine of {order} times its argument", np.sin(order * turned))]
    since = (about.time - about.time[0]) / (about.time[-1] - about.time[0])
    return [*rows, ("time", "straight line", since - 0.5)]
