"""Effects that add to the accelerometer reading: functions of a scene (see `scene.Scene`), m s-2 or rad s-2 in SRF."""

import numpy as np

from .attitude import first_order, oscillator

LINEAR, ANGULAR = {}, {}


def _effect(table):
    def register(function):
        table[function.__name__] = function
        return function

    return register


@_effect(LINEAR)
def acc_current_leak(s, value):
    """Leak from the torquers."""
    return s.current @ value.T


@_effect(LINEAR)
def acc_angular_leak(s, value):
    """Leak from angular acceleration."""
    return s.rate_dot @ value.T


@_effect(LINEAR)
def acc_bias_step(s, value, manoeuvre, at):
    """Step at a fraction of a manoeuvre."""
    m = s.manoeuvres[manoeuvre]
    return np.outer(s.t >= m.start + at * m.duration_s, value)


@_effect(LINEAR)
def acc_drift(s, value):
    """Straight line through noon."""
    return np.outer(s.t - 43200.0, value)


@_effect(LINEAR)
def acc_tone(s, value, frequency_hz, phase):
    """Sine."""
    phase = s.rng("tone").uniform(0, 2 * np.pi) if phase is None else phase
    return np.outer(np.sin(2 * np.pi * frequency_hz * s.t + phase), value)


@_effect(LINEAR)
def acc_temperature(s, value, lag_s):
    """Sunlight through a first-order lag, on its own coarse grid from three lags before."""
    t = np.arange(max(s.t[0] - 3 * lag_s, -150.0), s.t[-1] + 20.0, 10.0)
    light = np.repeat(s.sunlit(t)[:, None].astype(float), 3, 1)
    warm = first_order(t, light, lag_s, np.full(3, 0.6))[:, 0]
    return np.outer(np.interp(s.t, t, warm), value)


@_effect(LINEAR)
def flexible_mode(s, value, axis, frequency_hz, damping, angular):
    """Ringing left over by an oscillator after each change of torque."""
    return np.outer(_ringing(s, axis, frequency_hz, damping), value)


@_effect(ANGULAR)
def flexible_mode_angular(s, value, axis, frequency_hz, damping, angular):
    """The same ringing in the angular reading about the driven axis."""
    return np.outer(_ringing(s, axis, frequency_hz, damping), np.eye(3)[axis] * angular)


def _ringing(s, axis, frequency_hz, damping):
    drive = np.ascontiguousarray(s.control_torque[:, axis])
    return oscillator(s.t, drive, frequency_hz, damping) - drive


@_effect(ANGULAR)
def ang_current_leak(s, value):
    """Leak from the torquers into the angular reading."""
    return s.current @ value.T


@_effect(LINEAR)
def odd_field_current(s, value):
    """Strength of the field times current."""
    return np.outer(s.strength * s.total, value)


@_effect(ANGULAR)
def odd_angular_field(s, value):
    """Strength of the field times current, in the angular reading."""
    return np.outer(s.strength * s.total, value)


@_effect(LINEAR)
def odd_current_squared(s, value, lag_s):
    """Current squared, lagged, as of warming."""
    squared = np.repeat(s.total[:, None] ** 2, 3, 1)
    return first_order(s.t, squared, lag_s, squared[0]) * value


@_effect(LINEAR)
def odd_latitude(s, value, cycles):
    """Function of latitude."""
    return np.outer(np.sin(cycles * s.latitude) if cycles else s.latitude, value)


@_effect(LINEAR)
def odd_edge_spike(s, value, decay_s, signed):
    """Decaying spike after each edge, with the sign of the change if signed."""
    shape = np.zeros_like(s.t)
    for m in s.manoeuvres:
        jump = np.diff(m.current(m.edges), prepend=0.0)
        for edge, change in zip(m.edges, jump, strict=True):
            after = (s.t >= edge) & (s.t < edge + 20 * decay_s)
            shape[after] += (np.sign(change) if signed else 1.0) * np.exp(-(s.t[after] - edge) / decay_s)
    return np.outer(shape, value)


@_effect(LINEAR)
def odd_telegraph(s, value, rate_hz):
    """Random telegraph signal, one realisation for the whole day."""
    flips = np.cumsum(s.rng("telegraph").exponential(1 / rate_hz, int(86400 * rate_hz * 1.2) + 50))
    return np.outer(1.0 - 2.0 * (np.searchsorted(flips, s.t) % 2), value)


@_effect(LINEAR)
def odd_hysteresis(s, value, width_ma):
    """Play operator: follows the current only beyond half a width."""
    out, last = np.empty_like(s.total), 0.0
    for k, current in enumerate(s.total):
        last = min(max(last, current - width_ma / 2), current + width_ma / 2)
        out[k] = last
    return np.outer(out, value)


@_effect(LINEAR)
def odd_second_hand(s, value):
    """Saw-tooth of each GPS second."""
    return np.outer(s.t % 1.0 - 0.5, value)


@_effect(LINEAR)
def odd_rate_product(s, value):
    """Product of two rates off the reference."""
    return np.outer(s.rate_off[:, 0] * s.rate_off[:, 2], value)


@_effect(LINEAR)
def odd_pointing(s, value):
    """Leak from pointing error."""
    return s.pointing @ value.T


@_effect(LINEAR)
def odd_chirp(s, value, from_hz, to_hz):
    """Sine of rising frequency, in manoeuvres."""
    shape = np.zeros_like(s.t)
    for m in s.manoeuvres:
        x = s.t - m.start
        inside = (x >= 0) & (x < m.duration_s)
        phase = from_hz * x + (to_hz - from_hz) * x**2 / (2 * m.duration_s)
        shape += inside * np.sin(2 * np.pi * phase)
    return np.outer(shape, value)


@_effect(LINEAR)
def odd_current_latitude(s, value):
    """Current times sine of latitude."""
    return np.outer(s.total * np.sin(s.latitude), value)


@_effect(LINEAR)
def odd_settling(s, value, decay_s):
    """Exponential from the start of each manoeuvre."""
    shape = np.zeros_like(s.t)
    for m in s.manoeuvres:
        after = (s.t >= m.start) & (s.t < m.start + 30 * decay_s)
        shape[after] += np.exp(-(s.t[after] - m.start) / decay_s)
    return np.outer(shape, value)


@_effect(LINEAR)
def odd_gain_drift(s, value):
    """Gain that grows along each manoeuvre."""
    gain = np.zeros_like(s.t)
    for m in s.manoeuvres:
        x = (s.t - m.start) / m.duration_s
        gain += np.where((x >= 0) & (x < 1), x, 0.0)
    return gain[:, None] * s.linear * value


def total(table, scene, effects):
    """Sum over the effects of a table that are switched on."""
    out = np.zeros((len(scene.t), 3))
    for name, function in table.items():
        setting = effects[name.removesuffix("_angular") if name == "flexible_mode_angular" else name]
        if np.any(setting["value"]) or setting.get("angular"):
            out += function(scene, **setting)
    return out
