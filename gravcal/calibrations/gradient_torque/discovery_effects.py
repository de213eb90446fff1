"""What every listed effect adds to the channels of a day of S-GRS, in SI at the epochs of the record."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gravcal.effects import Context, effect
from gravcal.effects.gradient import EFFECTS
from gravcal.physics import frames, sensing

#: Effects of other families that such a satellite can have.
LINEAR = tuple(f"accelerometer.{name}" for name in ("scale", "misalignment", "cross_talk", "bias_drift"))
ANGULAR = tuple(f"accelerometer.angular_{name}" for name in ("scale", "misalignment"))
TORQUE = tuple(f"torque.{name}" for name in ("aerodynamic", "gravity_gradient"))
POINTING = "attitude.star_camera_misalignment"


def listed(about: Context, channels) -> list[tuple]:
    """Effect, number of the sensor that has it (0: all have), and what it adds by each parameter {channel: (n, 3, q)}.

    Parameters
    ----------
    about : Context of the epochs
    channels : those that the record has, of `discovery_view.CHANNELS`
    """
    found = [(entry, 0, series_of(about, entry)) for entry in EFFECTS]
    sensors = range(len(about.extra["positions"])) if "linear" in channels else ()
    found += [(effect(s), k + 1, _one_sensor(about, effect(s), k)) for s in LINEAR for k in sensors]
    others = (*ANGULAR, *(TORQUE if "torque" in channels else ()), POINTING)
    return found + [(effect(slug), 0, series_of(about, effect(slug))) for slug in others]


def series_of(about: Context, entry) -> dict[str, np.ndarray]:
    """What an effect adds to the channels by each parameter, {channel: (n, 3, q)}, SI.

    Parameters
    ----------
    about : Context of the epochs
    entry : Effect
    """
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


def reading(about: Context, sensor: int) -> np.ndarray:
    """What the model says an accelerometer in the place of a sensor reads, (n, 3) m s-2.

    Parameters
    ----------
    about : Context of the epochs
    sensor : 0 or 1
    """
    place = about.extra["positions"][sensor]
    return sensing.proof_mass_reading(about.extra["non_gravitational_b"], _tensor(about), place)


def _one_sensor(about, entry, sensor):
    """What an effect of one sensor alone adds to the difference."""
    sign = (-1.0, 1.0)[sensor]
    return {"linear": sign * entry.columns(replace(about, linear_b=reading(about, sensor)))}
