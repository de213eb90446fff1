"""What is drawn from the seed before an inertial sensor is simulated: factors, offset, biases, orbit."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from gravcal.effects import inertial_sensor as electrodes
from gravcal.physics import frames, gravity, sensing
from gravcal.physics.constants import EARTH_RADIUS, GM
from gravcal.simulation import orbit


@dataclass(frozen=True)
class Truth:
    """True numbers of the sensor.

    Attributes
    ----------
    k : (3,) m s-2 V-1; beta : (3,) rad s-2 V-1
    offset : (3,) m, centre of mass to test mass
    bias : (3,) m s-2, of f = b + k V; angular_bias : (3,) rad s-2
    inertia : (3,) kg m2 of the test mass
    delay : s, star-tracker tags late
    """

    k: np.ndarray
    beta: np.ndarray
    offset: np.ndarray
    bias: np.ndarray
    angular_bias: np.ndarray
    inertia: np.ndarray
    delay: float


def draw(satellite: Mapping, chosen, rng) -> Truth:
    """True numbers around those of the settings.

    Parameters
    ----------
    satellite : numbers of the catalogue, with `_sigma` beside them
    chosen : parameters of the simulation
    rng : source of randomness
    """
    share = 1 + chosen.factor_scatter * rng.standard_normal(2)
    beta = np.array(chosen.angular_factor) * share[[0, 1, 1]]
    mass, inertia, arm, k_y = _geometry(satellite, chosen, rng)
    ratio = electrodes.linear_over_angular(mass, inertia, arm)
    k = np.array([ratio[1] * beta[1], k_y, ratio[0] * beta[0]])
    offset = 1e-6 * (np.array(chosen.offset_um) + chosen.offset_scatter_um * rng.standard_normal(3))
    bias = np.array(chosen.bias_m_s2) * (1 + chosen.bias_scatter * rng.standard_normal(3))
    angular_bias = chosen.angular_bias_rad_s2 * rng.standard_normal(3)
    delay = chosen.delay_s + chosen.delay_scatter_s * rng.standard_normal()
    return Truth(k, beta, offset, bias, angular_bias, np.array(satellite["test_mass_inertia"]), float(delay))


def _geometry(satellite, chosen, rng):
    """Mass, inertia, arms and k_y: the catalogue's, or drawn from their prior."""
    arm = np.array([chosen.arm_x_mm * 1e-3, *satellite["electrode_arm"][1:]])
    spread = chosen.divisor_scatter * rng.standard_normal(5)
    mass = satellite["test_mass"] + satellite["test_mass_sigma"] * spread[0]
    inertia = (
        np.array(satellite["test_mass_inertia"]) + np.array(satellite["test_mass_inertia_sigma"]) * spread[[1, 2, 2]]
    )
    arm = arm + np.array(satellite["electrode_arm_sigma"]) * spread[3]
    return mass, inertia, arm, chosen.k_y * (1 + 0.1 * spread[4])


def draw_orbit(chosen, start: float, stop: float, rng) -> Callable[[np.ndarray], np.ndarray]:
    """Circular orbit from a random place, (n,) s -> (n, 6) m and m s-1."""
    node, argument = rng.uniform(0, 2 * np.pi, 2)
    state = orbit.initial_state(chosen.altitude_km * 1e3, np.radians(chosen.inclination_deg), 1e-4, node, argument)
    return orbit.fly_orbit(state, start - 60, stop + 60)


def orbital_rate(chosen) -> float:
    """Mean motion of the orbit, rad s-1."""
    return float(np.sqrt(GM / (EARTH_RADIUS + chosen.altitude_km * 1e3) ** 3))


def R_oi(state_i: np.ndarray) -> np.ndarray:
    """Rotation to the pointing of the sensor in normal flight: x radially outward, z along the flight, y = z x x.

    Parameters
    ----------
    state_i : (n, 6) m and m s-1
    """
    position, velocity = state_i[:, :3], state_i[:, 3:]
    x = position / np.linalg.norm(position, axis=1, keepdims=True)
    y = np.cross(velocity, position)
    y /= np.linalg.norm(y, axis=1, keepdims=True)
    return np.stack([x, y, np.cross(x, y)], axis=1)


def air_and_light_o(time: np.ndarray, chosen) -> np.ndarray:
    """Drag against the flight and solar pressure along the normal, in the pointing frame.

    Parameters
    ----------
    time : (n,) s
    """
    phase = orbital_rate(chosen) * time
    drag = chosen.drag_m_s2 * (1 + np.sin(phase) / 3 + 0.1 * np.sin(2 * phase + 1))
    light = np.full_like(drag, chosen.radiation_m_s2)
    return np.stack([0.1 * light * np.cos(phase), light, -drag], axis=1)


def electrostatic(time, quaternion, rate_b, rate_dot_b, state_i, truth: Truth, chosen) -> tuple[np.ndarray, np.ndarray]:
    """Acceleration and angular acceleration that hold the test mass in its cage, without noise.

    Parameters
    ----------
    time : (n,) s; quaternion : (n, 4); rate_b, rate_dot_b : (n, 3) rad s-1, rad s-2; state_i : (n, 6)
    truth : Truth; chosen : parameters of the simulation

    Returns
    -------
    linear_b : (n, 3) m s-2; angular_b : (n, 3) rad s-2

    Notes
    -----
    f = a_ng + (M - G) p; torque / J = w' + J^-1 (w x J w - vex(J G - G J)); equations.md M1 and section 8.5.
    """
    R_bi = frames.R_bi_from_quaternion(quaternion)
    R_bo = R_bi @ np.swapaxes(R_oi(state_i), 1, 2)
    gradient_b = gravity.rotate_tensor(R_bi, gravity.gradient_i(state_i[:, :3]))
    tensor = sensing.offset_tensor(rate_b, rate_dot_b, gradient_b)
    linear = np.matvec(R_bo, air_and_light_o(time, chosen)) + np.matvec(tensor, truth.offset)
    J = np.diag(truth.inertia)
    gravity_torque = frames.vex(J @ gradient_b - gradient_b @ J)
    gyroscopic = np.cross(rate_b, rate_b * truth.inertia)
    return linear, rate_dot_b + (gyroscopic - gravity_torque) / truth.inertia
