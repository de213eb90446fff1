"""Gravity gradient in b along the orbit, what the sensors of S-GRS feel there, as printed and corrected, and its rank.

Sign: the files hold the motion of a test mass relative to the satellite, minus what an accelerometer reads. Equations
are those of equations.md, section 8.5, printed ones 13-16.
"""

from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline

from gravcal.calibrations import schemas
from gravcal.calibrations.gradient_torque import attitude
from gravcal.calibrations.schemas import build
from gravcal.errors import EstimationError, refuse
from gravcal.physics import earth, gravity
from gravcal.physics.dynamics import gravity_gradient_torque
from gravcal.physics.frames import cross_matrix, quaternion_product
from gravcal.physics.sensing import offset_tensor

SCHEMAS = schemas.of("gradient_torque.toml")

METHODS = ("one_sensor", "two_sensor")
#: Independent elements xx, yy, xy, xz, yz of a symmetric tensor without trace; zz is -xx - yy.
ELEMENTS = np.zeros((5, 3, 3))
for _k, (_i, _j) in enumerate(((0, 0), (1, 1), (0, 1), (0, 2), (1, 2))):
    ELEMENTS[_k, _i, _j] = ELEMENTS[_k, _j, _i] = 1.0
ELEMENTS[:2, 2, 2] = -1.0
UNKNOWNS = ("G_xx", "G_yy", "G_xy", "G_xz", "G_yz", "drag_x", "drag_y", "drag_z")
GRADIENT_SCALE, DRAG_SCALE = 1e-6, 1e-7  # s-2, m s-2; unknowns of one size, so that a rank means something
CUT = "Cut the record there, or raise gap_limit_s (errors grow in the gap)."
TOLERANCE = 1e-9  # singular values below this share of the largest count as zero


def field(read: gravity.Field) -> xr.Dataset:
    """Product "gradient_torque.field" of a gravity field."""
    values = {name: getattr(read, name) for name in SCHEMAS["field"]}
    return build(SCHEMAS["field"], values, title="Gravity field", field=read.name)


def truth(read: xr.Dataset) -> xr.Dataset:
    """Product "gradient_torque.truth" of the "ingest" of a file of truth."""
    values = {"time": read["time"].values, "drag_b": read["drag"].values}
    return build(SCHEMAS["truth"], values, title="Drag of a simulated day")


def field_of(stored: xr.Dataset) -> gravity.Field:
    """Gravity field of a product "gradient_torque.field"."""
    parts = (stored[name].values for name in ("cosine", "sine", "cosine_sigma", "sine_sigma"))
    return gravity.Field(float(stored["gm"]), float(stored["radius"]), *parts, name=stored.attrs.get("field", ""))


def orbit(observed: xr.Dataset, gap_limit_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Position m and velocity m s-1 in i, (n, 3) each, of an SGRS file; gaps up to a limit filled by a cubic spline."""
    time, columns = observed["time"].values, []
    for name in ("position", "velocity"):
        values = observed[name].values
        good = np.isfinite(values).all(axis=1)
        if not good.all():
            known = time[good]
            worst = max(np.diff(known).max(), known[0] - time[0], time[-1] - known[-1]) if known.size > 3 else np.inf
            if worst > gap_limit_s:
                missing = f"{worst:.0f} s without position or velocity"
                refuse("SGRS file", missing, f"at most {gap_limit_s:g} s", CUT, EstimationError, gap=float(worst))
            values = CubicSpline(known - time[0], values[good])(time - time[0])
        columns.append(values)
    return tuple(columns)


def gradient(
    observed: xr.Dataset,
    stored: xr.Dataset,
    *,
    field_degree: int,
    knot_step_s: float,
    gap_limit_s: float,
    single_sensor: int,
    elongation: float,
    satellite: dict,
) -> xr.Dataset:
    """Product "gradient_torque.gradient": gravity gradient in b, rates, their errors; of an SGRS file and a field.

    The satellite has attitude_noise, angular_noise_density, test_mass, test_mass_inertia of the catalogue.
    """
    time, places = observed["time"].values, observed["sensor_position"].values
    if single_sensor > len(places):
        refuse("single_sensor", f"{len(places)} sensor", f"at least {single_sensor}", "Set it to 1.", EstimationError)
    if time.size < 60:
        refuse("SGRS file", f"{time.size} epochs", "at least 60", "Give a longer record.", EstimationError)
    worst = float(np.diff(time).max())
    if worst > gap_limit_s:
        refuse("SGRS file", f"a gap of {worst:.0f} s", f"none above {gap_limit_s:g} s", CUT, EstimationError, gap=worst)
    model = gravity.truncated(field_of(stored), 0, field_degree)
    position, velocity = orbit(observed, gap_limit_s)
    R_ei = earth.R_ei(time)
    gradient_e = gravity.gradient_e(model, np.matvec(R_ei, position))
    gradient_i = gravity.rotate_tensor(np.swapaxes(R_ei, 1, 2), gradient_e)
    frame = attitude.orbit_frame(position, velocity), *attitude.orbit_rates(time, position, velocity)
    quaternion = observed["q"].values
    quaternion = np.where(np.linalg.norm(quaternion, axis=1, keepdims=True) > 0.5, quaternion, np.nan)
    inertia, density = box_inertia(satellite, elongation), np.array(satellite["angular_noise_density"])

    def free(R_bi, rate_b):
        """Angular acceleration (n, 3) rad s-2 of the free test mass, attitude R_bi (n, 3, 3), rate_b (n, 3) rad s-1."""
        return free_mass_angular_acceleration(inertia, gravity.rotate_tensor(R_bi, gradient_i), rate_b)

    sensors = {"one_sensor": [min(single_sensor, len(places)) - 1], "two_sensor": list(range(len(places)))}
    smoothed, covariance = [], []
    for sensor_numbers in (sensors[name] for name in METHODS):
        motion = attitude.smooth(
            time,
            quaternion,
            observed["angular"].values[:, sensor_numbers].mean(axis=1),
            frame,
            free,
            angle_sigma=np.array(satellite["attitude_noise"]),
            angular_sigma=density / np.sqrt(2 * float(np.median(np.diff(time))) * len(sensor_numbers)),
            knot_step=knot_step_s,
        )
        gradient_b = gravity.rotate_tensor(motion.R_bi, gradient_i)
        errors = offset_tensor_error(motion.rate_b, gradient_b, places[sensor_numbers].mean(axis=0))
        smoothed.append(motion)
        covariance.append(motion.covariance_of(*errors))
    values = {
        "time": time,
        "linear_b": observed["linear"].values,
        "angular_b": observed["angular"].values,
        "sensor_position_b": places,
        "gradient_b": gradient_b,  # with the attitude by all sensors
        "gradient_variance": gravity.error_covariance(model, np.linalg.norm(position, axis=1).mean()),
        "up_b": np.matvec(motion.R_bi, position / np.linalg.norm(position, axis=1, keepdims=True)),
        "motion_covariance": np.stack(covariance),
        "attitude_chi2": [motion.chi2 for motion in smoothed],
        "attitude_dof": [motion.dof for motion in smoothed],
    }
    values |= {"torque": observed["torque"].values} if "torque" in observed else {}
    for name in ("angle", "angle_dot", "rate_b", "rate_dot_b"):
        values[name] = np.stack([getattr(motion, name) for motion in smoothed])
    return build(SCHEMAS["gradient"], values, title="Gravity gradient and rates along the orbit", field=model.name)


def torque(
    modelled: xr.Dataset,
    observed: xr.Dataset,
    stored: xr.Dataset,
    *,
    lowest_degree: int,
    highest_degree: int,
    spectrum_step_s: float,
    elongation: float,
    satellite: dict,
) -> xr.Dataset:
    """Product "gradient_torque.torque": amplitude spectra by zonal degree, and the angular noise of the sensor.

    Attitude (`modelled`, by all sensors) is that of "gradient_torque.gradient", `stored` the field; the satellite has
    inertia, test_mass(_inertia), angular_noise_density (1.5 bins of a Hann spectrum), panel_area, _normal, _centre.
    """
    time, (position, velocity) = observed["time"].values, orbit(observed, np.inf)
    every = slice(None, None, max(1, round(spectrum_step_s / float(np.median(np.diff(time))))))
    R_ei = earth.R_ei(time[every])
    R_oi = attitude.orbit_frame(position[every], velocity[every])
    R_be = attitude.R_bo(modelled["angle"].values[-1][every]) @ R_oi @ np.swapaxes(R_ei, 1, 2)
    position_e, known = np.matvec(R_ei, position[every]), field_of(stored)
    if known.degree < highest_degree:
        remedy = f"Give highest_degree={known.degree}, or a field that goes further."
        refuse(known.name or "field", f"degree {known.degree}", f"at least highest_degree {highest_degree}", remedy)
    degrees = np.arange(lowest_degree, highest_degree + 1)
    test_mass, body = box_inertia(satellite, elongation), np.array(satellite["inertia"])
    relative, free_mass = np.zeros((2, degrees.size, len(position_e), 3))
    for k, degree in enumerate(degrees):
        tensor = gravity.rotate_tensor(R_be, gravity.gradient_e(gravity.zonal(known, degree), position_e))
        relative[k] = gradient_angular_acceleration(test_mass, body, tensor)
        free_mass[k] = free_mass_angular_acceleration(test_mass, tensor, np.zeros(3))
    step = float(np.median(np.diff(time[every])))
    frequency, amplitude = amplitude_spectrum(relative, step)
    facing = np.array(satellite["panel_area"]) * np.maximum(np.array(satellite["panel_normal"])[:, 0], 0)  # flight: x
    values = {
        "degree": degrees,
        "frequency": frequency,
        "amplitude": np.moveaxis(amplitude, 1, 2),
        "rms": np.sqrt(np.mean(relative**2, axis=1)),
        "test_mass_rms": np.sqrt(np.mean(free_mass**2, axis=1)),
        "inertia": body,
        "area_centre": centre_of_pressure(satellite["panel_area"], satellite["panel_centre"]),
        "facing_centre": centre_of_pressure(facing, satellite["panel_centre"]),
        "sensitivity": np.array(satellite["angular_noise_density"]) * np.sqrt(2 * 1.5 / (step * relative.shape[1])),
    }
    return build(SCHEMAS["torque"], values, title="Gravity-gradient torque by zonal degree", elongation=elongation)


def amplitude_spectrum(series: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequency (m,) Hz above zero, Hann-windowed sine amplitude (..., m, k) of series (..., n, k); gaps bridged."""
    n = series.shape[-2]
    window, index = np.hanning(n)[:, None], np.arange(n)
    missing = ~np.isfinite(series).all(axis=-1)
    if missing.any():
        series = series.copy()
        for place in np.ndindex(series.shape[:-2]):
            lost = missing[place]
            for column in series[place].T if not lost.all() else ():
                column[lost] = np.interp(index[lost], index[~lost], column[~lost])
    spectrum = np.fft.rfft(window * (series - series.mean(axis=-2, keepdims=True)), axis=-2)
    return np.fft.rfftfreq(n, step)[1:], np.abs(spectrum[..., 1:, :]) * 2 / window.sum()


def drag(
    linear_b: np.ndarray,
    rate_b: np.ndarray,
    rate_dot_b: np.ndarray,
    gradient_b: np.ndarray,
    com_to_test_mass_b: np.ndarray,
) -> np.ndarray:
    """Non-gravitational acceleration of the centre of mass from one sensor or two.

    Parameters
    ----------
    linear_b : (n, k, 3) m s-2, test masses relative to the spacecraft
    rate_b, rate_dot_b : (n, 3) rad s-1, rad s-2
    gradient_b : (n, 3, 3) s-2, dg/dr
    com_to_test_mass_b : (k, 3) m

    Returns
    -------
    drag_b : (n, 3) m s-2

    Notes
    -----
    a_TM/B = (G - M) r - a_drag, so a_drag = -mean(a_k) + (G - M) mean(r_k); S-GRS paper, eqs. 4-6 with the rate terms
    where they belong (erratum S-2) and eq. 10, which lacks the second term (erratum S-3). Errors of one sensor are
    those of T r: `gravcal.calibrations.gradient_torque.estimate` adds them up.

    Examples
    --------
    >>> import numpy as np
    >>> from gravcal import gradient_torque
    >>> gradient = np.diag([-1.2e-6, -1.2e-6, 2.4e-6])
    >>> place, still = np.array([[0.1, 0.0, 0.0]]), np.zeros((5, 3))
    >>> reading = np.tile(gradient @ place[0] - [1e-7, 0.0, 0.0], (5, 1, 1))
    >>> drag_b = gradient_torque.drag(reading, still, still, np.tile(gradient, (5, 1, 1)), place)
    >>> bool(np.allclose(drag_b, [1e-7, 0.0, 0.0], atol=1e-20))
    True
    """
    tensor = offset_tensor(np.asarray(rate_b), np.asarray(rate_dot_b), np.asarray(gradient_b))
    return -np.mean(linear_b, axis=-2) - np.matvec(tensor, np.mean(com_to_test_mass_b, axis=0))


def free_mass_angular_acceleration(inertia, gradient_b, rate_b):
    """Angular acceleration (..., 3) rad s-2 of a free test mass that turns with the satellite; zero for a cube.

    I^-1 [vex(I G - G I) - w x I w]; S-GRS paper, eqs. 1 and 7, with the inertia of the test mass (errata S-4, S-5).
    """
    J = np.asarray(inertia, float)
    gyroscopic = np.cross(rate_b, np.matvec(J, rate_b))
    return np.matvec(np.linalg.inv(J), gravity_gradient_torque(J, gradient_b) - gyroscopic)


def gradient_angular_acceleration(test_mass_inertia, inertia, gradient_b):
    """Relative angular acceleration (..., 3) rad s-2 of test mass and satellite from the gravity gradient alone.

    I_TM^-1 vex(I_TM G - G I_TM) - I_B^-1 vex(I_B G - G I_B); S-GRS paper, eqs. 7-9.
    """
    at_rest = np.zeros(3)
    test_mass = free_mass_angular_acceleration(test_mass_inertia, gradient_b, at_rest)
    return test_mass - free_mass_angular_acceleration(inertia, gradient_b, at_rest)


def box_inertia(satellite, elongation):
    """Inertia (3, 3) kg m2 of a homogeneous box with the mass and volume of a catalogued cube, longer along x.

    The elongation is the length along x over the other two; 1 is the cube.
    """
    mass = satellite["test_mass"]
    side = np.sqrt(6 * np.trace(np.array(satellite["test_mass_inertia"])) / 3 / mass)
    across = side * elongation ** (-1 / 3)
    x, y, z = np.array([elongation * across, across, across]) ** 2
    return mass / 12 * np.diag([y + z, x + z, x + y])


def offset_tensor_error(rate_b, gradient_b, offset_b):
    """Derivative (..., 3, 3) of the product T p by attitude (small rotation in b), rate and angular acceleration."""
    w, p = np.asarray(rate_b, float), np.asarray(offset_b, float)
    by_rate = -cross_matrix(np.cross(w, p)) - cross_matrix(w) @ cross_matrix(p)
    by_angle = -(cross_matrix(np.matvec(gradient_b, p)) - gradient_b @ cross_matrix(p))
    return by_angle, by_rate, np.broadcast_to(-cross_matrix(p), by_rate.shape)


def printed_torque(inertia, gradient_b, place_b):
    """Torque (..., 3) N m as printed, from the difference of gravity over a place (3,) m without a zero.

    Notes
    -----
    dg x (I q), dg = G D, q = (1/Dx, 1/Dy, 1/Dz); S-GRS paper eqs. 2, 3, right where G = dg q^T only (erratum S-1).
    """
    place = np.asarray(place_b, float)
    return np.cross(np.matvec(gradient_b, place), np.asarray(inertia) @ (1 / place))


def centre_of_pressure(area, centre_b):
    """Mean (3,) m, to a nanometre, of the centres (n, 3) m of panels by area (n,) m2, theirs or as the flow sees it.

    x_cp = sum A_k x_k / sum A_k; S-GRS paper, after eq. 11.
    """
    return np.average(centre_b, axis=0, weights=area).round(9) + 0.0  # no minus nought


def printed_vectors(inertia, test_mass_inertia, mass, com_to_pressure_b, separation_b):
    """Vector parts h, q_d (3,) m-1 of the printed quaternions q_H and q_drag; no component of the separation is zero.

    H = -I_B (1/Dx, 1/Dy, 1/Dz), h = (I_TM^-1 - I_B^-1) H, q_d = m_B I_B^-1 x_cp; printed eqs. 3, 13, 15.
    """
    H = -np.asarray(inertia) @ (1 / np.asarray(separation_b, float))
    h = (np.linalg.inv(test_mass_inertia) - np.linalg.inv(inertia)) @ H
    return h, mass * np.linalg.solve(inertia, com_to_pressure_b)


def printed_drag(linear_b, angular_b, h, q_d):
    """Drag by the printed one-sensor algorithm, through quaternion products: vector part (n, 3) and scalar part (n,).

    a = (q_H^-1 q_drag - 1)^-1 [a_TM/B - q_H^-1 al_TM/B]; S-GRS paper, eq. 16 with the other terms zero. A quaternion
    product is not a cross product (erratum S-6); the scalar part is zero, so it gives no warning.
    """
    h, q_d, linear, angular = (np.insert(np.asarray(v, float), 0, 0.0, axis=-1) for v in (h, q_d, linear_b, angular_b))
    inverse = _inverse(h)
    left = quaternion_product(inverse, q_d) - np.array([1.0, 0, 0, 0])
    right = linear - quaternion_product(np.broadcast_to(inverse, linear.shape), angular)
    drag = quaternion_product(np.broadcast_to(_inverse(left), linear.shape), right)
    return drag[:, 1:], drag[:, 0]


def _inverse(quaternion):
    """Inverse of a quaternion (4,), scalar first, not necessarily of unit norm."""
    return quaternion * np.array([1.0, -1, -1, -1]) / np.sum(quaternion**2)


@dataclass(frozen=True)
class Sensor:
    """One sensor on a satellite."""

    inertia: np.ndarray  #: (3, 3) kg m2
    test_mass_inertia: np.ndarray  #: (3, 3) kg m2
    mass: float  #: kg
    place: np.ndarray  #: (3,) m, test mass from the CoM
    pressure: np.ndarray  #: (3,) m, centre of pressure from the CoM


@dataclass(frozen=True)
class Motion:
    """A few epochs and how well they are known."""

    rate_b: np.ndarray  #: (n, 3) rad s-1
    rate_dot_b: np.ndarray  #: (n, 3) rad s-2
    drag_b: np.ndarray  #: (n, 3) m s-2
    gradient_b: np.ndarray  #: (n, 3, 3) s-2
    #: standard deviations of linear (3,) m s-2 and angular (3,) rad s-2 readings, place (3,) m, gradient s-2, angular
    #: acceleration "motion" rad s-2, centre of pressure (3,) m, change of the torque from epoch to epoch N m
    sigma: dict[str, np.ndarray | float]


def single_epoch(sensor):
    """Rank and null space of six readings of a Sensor for five elements of the tensor and three of the drag.

    The null space (k, 8) holds combinations of UNKNOWNS in units of 1e-6 s-2 and 1e-7 m s-2 that change no reading:
    equations.md, erratum S-8: eight unknowns, rank six; the diagonal of the tensor enters no torque.
    """
    by_drag = sensor.mass * (np.linalg.inv(sensor.inertia) @ cross_matrix(sensor.pressure)).T
    by_element = gradient_angular_acceleration(sensor.test_mass_inertia, sensor.inertia, ELEMENTS)
    linear = np.concatenate([ELEMENTS @ sensor.place, -np.eye(3)]).T
    angular = np.concatenate([by_element, -by_drag]).T
    scale = np.array([GRADIENT_SCALE] * 5 + [DRAG_SCALE] * 3)
    return _rank_and_null(np.concatenate([linear, angular]) * scale)


def printed_pair(h, q_d):
    """Rank and null vector of the printed pair a = Dg - a_drag, al = h x Dg - q_d x a_drag.

    The unit vector (6,) of (Dg, drag) is along q_d - h in both halves (erratum S-6).
    """
    top = np.concatenate([np.eye(3), -np.eye(3)], axis=1)
    below = np.concatenate([cross_matrix(h), -cross_matrix(q_d)], axis=1) / np.linalg.norm(h)
    rank, null = _rank_and_null(np.concatenate([top, below]))
    return rank, null[0]


def joint(sensor, motion):
    """Rank and drag errors of several epochs together, a list of steps that each add one piece of knowledge.

    Each step is (name, rank, number of unknowns, sigma (3,) m s-2 of the middle drag, NaN if not determined). Unknowns
    of each epoch: drag, five elements of G, angular acceleration, torque beside gradient and drag; of all epochs:
    centre of pressure and place of the test mass. Equations: reading, angular reading, torque balance.
    """
    count, sigma = len(motion.drag_b), motion.sigma
    size = 14 * count + 6

    def held(start, weights, every_epoch=True):
        """Rows that constrain neighbouring unknowns, from number `start` on, of every epoch or of the shared ones."""
        unknowns = start + np.arange(len(weights)) + (14 * np.arange(count)[:, None] if every_epoch else 14 * count)
        rows = np.zeros((unknowns.size, size))
        rows[np.arange(unknowns.size), unknowns.ravel()] = np.resize(weights, unknowns.size)
        return rows

    torque = held(11, np.full(3, 1 / sigma["torque"]))
    knowledge = {
        "readings and torque balance": _readings(sensor, motion),
        "place of the test mass": held(3, 1 / np.asarray(sigma["place"]), every_epoch=False),
        "gravity field": held(3, np.full(5, 1 / sigma["gradient"])),
        "smooth rotation, star camera": held(8, np.full(3, 1 / sigma["motion"])),
        "centre of pressure": held(0, 1 / np.asarray(sigma["pressure"]), every_epoch=False),
        "slow torque": torque[3:] - torque[:-3],
        "place of the test mass to 1 um": held(3, np.full(3, 1e6), every_epoch=False),
    }
    scale = np.concatenate([np.tile([1e-7] * 3 + [1e-6] * 5 + [1e-8] * 3 + [1e-5] * 3, count), [0.1] * 3 + [1e-3] * 3])
    drag = slice(14 * (count // 2), 14 * (count // 2) + 3)
    steps, rows = [], np.zeros((0, size))
    for name, added in knowledge.items():
        rows = np.concatenate([rows, added * scale])
        rank, null = _rank_and_null(rows / np.linalg.norm(rows, axis=1, keepdims=True))
        _, singular, right = np.linalg.svd(rows, full_matrices=False)
        kept = singular > 1e-13 * singular[0]
        covariance = (right[kept].T / singular[kept] ** 2) @ right[kept]
        undetermined = np.abs(null[:, drag]).max(axis=0, initial=0.0) > 1e-6
        drag_sigma = np.sqrt(np.diag(covariance)[drag]) * scale[drag]
        steps.append((name, rank, size, np.where(undetermined, np.nan, drag_sigma)))
    return steps


def _readings(sensor, motion):
    """Whitened rows (9 n, 14 n + 6) of the three equations of a Sensor at the n epochs of a Motion, for `joint`."""
    count, J = len(motion.drag_b), sensor.inertia
    tensor = offset_tensor(motion.rate_b, motion.rate_dot_b, motion.gradient_b)
    block = np.zeros((9, 14))
    block[:3, :3], block[:3, 3:8] = -np.eye(3), (ELEMENTS @ sensor.place).T
    block[:3, 8:11] = cross_matrix(sensor.place)
    block[3:6, 3:8] = free_mass_angular_acceleration(sensor.test_mass_inertia, ELEMENTS, np.zeros(3)).T
    block[3:6, 8:11] = -np.eye(3)
    block[6:, :3] = -sensor.mass * cross_matrix(sensor.pressure)
    block[6:, 3:8] = -gravity_gradient_torque(J, ELEMENTS).T
    block[6:, 8:11], block[6:, 11:14] = J, -np.eye(3)
    rows = np.zeros((count, 9, 14 * count + 6))
    for k in range(count):
        rows[k, :, 14 * k : 14 * k + 14] = block
        rows[k, 6:, -6:-3] = sensor.mass * cross_matrix(motion.drag_b[k])
        rows[k, :3, -3:] = -tensor[k]
    exact = 1e-3 * np.asarray(motion.sigma["angular"]) * np.diag(J)  # the balance is an identity
    weight = 1 / np.concatenate([motion.sigma["linear"], motion.sigma["angular"], exact])
    return (rows * weight[:, None]).reshape(9 * count, -1)


def _rank_and_null(matrix):
    """Numerical rank and orthonormal basis of the null space, as rows, of a matrix after scaling its rows to one."""
    matrix = matrix / np.maximum(np.linalg.norm(matrix, axis=1, keepdims=True), 1e-300)
    _, singular, right = np.linalg.svd(matrix)
    rank = int(np.count_nonzero(singular > TOLERANCE * singular[0]))
    return rank, right[rank:]
