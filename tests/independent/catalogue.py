"""Names, units, signs and settings of all hidden effects."""

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Effect:
    """One hidden effect: unit and shape of its value, meaning with sign, and further settings with their defaults."""

    unit: str
    shape: str  # "scalar", "vector" (SRF x, y, z or rods) or "matrix" (row = output axis, column = input axis)
    about: str
    settings: dict = field(default_factory=dict)


TIMING = {
    "acc_delay_s": Effect("s", "scalar", "all ACC1A tags late by this"),
    "sca_delay_s": Effect("s", "scalar", "all SCA1B tags late by this"),
    "mag_delay_s": Effect("s", "scalar", "all MAG1B tags (field and currents) late by this"),
}
TORQUE = {
    "dipole_gain": Effect("1", "vector", "dipole of each rod = (1 + value) k current"),
    "torque_lag_s": Effect("s", "scalar", "dipole follows the current with this first-order lag"),
    "residual_dipole": Effect("A m2", "vector", "constant dipole"),
    "inertia_products": Effect("kg m2", "vector", "true J_xy, J_xz, J_yz elements"),
}
READING = {
    "ang_scale": Effect("1", "vector", "angular reading = (1 + value) truth"),
    "mag_scale": Effect("1", "vector", "magnetometer = (1 + value) field"),
    "mag_current_leak": Effect("nT/mA", "matrix", "magnetometer row axis from column rod"),
}
ADDED = {
    "acc_current_leak": Effect("m s-2/mA", "matrix", "linear reading, row axis from column rod"),
    "acc_tone": Effect("m s-2", "vector", "sine", {"frequency_hz": 0.05, "phase": None}),
    "odd_field_current": Effect("m s-2/(mA T)", "vector", "|B| times summed current"),
    "odd_current_squared": Effect("m s-2/mA2", "vector", "summed current squared, lagged", {"lag_s": 2.0}),
    "odd_latitude": Effect(
        "m s-2", "vector", "value sin(cycles latitude); cycles 0: latitude itself", {"cycles": 60.0}
    ),
    "odd_edge_spike": Effect("m s-2", "vector", "spike after each edge", {"decay_s": 0.7, "signed": True}),
    "odd_telegraph": Effect("m s-2", "vector", "random telegraph +-value", {"rate_hz": 0.05}),
    "odd_hysteresis": Effect("m s-2/mA", "vector", "play operator of summed current", {"width_ma": 60.0}),
    "odd_second_hand": Effect("m s-2", "vector", "saw-tooth of each GPS second"),
    "odd_rate_product": Effect("m", "vector", "value x (rates off the reference: x times z)"),
    "odd_chirp": Effect("m s-2", "vector", "chirp within each manoeuvre", {"from_hz": 0.03, "to_hz": 0.3}),
}
EFFECTS = TIMING | TORQUE | READING | ADDED
_AXES = {"x": 0, "y": 1, "z": 2}


def vector(value):
    """(3,) from a number (all axes), a mapping such as {"y": 1e-9}, or three numbers."""
    if isinstance(value, dict):
        out = np.zeros(3)
        for axis, number in value.items():
            out[_AXES[axis]] = number
        return out
    return np.broadcast_to(np.asarray(value, float), (3,)).copy()


def matrix(value):
    """(3, 3) from a mapping such as {"yx": 1e-9} (output y, input x) or nine numbers."""
    if isinstance(value, dict):
        out = np.zeros((3, 3))
        for (row, column), number in value.items():
            out[_AXES[row], _AXES[column]] = number
        return out
    return np.asarray(value, float).reshape(3, 3)


_SHAPES = {"scalar": float, "vector": vector, "matrix": matrix}


def parse(effects):
    """Mapping name -> {"value": number or array, **settings}, every name of the catalogue present (zero by default)."""
    unknown = set(effects) - set(EFFECTS)
    if unknown:
        raise ValueError(f"unknown effects {sorted(unknown)}; known: {sorted(EFFECTS)}")
    zero = {"scalar": 0.0, "vector": 0.0, "matrix": np.zeros((3, 3))}
    out = {}
    for name, effect in EFFECTS.items():
        given = effects.get(name, zero[effect.shape])
        if not (isinstance(given, dict) and "value" in given):
            given = {"value": given}
        if set(given) - {"value", *effect.settings}:
            raise ValueError(f"{name}: settings are value, {', '.join(effect.settings)}; got {sorted(given)}")
        out[name] = effect.settings | given | {"value": _SHAPES[effect.shape](given["value"])}
    return out
