"""Gravity gradient along an orbit against other packages, and recovery of the drag over many simulated days.

python -m benchmarks.gradient_torque speed [--peers FOLDER]   FOLDER: site-packages that holds pyharm and pyshtools
python -m benchmarks.gradient_torque study [--days 100]       17,280 epochs each, degree 60
python -m benchmarks.gradient_torque degrees                  which degrees of GGM05S an angular reading shows in a day
"""

import argparse
import os
import statistics
import sys
import time

from flows.engine import single_threaded

single_threaded()  # before numpy: processor time of several threads would count them all, and their waiting

import numpy as np  # noqa: E402

from gravcal import catalog  # noqa: E402
from gravcal.calibrations.gradient_torque import estimate, model  # noqa: E402
from gravcal.io import icgem  # noqa: E402
from gravcal.physics import gravity, gravity_field  # noqa: E402
from gravcal.physics.constants import EARTH_RADIUS, GM  # noqa: E402
from gravcal.simulation import gradient_torque as simulation  # noqa: E402

EPOCHS, ROUNDS = 17280, 5
DAY = 633830400.0


def field_of(degree, seed=0):
    """Kaula's rule with the Earth's lowest degrees."""
    rng = np.random.default_rng(seed)
    n, m = np.arange(degree + 1)[:, None], np.arange(degree + 1)[None, :]
    rule = np.where((m <= n) & (n >= 2), 1e-5 / np.maximum(n, 1) ** 2, 0.0)
    cosine, sine = rule * rng.standard_normal(rule.shape), rule * rng.standard_normal(rule.shape) * (m > 0)
    cosine[0, 0], cosine[2, 0] = 1.0, icgem.read_field(icgem.shipped(), 2).cosine[2, 0]
    return gravity_field.Field(GM, EARTH_RADIUS, cosine, sine)


def orbit_points(count=EPOCHS):
    """Places along a polar orbit over a turning Earth."""
    u = 2 * np.pi * 5.0 * np.arange(count) / 5660
    turn = 7.292e-5 * 5.0 * np.arange(count)
    x, y, z = np.cos(u) * np.cos(turn), -np.cos(u) * np.sin(turn), np.sin(u)
    return 6.868e6 * np.stack([x, y, z], axis=1)


def numpy_gradient(field, position, tables):
    """The same sum in numpy, all points at once: what a careful user would write."""
    table, alpha, beta = tables  # as of `gravity_field.kernel_tables`
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


def seconds(call, rounds=ROUNDS):
    """Median and least processor time of a call; all candidates run on one thread, so a busy machine matters less."""
    taken = []
    for _ in range(rounds):
        start = time.process_time()
        call()
        taken.append(time.process_time() - start)
    return statistics.median(taken), min(taken)


def speed(peers):
    """Print times of all candidates on one core, side by side."""
    if peers:
        sys.path.append(peers)
    position = orbit_points()
    for degree in (60, 200):
        field = field_of(degree)
        own = gravity_field.gradient_e(field, position)
        trace = np.abs(np.trace(own, axis1=1, axis2=2)).max()
        print(f"degree {degree}, {EPOCHS} epochs, one thread, processor time; trace {trace:.1e} s-2")
        base = report("gravcal, six elements", seconds(lambda f=field: gravity_field.gradient_e(f, position)), None)
        rounds = ROUNDS if degree < 100 else 2
        tables = gravity_field._prepared(field, gravity_field.PAIRS)
        found = seconds(lambda f=field, t=tables: numpy_gradient(f, position, t), rounds)
        report("numpy, six elements", found, base)
        pyharm(field, position, own, base)
        pyshtools(field, position, base)


def report(name, found, base):
    """One line; returns the least time, to which the ratios refer."""
    ratio = "" if base is None else f", {found[1] / base:.1f} x gravcal"
    print(f"  {name:<34} median {found[0]:.4f} s, least {found[1]:.4f} s{ratio}")
    return found[1]


def pyharm(field, position, own, base):
    """CHarm's gradient at scattered points, compiled C."""
    try:
        import pyharm as ph
    except ImportError:
        print("  pyharm: not installed")
        return
    r = np.linalg.norm(position, axis=1)
    latitude, longitude = np.arcsin(position[:, 2] / r), np.arctan2(position[:, 1], position[:, 0])
    columns = [np.concatenate([part[m:, m] for m in range(field.degree + 1)]) for part in (field.cosine, field.sine)]
    coefficients = ph.shc.Shc.from_arrays(field.degree, *columns, field.gm, field.radius)
    points = ph.crd.PointSctr.from_arrays(latitude, longitude, r)
    zz = ph.shs.point_grad2(points, coefficients, field.degree)[5]
    up = position / r[:, None]
    difference = np.abs(np.einsum("ni,nij,nj->n", up, own, up) - zz).max()
    found = seconds(lambda: ph.shs.point_grad2(points, coefficients, field.degree))
    report("pyharm point_grad2, six elements", found, base)
    print(f"    largest difference of the radial element: {difference:.1e} s-2")


def pyshtools(field, position, base):
    """The package has acceleration, not the gradient, at scattered points; some of the points, scaled."""
    try:
        from pyshtools.gravmag import MakeGravGridPoint
    except ImportError:
        print("  pyshtools: not installed")
        return
    r = np.linalg.norm(position, axis=1)
    latitude, longitude = (
        np.degrees(np.arcsin(position[:, 2] / r)),
        np.degrees(np.arctan2(position[:, 1], position[:, 0])),
    )
    both, part = np.stack([field.cosine, field.sine]), range(0, EPOCHS, 20 if field.degree < 100 else 200)

    def run():
        for k in part:
            MakeGravGridPoint(both, field.gm, field.radius, r[k], latitude[k], longitude[k], lmax=field.degree)

    found = tuple(value * EPOCHS / len(part) for value in seconds(run, 3))
    report("pyshtools acceleration only", found, base)


def study(days):
    """Print errors over standard deviations, and scatter over the bound, of many simulated days."""
    satellite, field = catalog.satellite("S").settings(), icgem.read_field(icgem.shipped(), 60)
    chosen = catalog.parameters("gradient_torque")
    rows = {name: [] for name in ("two_sensor", "one_sensor", "one_sensor_published")}
    pressure, adequacy = [], []
    for seed in range(days):
        settings = catalog.parameters("simulate_gradient_torque").with_settings({"step_s": 5.0})
        columns, truth = simulation.simulate(satellite, settings, field, DAY, seed)
        observed = as_dataset(columns)
        modelled = model.gradient(observed, model.field(field), satellite=satellite, **chosen.for_stage("gradient"))
        adequacy.append(modelled["attitude_chi2"].values / modelled["attitude_dof"].values)
        for name, kept in rows.items():
            one = estimate.drag(modelled, variant=name, satellite=satellite, **chosen.for_stage("drag"))
            error = one["drag_b"].values - truth["drag"]
            variance = np.diagonal(one["covariance"].values, axis1=1, axis2=2)
            kept.append(
                (
                    np.mean(error**2, axis=0),
                    variance.mean(axis=0),
                    np.mean(error**2 / variance, axis=0),
                    error.mean(axis=0),
                )
            )
            if name == "one_sensor":
                sigma = np.sqrt(np.diag(one["pressure_covariance"].values))
                pressure.append((one["pressure"].values - truth["centre_of_pressure_m"]) / sigma)
    summary(rows, np.array(pressure), np.array(adequacy))


def as_dataset(columns):
    """Readings as the reader gives them."""
    import xarray as xr

    from gravcal.io.daily import LAYOUTS

    return xr.Dataset({n: (dims, columns[n]) for n, (dims, _, _) in LAYOUTS["SGRS"].items()}, {"time": columns["time"]})


def summary(rows, pressure, adequacy):
    """Lines of the study."""
    for name, kept in rows.items():
        squared, variance, ratio, mean = (np.array(part) for part in zip(*kept, strict=True))
        print(f"{name}, {len(kept)} days")
        print(f"  error rms {np.sqrt(squared.mean()):.3e} m s-2, sigma rms {np.sqrt(variance.mean()):.3e}")
        print(f"  error/sigma rms {np.sqrt(ratio.mean()):.4f}; by axis {np.round(np.sqrt(ratio.mean(axis=0)), 4)}")
        print(f"  days: least {np.sqrt(ratio.mean(axis=1)).min():.3f}, largest {np.sqrt(ratio.mean(axis=1)).max():.3f}")
        print(f"  scatter over bound by axis {np.round(np.sqrt(squared.mean(axis=0) / variance.mean(axis=0)), 4)}")
        bias = mean.mean(axis=0) / mean.std(axis=0) * len(kept) ** 0.5
        print(f"  mean error over its standard error {np.round(bias, 2)}")
    print(f"centre of pressure, error/sigma rms by axis {np.round(np.sqrt(np.mean(pressure**2, axis=0)), 3)}")
    print(f"attitude fit, chi2/dof mean {adequacy.mean(axis=0)}")


GRACE_M_S2, CUBE_M = 3e-10, 0.03  # linear noise of GRACE per root hertz, and size of the test mass
FACTORS = {"assumed": None, "GRACE": 1.0, "40 x": 40.0, "500 x": 500.0}  # linear sensitivity over that of GRACE
SEEN = 5.0  # matched signal over noise
POINTING = 5e-3  # rad: aligned axes feel no torque of a sphere


def degrees():
    """Relative angular acceleration of each degree over a day, zonal and whole, against white angular noise.

    Signal over noise of a known waveform in white noise of one-sided density D: sqrt(2 T) rms / D. Linear noise d of
    a cube of size L is an angular one of 2 d / L.
    """
    field, satellite = icgem.read_field(icgem.shipped(), 60), catalog.satellite("S").settings()
    position, step = orbit_points(), 5.0
    down = -position / np.linalg.norm(position, axis=1)[:, None]
    across = np.cross(down, np.gradient(position, axis=0))
    across /= np.linalg.norm(across, axis=1)[:, None]
    small = np.eye(3) + POINTING * np.array([[0, 1, -1], [-1, 0, 1], [1, -1, 0]])
    R_be = small @ np.stack([np.cross(across, down), across, down], axis=1)
    body, cube = np.array(satellite["inertia"]), model.box_inertia(satellite, 1.0)
    own = satellite["angular_noise_density"][0]
    density = {name: 2 * GRACE_M_S2 / f / CUBE_M if f else own for name, f in FACTORS.items()}
    print(f"{field.name}; angular noise rad s-2 Hz-1/2: " + ", ".join(f"{n} {d:.1e}" for n, d in density.items()))
    print("degree   zonal rms   whole rms   S/N in a day, zonal: " + "  ".join(f"{name:>9}" for name in density))
    seen = {(name, what): [] for name in density for what in ("zonal", "whole")}
    for n in range(1, 61):
        parts = {"zonal": gravity_field.zonal(field, n), "whole": gravity_field.truncated(field, n, n)}
        rms = {}
        for what, part in parts.items():
            tensor = gravity.rotate_tensor(R_be, gravity_field.gradient_e(part, position))
            angular = model.gradient_angular_acceleration(cube, body, tensor)
            rms[what] = np.sqrt(np.mean(np.sum(angular**2, axis=1)))
        ratio = {at: np.sqrt(2 * step * EPOCHS) * rms[at[1]] / density[at[0]] for at in seen}
        for at, value in ratio.items():
            seen[at] += [n] if value > SEEN else []
        if n <= 24 or n % 10 == 0:
            shown = "  ".join(f"{ratio[name, 'zonal']:9.2g}" for name in density)
            print(f"{n:6} {rms['zonal']:11.2e} {rms['whole']:11.2e}                         {shown}")
    for (name, what), found in seen.items():
        print(f"{name}, {what}, above {SEEN:g} in a day: {', '.join(map(str, found)) or 'none'}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("speed", "study", "degrees"))
    parser.add_argument("--peers", default=os.environ.get("GRAVCAL_PEERS", ""))
    parser.add_argument("--days", type=int, default=100)
    given = parser.parse_args()
    {"speed": lambda: speed(given.peers), "study": lambda: study(given.days), "degrees": degrees}[given.what]()
