"""Shapes, units, signs and settings of all hidden effects."""

import numpy as np

TIMING = ("acc_delay_s", "sca_delay_s")  # s, all tags of ACC1A or SCA1B late by this
#: Shape of the value: "scalar", "vector" (SRF x, y, z or rods) or "matrix" (row = output axis, column = input axis);
#: further settings with their defaults.
EFFECTS = dict.fromkeys(TIMING, ("scalar", {})) | {
    "dipole_gain": ("vector", {}),  # 1, dipole of each rod = (1 + value) k current
    "torque_lag_s": ("scalar", {}),  # s, dipole follows the current with this first-order lag
    "mag_scale": ("vector", {}),  # 1, magnetometer = (1 + value) field
    "mag_current_leak": ("matrix", {}),  # nT/mA, magnetometer row axis from column rod
    "acc_current_leak": ("matrix", {}),  # m s-2/mA, linear reading, row axis from column rod
    "acc_tone": ("vector", {"frequency_hz": 0.05, "phase": None}),  # m s-2, sine
    "odd_field_current": ("vector", {}),  # m s-2/(mA T), |B| times summed current
    "odd_current_squared": ("vector", {"lag_s": 2.0}),  # m s-2/mA2, summed current squared, lagged
    "odd_latitude": ("vector", {"cycles": 60.0}),  # m s-2, sin(cycles latitude); cycles 0: latitude itself
    "odd_edge_spike": ("vector", {"decay_s": 0.7, "signed": True}),  # m s-2, spike after each edge
    "odd_telegraph": ("vector", {"rate_hz": 0.05}),  # m s-2, random telegraph +-value
    "odd_hysteresis": ("vector", {"width_ma": 60.0}),  # m s-2/mA, play operator of summed current
    "odd_second_hand": ("vector", {}),  # m s-2, saw-tooth of each GPS second
    "odd_rate_product": ("vector", {}),  # m, rates off the reference: x times z
    "odd_chirp": ("vector", {"from_hz": 0.03, "to_hz": 0.3}),  # m s-2, chirp within each manoeuvre
}


def array(value, shape):
    """Number, (3,) or (3, 3); of a mapping such as {"y": 1e-9} or {"yx": 1e-9} (output y, input x) the rest is zero."""
    size = {"scalar": (), "vector": (3,), "matrix": (3, 3)}[shape]
    if not isinstance(value, dict):
        return np.broadcast_to(np.asarray(value, float), size).copy()
    out = np.zeros(size)
    for axes, number in value.items():
        out[tuple(map("xyz".index, axes))] = number
    return out


def parse(effects):
    """Mapping name -> {"value": number or array, **settings}, every name of the catalogue present (zero by default)."""
    if unknown := effects.keys() - EFFECTS.keys():
        raise ValueError(f"unknown effects {sorted(unknown)}; known: {sorted(EFFECTS)}")
    out = {}
    for name, (shape, defaults) in EFFECTS.items():
        given = effects.get(name, 0.0)
        given = given if isinstance(given, dict) and "value" in given else {"value": given}
        if given.keys() - {"value", *defaults}:
            raise ValueError(f"{name}: settings are value, {', '.join(defaults)}; got {sorted(given)}")
        out[name] = defaults | given | {"value": array(given["value"], shape)}
    return out
