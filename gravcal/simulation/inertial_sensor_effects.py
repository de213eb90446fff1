"""Effects hidden in a simulated inertial sensor: on its readings, on the tracker, on the tags."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from gravcal.effects import Context, inertial_sensor
from gravcal.physics import frames
from gravcal.simulation import injection

KNOWN = (
    *(entry.slug for entry in inertial_sensor.EFFECTS),
    *(f"accelerometer.{name}" for name in ("misalignment", "angular_leak", "bias_step", "stray_tone")),
    *("timing.accelerometer_delay", "timing.star_camera_delay"),
)


@dataclass(frozen=True)
class Hidden:
    """Effects and the epoch from which their drifts count.

    Attributes
    ----------
    effects : {slug: {parameter: value}}; epoch : GPS s
    """

    effects: Mapping = field(default_factory=dict)
    epoch: float = 0.0


def hidden(effects: Mapping | None, epoch: float) -> Hidden:
    """Effects that this simulation knows; another one is refused.

    Parameters
    ----------
    effects : {slug: {parameter: value}} or None; epoch : GPS s
    """
    return Hidden(injection.within(effects or {}, KNOWN), epoch)


def read(time, linear_b, angular_b, truth, hide: Hidden) -> tuple[np.ndarray, np.ndarray]:
    """What the sensor feels with the effects of its electrodes and its loop.

    Parameters
    ----------
    time : (n,) s; linear_b, angular_b : (n, 3) m s-2, rad s-2; truth : Truth; hide : Hidden
    """
    if not hide.effects:
        return linear_b, angular_b
    delay = injection.added(hide.effects, "acc_delay", Context(time, epoch=hide.epoch))
    if np.any(delay):
        linear_b, angular_b = (_earlier(time, values, delay) for values in (linear_b, angular_b))
    extra = {"linear_volt": (linear_b - truth.bias) / truth.k, "displacement_b": -linear_b / inertial_sensor.LOOP**2}
    context = Context(time, linear_b=linear_b, angular_b=angular_b, epoch=hide.epoch, extra=extra)
    linear = linear_b + injection.added(hide.effects, "linear_b", context)
    return linear, angular_b + injection.added(hide.effects, "angular_b", context)


def _earlier(time, values, delay):
    return np.stack([np.interp(time - delay, time, column) for column in values.T], axis=1)


def tracked(time, quaternion, hide: Hidden) -> np.ndarray:
    """Attitude in the frame of a tracker that is turned against the sensor.

    Parameters
    ----------
    time : (n,) s; quaternion : (n, 4); hide : Hidden
    """
    angle = injection.added(hide.effects, "pointing_b", Context(time, epoch=hide.epoch))
    return frames.quaternion_product(quaternion, frames.from_rotation_vector(angle)) if np.any(angle) else quaternion


def late(time, hide: Hidden):
    """Delay (n,) s of the tracker's tags beyond that of the settings.

    Parameters
    ----------
    time : (n,) s; hide : Hidden
    """
    return injection.added(hide.effects, "sca_delay", Context(time, epoch=hide.epoch))
