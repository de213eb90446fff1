"""What the instruments report of a scene; SRF until the writer turns axes."""

import numpy as np
from scipy.spatial.transform import Rotation

from . import added, noise
from .scene import stream

BIAS = {  # SRF; the files of 2023
    "C": ([-2.8e-7, -1.06e-5, -1.8e-7], [-7.8e-4, 1.3e-5, 1.19e-4]),
    "D": ([-3.2e-6, -1.46e-5, 2.4e-6], [-6.98e-4, 1.86e-4, -1.50e-3]),
}
LINEAR_STEP = np.array([7.85255281e-12, 7.15051994e-11, 7.92321655e-12])  # SRF x, y, z
ANGULAR_STEP = np.array([1.01327896e-8, 6.10947609e-10, 1.01327896e-8])
FIELD_STEP_UT = 65.0 / 32768


def loudness(scene, kind):
    """Amplitude of the noise of an instrument in this window."""
    s = scene.world.settings
    change = stream(scene.world.seed, "loudness " + kind, round(scene.t[0])).normal() if s.noise_change else 0.0
    return np.exp(s.noise_change * change)


def accelerometer(scene, keep):
    """Linear and angular readings (m, 3) at grid indices, noiseless: f = a_ng + (M - G) p with p = -offset."""
    p, w = np.tile(-1e-6 * np.asarray(scene.world.settings.offset_um, float), (len(scene.t), 1)), scene.rate
    spin = np.cross(w, np.cross(w, p)) + np.cross(scene.rate_dot, p)
    turn = scene.rotation
    tidal = turn.inv().apply(np.einsum("nij,nj->ni", scene.world.orbit.gradient(scene.t), turn.apply(p)))
    linear = scene.world.force(scene.t) + spin - tidal + added.total(scene, scene.world.effects)
    return linear[keep], scene.rate_dot[keep]


def spoil(scene, linear, angular):
    """Add noise and bias, and quantise."""
    world = scene.world
    s, start = world.settings, round(scene.t[0])
    for kind, values, tables in (("lin", linear, noise.LINEAR), ("ang", angular, noise.ANGULAR)):
        series = noise.coloured(stream(world.seed, kind, start), len(values), tables)
        values += loudness(scene, kind) * series
    linear, angular = linear + BIAS[s.satellite][0], angular + BIAS[s.satellite][1]
    return np.rint(linear / LINEAR_STEP) * LINEAR_STEP, np.rint(angular / ANGULAR_STEP) * ANGULAR_STEP


def star_camera(scene, keep):
    """Quaternions (m, 4), scalar first, of the attitude at grid indices."""
    rng = stream(scene.world.seed, "sca", round(scene.t[0]))
    error = rng.normal(0, 1, (len(keep), 3)) * 3e-6 * loudness(scene, "sca")  # rad
    return (scene.rotation[keep] * Rotation.from_rotvec(error)).as_quat(canonical=False, scalar_first=True)


def magnetometer(scene, keep, half):
    """Field in uT, renewed once a second (rows with half = 1, repeated by the next row), and currents in mA."""
    world = scene.world
    e = world.effects
    current = scene.current[keep]
    field = scene.field[keep] * 1e6 * (1 + e["mag_scale"]["value"])
    field = field + 1e-3 * (world.mag_bias_nt + current @ e["mag_current_leak"]["value"].T)
    rng = stream(world.seed, "mag", round(scene.t[0]))
    field = field + rng.normal(0, 5e-3 * loudness(scene, "mag"), field.shape)
    repeat = np.flatnonzero(half == 0)
    field[repeat[repeat > 0]] = field[repeat[repeat > 0] - 1]
    field, current = np.rint(field / FIELD_STEP_UT) * FIELD_STEP_UT, np.rint(current / world.step_ma) * world.step_ma
    return field.astype(np.float32), current.astype(np.float32)
