"""Columns of every effect that a day of S-GRS can show, and of what changes along the orbit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gravcal.calibrations.gradient_torque.discovery_series import along_orbit
from gravcal.calibrations.gradient_torque.discovery_view import View, binned, places
from gravcal.effects import effect
from gravcal.effects.entries import each_alone
from gravcal.effects.gradient import EFFECTS
from gravcal.physics import frames, sensing

#: Effects of other families that such a satellite can have.
LINEAR = tuple(f"accelerometer.{name}" for name in ("scale", "misalignment", "cross_talk", "bias_drift"))
ANGULAR = tuple(f"accelerometer.angular_{name}" for name in ("scale", "misalignment"))
TORQUE = tuple(f"torque.{name}" for name in ("aerodynamic", "gravity_gradient"))
POINTING = "attitude.star_camera_misalignment"
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
    found = [_of(seen, place, entry, series_of(seen, entry)) for entry in EFFECTS]
    sensors = range(len(seen.fine.extra["positions"])) if "linear" in seen.rows else ()
    for slug in LINEAR:
        found += [_of(seen, place, effect(slug), _one_sensor(seen, effect(slug), k), f"_{k + 1}") for k in sensors]
    for slug in (*ANGULAR, *(TORQUE if "torque" in seen.rows else ()), POINTING):
        found.append(_of(seen, place, effect(slug), series_of(seen, effect(slug))))
    return [one for whole in found for one in each_alone(whole)] + _drivers(seen, place)


def _of(seen, place, entry, added, suffix=""):
    """An effect with all its parameters."""
    names = [f"{p.name}{suffix}" for p in entry.parameters]
    words = {"cause": entry.slug, "form": f"sensor {suffix[1:]}" if suffix else "", "names": names}
    words |= {"units": [p.unit for p in entry.parameters], "prior": [p.prior_sigma for p in entry.parameters]}
    return words | {"columns": cut(seen, place, added)}


def series_of(seen: View, entry) -> dict[str, np.ndarray]:
    """What an effect adds to the channels by each parameter, {channel: (n, 3, q)}, SI.

    Parameters
    ----------
    seen : View
    entry : Effect
    """
    about = seen.fine
    if entry.channel == "linear_each_b":  # files hold the test mass relative to the satellite: minus a reading
        return {"linear": _difference(entry.columns(about))}
    if entry.channel == "angular_each_b":
        return {"attitude": -entry.columns(about).mean(axis=1)}
    if entry.channel == "angular_b":
        return {"attitude": -entry.columns(replace(about, angular_b=about.rate_dot_b))}
    if entry.channel == "torque_b":
        return {"torque": entry.columns(about)}
    return _turned_frame(about)


def _turned_frame(about):
    """A star camera that is turned: what it calls b is not the frame that the sensors read in."""
    turned = {"attitude": np.moveaxis(np.cross(about.rate_dot_b[:, None], np.eye(3)), 1, 2)}
    if len(about.extra["positions"]) == 2:
        tensor, apart = _tensor(about), about.extra["positions"][0] - about.extra["positions"][1]
        crosses = [frames.cross_matrix(e) for e in np.eye(3)]
        turned["linear"] = np.stack([np.matvec(tensor @ c - c @ tensor, apart) for c in crosses], axis=2)
    return turned


def _difference(each):
    """Difference of what the files of two sensors hold, from what accelerometers read, (n, sensors, 3, q)."""
    return each[:, 1] - each[:, 0] if each.shape[1] == 2 else np.zeros_like(each[:, 0])


def _tensor(about):
    return sensing.offset_tensor(about.rate_b, about.rate_dot_b, about.gradient_b)


def reading(seen: View, sensor: int) -> np.ndarray:
    """What the model says an accelerometer in the place of a sensor reads, (n, 3) m s-2.

    Parameters
    ----------
    seen : View
    sensor : 0 or 1
    """
    about = seen.fine
    place = about.extra["positions"][sensor]
    return sensing.proof_mass_reading(about.extra["non_gravitational_b"], _tensor(about), place)


def _one_sensor(seen, entry, sensor):
    """What an effect of one sensor alone adds to the difference."""
    sign = (-1.0, 1.0)[sensor]
    return {"linear": sign * entry.columns(replace(seen.fine, linear_b=reading(seen, sensor)))}


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
