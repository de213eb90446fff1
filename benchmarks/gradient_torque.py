"""Gravity gradient along an orbit against other packages, recovery of the drag, and what an angular reading shows."""

import statistics
import time
import timeit

import numpy as np
import xarray as xr

from benchmarks.tables import Figure, interval, numbers, of_tests, rms, say, show, study, title
from gravcal import catalog
from gravcal.calibrations.gradient_torque import estimate, model
from gravcal.io import icgem
from gravcal.io.daily import LAYOUTS
from gravcal.physics import frames, gravity
from gravcal.simulation import gradient_torque as simulation

EPOCHS, ROUNDS = 17280, 5
DAY = 633830400.0
VARIANTS = ("two_sensor", "one_sensor", "one_sensor_published")
GRACE_M_S2, CUBE_M = 3e-10, 0.03  # linear noise of GRACE per root hertz, and size of the test mass
FACTORS = {"assumed": None, "GRACE": 1.0, "40 x": 40.0, "500 x": 500.0}  # linear sensitivity over that of GRACE
SEEN = 5.0  # matched signal over noise
POINTING = 5e-3  # rad: aligned axes feel no torque of a sphere


def gradient_speed(_options) -> list[Figure]:
    """Times of all candidates on one core; pyharm and pyshtools where they can be imported."""
    position, figures = orbit_points(), []
    for degree in (60, 200):
        title(f"gradient: degree {degree}, {EPOCHS} epochs, one thread, least processor time")
        field, rounds = of_tests("physics.physics_references").random_field(degree), ROUNDS if degree < 100 else 2
        own = gravity.gradient_e(field, position)
        base = seconds(gravity.gradient_e, field, position)
        found = {"numpy, six elements": seconds(numpy_gradient, field, position, rounds=rounds)}
        for peer in (pyharm, pyshtools):
            try:
                found |= peer(field, position, own)
            except ImportError:
                say(f"{peer.__name__}: not installed")
        trace = f"trace {np.abs(np.trace(own, axis1=1, axis2=2)).max():.1e} s-2"
        rows = [("gravcal, six elements", base, trace)]
        rows += [(name, spent, f"{spent[1] / base[1]:.1f} x gravcal") for name, spent in found.items()]
        figures += show([Figure(name, f"{v[1]:.4f} s", f"{v[0]:.4f} s", said) for name, v, said in rows], "median")
    return figures


def orbit_points(count=EPOCHS, step=5.0):
    """Places (n, 3) m along a polar orbit over a turning Earth, Earth-fixed."""
    u = 2 * np.pi * step * np.arange(count) / 5660
    turn = 7.292e-5 * step * np.arange(count)
    x, y, z = np.cos(u) * np.cos(turn), -np.cos(u) * np.sin(turn), np.sin(u)
    return 6.868e6 * np.stack([x, y, z], axis=1)


def numpy_gradient(field, position):
    """The same sum in numpy, all points at once: what a careful user would write."""
    table, alpha, beta = field.tables[gravity.PAIRS]  # as of `gravity.kernel_tables`
    p = position / field.radius
    q = 1 / np.sum(p**2, axis=1)
    x, y, z = (p * q[:, None]).T
    power, total = np.sqrt(q).astype(complex), np.zeros((len(p), 6))
    for m in range(table.shape[0]):
        size = table.shape[0] - m
        a = np.empty((size, len(p)))
        a[0] = 1.0
        for n in range(1, size):
            a[n] = alpha[m, n] * z * a[n - 1] - (beta[m, n] * q * a[n - 2] if n > 1 else 0)
        lumped = table[m, :size].T @ a
        total += (power.real * lumped[0::2] + power.imag * lumped[1::2]).T
        power = power * (x + 1j * y)
    return total * field.gm / field.radius**3


def seconds(function, *arguments, rounds=ROUNDS):
    """Median and least processor time of a call; all candidates run on one thread, so a busy machine matters less."""
    taken = timeit.repeat(lambda: function(*arguments), timer=time.process_time, repeat=rounds, number=1)
    return statistics.median(taken), min(taken)


def spherical(position):
    """Radius m, latitude and longitude rad of points (n, 3)."""
    r = np.linalg.norm(position, axis=1)
    return r, np.arcsin(position[:, 2] / r), np.arctan2(position[:, 1], position[:, 0])


def pyharm(field, position, own):
    """CHarm's gradient at scattered points, compiled C."""
    import pyharm as ph

    r, latitude, longitude = spherical(position)
    columns = [np.concatenate([part[m:, m] for m in range(field.degree + 1)]) for part in (field.cosine, field.sine)]
    coefficients = ph.shc.Shc.from_arrays(field.degree, *columns, field.gm, field.radius)
    points = ph.crd.PointSctr.from_arrays(latitude, longitude, r)
    zz = ph.shs.point_grad2(points, coefficients, field.degree)[5]
    up = position / r[:, None]
    difference = np.abs(np.einsum("ni,nij,nj->n", up, own, up) - zz).max()
    say(f"largest difference of the radial element from pyharm: {difference:.1e} s-2")
    return {"pyharm point_grad2, six elements": seconds(ph.shs.point_grad2, points, coefficients, field.degree)}


def pyshtools(field, position, _own):
    """The package has acceleration, not the gradient, at scattered points; some of the points, scaled."""
    from pyshtools.gravmag import MakeGravGridPoint

    r, latitude, longitude = spherical(position)
    latitude, longitude = np.degrees(latitude), np.degrees(longitude)
    both, part = np.stack([field.cosine, field.sine]), range(0, EPOCHS, 20 if field.degree < 100 else 200)

    def run():
        for k in part:
            MakeGravGridPoint(both, field.gm, field.radius, r[k], latitude[k], longitude[k], lmax=field.degree)

    return {"pyshtools acceleration only": tuple(value * EPOCHS / len(part) for value in seconds(run, rounds=3))}


def drag(options) -> list[Figure]:
    """Errors over standard deviations, and scatter over the bound, of many simulated days."""
    words = f"drag: gradient_torque, {{}} simulated days of {EPOCHS} epochs, degree 60"
    drags, pressure, attitude = study(options, 100, words, one_day)
    count, figures, (low, high) = len(drags), [], interval(len(drags), 3)
    for k, name in enumerate(VARIANTS):
        squared, variance, ratio, mean = drags[:, k].transpose(1, 0, 2)
        by_day, over = np.sqrt(ratio.mean(axis=1)), np.sqrt(squared.mean(axis=0) / variance.mean(axis=0))
        bias, size = mean.mean(axis=0) / mean.std(axis=0) * count**0.5, f"sigma {np.sqrt(variance.mean()):.3e}"
        figures += [
            Figure(f"{name}: error rms, m s-2", f"{np.sqrt(squared.mean()):.3e}", size),
            Figure("  error/sigma rms", f"{np.sqrt(ratio.mean()):.4f}", f"{by_day.min():.3f} .. {by_day.max():.3f}"),
            Figure("  scatter over bound by axis", numbers(over, ".4f")),
            Figure("  mean error over its standard error", numbers(bias, ".2f")),
        ]
    pressure, name = rms(pressure), "centre of pressure, error/sigma rms"
    met = bool(np.all((low < pressure) & (pressure < high)))
    figures.append(Figure(name, numbers(pressure), "", f"{low:.2f} .. {high:.2f}", met))
    return show([*figures, Figure("attitude fit, chi2/dof", numbers(np.mean(attitude, axis=0)))])


def simulated(seed, **flown):
    """Product with the gradient, and truth, of a simulated day."""
    satellite, field = catalog.satellite("S").settings(), icgem.read_field(icgem.shipped(), 60)
    settings = catalog.parameters("simulate_gradient_torque").with_settings({"step_s": 5.0} | flown)
    columns, truth = simulation.simulate(satellite, settings, field, DAY, seed)
    readings = {name: (dims, columns[name]) for name, (dims, _, _) in LAYOUTS["SGRS"].items()}
    observed, chosen = xr.Dataset(readings, {"time": columns["time"]}), catalog.parameters("gradient_torque")
    return model.gradient(observed, model.field(field), satellite=satellite, **chosen.for_stage("gradient")), truth


def dragged(modelled, variant):
    """Product with the drag."""
    options = catalog.parameters("gradient_torque").for_stage("drag")
    return estimate.drag(modelled, variant=variant, satellite=catalog.satellite("S").settings(), **options)


def one_day(seed):
    """Squared error, variance, ratio, error of the drag (4, 3) by variant; centre of pressure; fit of attitude."""
    modelled, truth = simulated(seed)
    drags = []
    for name in VARIANTS:
        one = dragged(modelled, name)
        error = one["drag_b"].values - truth["drag"]
        variance = np.diagonal(one["covariance"].values, axis1=1, axis2=2)
        drags.append([part.mean(axis=0) for part in (error**2, variance, error**2 / variance, error)])
        if name == "one_sensor":
            off, sigma = one["pressure"] - truth["centre_of_pressure_m"], np.sqrt(np.diag(one["pressure_covariance"]))
    return drags, off.values / sigma, modelled["attitude_chi2"].values / modelled["attitude_dof"].values


def degrees(_options) -> list[Figure]:
    """Degrees, zonal and whole, whose angular acceleration over a day, sqrt(2 T) rms, is above so much white noise.

    Linear noise d of a cube of size L is an angular one of 2 d / L.
    """
    field, satellite = icgem.read_field(icgem.shipped(), 60), catalog.satellite("S").settings()
    position, step = orbit_points(), 5.0
    R_oe = frames.flight_frame(np.hstack([position, np.gradient(position, axis=0)]))
    small = np.eye(3) + POINTING * np.array([[0, 1, -1], [-1, 0, 1], [1, -1, 0]])
    R_be = small @ (R_oe[:, ::-1] * np.array([[1], [1], [-1]]))  # forward, across, down
    body, cube = np.array(satellite["inertia"]), model.box_inertia(satellite, 1.0)
    own = satellite["angular_noise_density"][0]
    density = {name: 2 * GRACE_M_S2 / f / CUBE_M if f else own for name, f in FACTORS.items()}
    title(f"degrees: {field.name}; {', '.join(f'{n} {d:.1e}' for n, d in density.items())} rad s-2 Hz-1/2")
    seen = {(name, what): [] for name in density for what in ("zonal", "whole")}
    for n in range(1, 61):
        for what, part in (("zonal", gravity.zonal(field, n)), ("whole", gravity.truncated(field, n, n))):
            tensor = gravity.rotate_tensor(R_be, gravity.gradient_e(part, position))
            angular = model.gradient_angular_acceleration(cube, body, tensor)
            size = np.sqrt(np.mean(np.sum(angular**2, axis=1)))
            for name, noise in density.items():
                seen[name, what] += [n] if np.sqrt(2 * step * EPOCHS) * size / noise > SEEN else []
    for (name, what), found in seen.items():
        say(f"{name}, {what}, above {SEEN:g} in a day: {', '.join(map(str, found)) or 'none'}")
    return []
