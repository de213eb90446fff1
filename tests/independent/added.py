"""Effects that add to the linear reading of the accelerometer: functions of a scene (`scene.Scene`), m s-2 in SRF."""

import numpy as np

from .attitude import first_order


def acc_tone(s, value, frequency_hz, phase):
    """Sine."""
    phase = s.rng("tone").uniform(0, 2 * np.pi) if phase is None else phase
    return np.outer(np.sin(2 * np.pi * frequency_hz * s.t + phase), value)


def odd_current_squared(s, value, lag_s):
    """Current squared, lagged, as of warming."""
    squared = np.repeat(s.total[:, None] ** 2, 3, 1)
    return first_order(s.t, squared, lag_s, squared[0]) * value


def odd_edge_spike(s, value, decay_s, signed):
    """Decaying spike after each edge, with the sign of the change if signed."""
    shape = np.zeros_like(s.t)
    for m in s.manoeuvres:
        jump = np.diff(m.current(m.edges), prepend=0.0)
        for edge, change in zip(m.edges, jump, strict=True):
            after = (s.t >= edge) & (s.t < edge + 20 * decay_s)
            shape[after] += (np.sign(change) if signed else 1.0) * np.exp(-(s.t[after] - edge) / decay_s)
    return np.outer(shape, value)


def odd_telegraph(s, value, rate_hz):
    """Random telegraph signal, one realisation for the whole day."""
    flips = np.cumsum(s.rng("telegraph").exponential(1 / rate_hz, int(86400 * rate_hz * 1.2) + 50))
    return np.outer(1.0 - 2.0 * (np.searchsorted(flips, s.t) % 2), value)


def play(x, width, last=0.0):
    """Follows x (n,) only beyond half a width."""
    out = np.empty_like(x)
    for k, value in enumerate(x):
        out[k] = last = min(max(last, value - width / 2), value + width / 2)
    return out


def odd_chirp(s, value, from_hz, to_hz):
    """Sine of rising frequency, in manoeuvres."""
    shape = np.zeros_like(s.t)
    for m in s.manoeuvres:
        x = s.t - m.start
        inside = (x >= 0) & (x < m.duration_s)
        phase = from_hz * x + (to_hz - from_hz) * x**2 / (2 * m.duration_s)
        shape += inside * np.sin(2 * np.pi * phase)
    return np.outer(shape, value)


LINEAR = {one.__name__: one for one in (acc_tone, odd_current_squared, odd_edge_spike, odd_telegraph, odd_chirp)} | {
    "acc_current_leak": lambda s, value: s.current @ value.T,
    "odd_field_current": lambda s, value: np.outer(s.strength * s.total, value),
    "odd_latitude": lambda s, value, cycles: np.outer(np.sin(cycles * s.latitude) if cycles else s.latitude, value),
    "odd_hysteresis": lambda s, value, width_ma: np.outer(play(s.total, width_ma), value),
    "odd_second_hand": lambda s, value: np.outer(s.t % 1.0 - 0.5, value),
    "odd_rate_product": lambda s, value: np.outer(s.rate_off[:, 0] * s.rate_off[:, 2], value),  # off the reference
}


def total(scene, effects):
    """Sum over the effects that are switched on."""
    out = np.zeros((len(scene.t), 3))
    for name, function in LINEAR.items():
        if np.any(effects[name]["value"]):
            out += function(scene, **effects[name])
    return out
