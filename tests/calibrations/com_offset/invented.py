"""Invented products of a small centre-of-mass event: numbers without physics, in the schemas of the calibration."""

import numpy as np

from gravcal.calibrations import schemas

SCHEMAS = schemas.of("com_offset.toml")
VARIANTS = ("mtq", "acc_calibrated", "acc", "sca")
OFFSET = np.array([107.2, 3.7, -12.4]) * 1e-6
SIGMA = np.array([0.7, 0.3, 0.08]) * 1e-6
KINDS = (1, 0, 2)  # pitch, roll, yaw
RODS = (0, 1, 1)
START = 633790000.25 + 1500 * np.arange(3)
SETTINGS = {
    "requirement_um": 100.0,
    "accuracy_um": 50.0,
    "consistency_level": 0.01,
    "torque_scale_sigma": 0.1,
    "roll_response": 0.0028,
    "roll_response_sigma": 0.0003,
}
PROVENANCE = {
    "products": {
        f"com_offset.{n}": f"{i:02d}ab" * 16 for i, n in enumerate(["combine", "field", "attitude", "survey"])
    },
    "inputs": {"ACC1A_2020-02-01_C_04.txt": "cd" * 32},
}

SCHEMAS = schemas.of("com_offset.toml")


def build(schema, values, **attrs):
    """Dataset of a schema; what a report does not read is filled with zeros."""
    sizes = {"axis": 3, "axis_2": 3}
    for name, value in values.items():
        sizes |= dict(zip(schema[name]["dims"].split(), np.shape(value), strict=True))
    zeros = {
        name: np.zeros([sizes.get(dim, 0) for dim in stated["dims"].split()])
        for name, stated in schema.items()
        if name not in values
    }
    return schemas.build(schema, zeros | values, **attrs)


def products(count=3, seed=1):
    """Products by short name; count 0 gives a record without manoeuvre."""
    rng = np.random.default_rng(seed)
    made = {"detect": detect(count), "align": align(count, rng), "field": field(count, rng)}
    made |= {"attitude": attitude(count, rng), "survey": survey(rng), "combine": combine(count)}
    made |= {f"solve.{name}": solve(name, count, rng) for name in VARIANTS}
    return made | {f"angular_acceleration.{name}": angular(name, made["attitude"]) for name in VARIANTS}


def spans(count):
    """First and last edges, or one span of a record without manoeuvre."""
    start = START[:count] if count else START[:1]
    return start, start + 180.0


def detect(count):
    """Manoeuvres of thirty half periods."""
    edges = START[:count, None] + 6.0 * np.arange(31)
    values = {
        "start": START[:count],
        "stop": START[:count] + 180,
        "kind": KINDS[:count],
        "rod": RODS[:count],
        "edge_lower": edges - 0.25,
        "edge_upper": edges + 0.25,
        "level": np.full((count, 30), 110.0),
        "regular": np.ones(count),
        "record_start": START[0] - 400,
        "record_stop": START[-1] + 600,
    }
    return build(SCHEMAS["detect"], values)


def align(count, rng):
    """What the figures read of the aligned records."""
    start, stop = spans(count)
    time = np.concatenate([np.arange(a - 60, b + 60, 0.5) for a, b in zip(start, stop, strict=True)])
    values = {
        "time_mag": time,
        "current_b": rng.standard_normal((time.size, 3)),
        "window_start": start - 60,
        "window_stop": stop + 60,
        "time_acc": time,
        "acc_flag": 2 * (np.arange(time.size) == 7),
        "time_sca": time[::2],
        "sca_flag": np.zeros(time[::2].size),
    }
    return build({name: SCHEMAS["align"][name] for name in values}, values)


def field(count, rng):
    """A field with a bias of 0.5 microtesla in x."""
    start, stop = spans(count)
    time = np.concatenate([np.arange(a - 60, b + 60, 0.5) for a, b in zip(start, stop, strict=True)])
    model = 2e-5 + 1e-6 * rng.standard_normal((time.size, 3))
    difference = np.array([5e-7, 0, -3e-7]) + 1e-9 * rng.standard_normal((time.size, 3))
    orbit = np.arange(start[0] - 70, stop[-1] + 70, 10.0)
    values = {
        "time_orbit": orbit,
        "time_mag": time,
        "field_i": np.zeros((orbit.size, 3)),
        "position_i": np.zeros((orbit.size, 3)),
        "latitude": np.radians(np.linspace(70, 10, orbit.size)),
        "longitude": np.zeros(orbit.size),
        "model_b": model,
        "measured_b": model + difference,
        "difference_b": difference,
        "used": np.ones(time.size),
        "bias": difference.mean(axis=0),
        "rms": np.sqrt(np.mean(difference**2, axis=0)),
        "maximum": np.abs(difference).max(axis=0),
    }
    return build(SCHEMAS["field"], values, igrf_generation=14)


def attitude(count, rng):
    """Square waves about the axis turned, and residuals of two microradian."""
    start, stop = spans(count)
    acc = [np.arange(a, b, 0.1) for a, b in zip(start, stop, strict=True)]
    sca = [np.arange(np.ceil(a), b) for a, b in zip(start, stop, strict=True)]
    wave = np.concatenate([_wave(t - t[0], KINDS[i]) for i, t in enumerate(acc)])
    arcs = len(start)
    values = {n: wave for n in ("rate_b", "rate_dot_mtq_b", "rate_dot_sca_b", "magnetic_b", "smooth_b")}
    values |= {"time_acc": np.concatenate(acc), "time_sca": np.concatenate(sca)}
    values |= {"acc_manoeuvre": np.repeat(range(arcs), [t.size for t in acc])}
    values |= {"sca_manoeuvre": np.repeat(range(arcs), [t.size for t in sca])}
    values |= {"sca_residual_b": 2e-6 * rng.standard_normal((sum(t.size for t in sca), 3))}
    values |= {"gradient_b": np.zeros((wave.shape[0], 3, 3)), "sca_modes": np.zeros((6, *wave.shape))}
    values |= {"rod": RODS[:count] if count else [-1], "residual_rms": np.full((arcs, 3), 2e-6)}
    for name in ("sca_shift", "acc_shift"):
        values |= {name: np.full(arcs, 0.1), f"{name}_sigma": np.full(arcs, 0.02 if count else np.nan)}
    for name in ("torque_scale", "angular_scale"):
        values |= {name: np.full((arcs, 3), 1.01), f"{name}_sigma": np.tile([0.01, 0.02, 0.1], (arcs, 1))}
    for name, delay in (("acc", -0.02), ("sca", np.nan)):
        values |= {f"{name}_delay": delay, f"{name}_delay_sigma": 0.03}
    return build(SCHEMAS["attitude"], values)


def _wave(since, axis):
    """Square wave (n, 3) rad s-2 about one axis."""
    wave = np.zeros((since.size, 3))
    wave[:, axis] = np.where(since // 6 % 2 == 0, 2e-6, -2e-6)
    return wave


def survey(rng):
    """Roll rate that follows the integrated torque."""
    torque = 1e-4 * np.sin(np.arange(40) / 5)
    values = {
        "time_sca": START[0] + np.arange(40),
        "roll_rate": 0.0028 * torque + 1e-8 * rng.standard_normal(40),
        "roll_impulse": torque,
        "slope": 0.00281,
        "slope_sigma": 0.0002,
    }
    return build(SCHEMAS["survey"], values)


def angular(variant, smoothed):
    """One of four angular accelerations, a little apart."""
    wave = smoothed["rate_dot_mtq_b"].values * (1 + 0.01 * VARIANTS.index(variant))
    values = {
        "time_acc": smoothed["time_acc"].values,
        "rate_dot_b": wave,
        "mode": np.zeros((0, *wave.shape)),
        "mode_shared": np.zeros(0),
        "mode_catalogue": np.zeros(0),
        "scale": np.ones(3),
        "scale_sigma": np.full(3, 0.01),
        "acc_manoeuvre": smoothed["acc_manoeuvre"].values,
    }
    return build(SCHEMAS["angular_acceleration"], values, variant=variant, noisy=0)


def solve(variant, count, rng):
    """Readings with noise of a tenth of a nanometre per second squared."""
    time = [np.arange(np.ceil(a), a + 170, 0.5) for a in START[:count]]
    joined = np.concatenate([np.zeros(0), *time])
    model = np.concatenate([np.zeros((0, 3)), *(1e-4 * _wave(t - t[0], KINDS[i]) for i, t in enumerate(time))])
    values = {
        "offset": np.zeros((count, 3)),
        "time_grid": joined,
        "model": model,
        "reading": model + 1e-10 * rng.standard_normal(model.shape),
    }
    values |= {"grid_manoeuvre": np.repeat(range(count), [t.size for t in time])}
    values |= {"frequency": np.linspace(0.02, 1, 50), "noise_density": np.full((3, 50), 1e-20)}
    return build(SCHEMAS["solve"], values, variant=variant, noise_source="quiet data", direction="proof_mass_to_com")


def combine(count, undetermined=()):
    """Offsets near the truth; each manoeuvre leaves the axis it turns about undetermined."""
    size = len(VARIANTS)
    shift = np.arange(size)[:, None] * 0.2 * SIGMA
    covariance = np.tile(np.diag(SIGMA**2), (size, 1, 1))
    covariance[:, 0, 1] = covariance[:, 1, 0] = 0.1 * SIGMA[0] * SIGMA[1]
    known = np.ones((size, 3))
    known[:, list(undetermined)] = 0
    single = np.ones((size, count, 3))
    for i in range(count):
        single[:, i, KINDS[i]] = 0
    loose = np.tile(9 * np.diag(SIGMA**2), (size, count, 1, 1))
    loose[single[..., None] * single[..., None, :] == 0] = np.inf
    values = {
        "offset": np.where(known, OFFSET + shift, np.nan),
        "covariance": covariance,
        "covariance_total": covariance + np.diag([1e-10, 1e-12, 1e-12]),
        "determined": known,
        "chi2": np.full(size, 5.0),
        "dof": np.full(size, 6),
        "manoeuvre_offset": np.where(single, (OFFSET + shift)[:, None], np.nan),
        "manoeuvre_covariance": loose,
        "manoeuvre_determined": single,
        "manoeuvre_chi2": np.full((size, count), 1040.0),
        "manoeuvre_dof": np.full((size, count), 1041),
        "variants_chi2": 3.0,
        "variants_dof": 3,
        "catalogue_chi2": 0.4,
        "catalogue_dof": 3,
        "kind": KINDS[:count],
        "start": START[:count],
        "stop": START[:count] + 180,
    }
    attrs = {"variants": " ".join(VARIANTS), "method": "gravcal", "direction": "proof_mass_to_com"}
    return build(SCHEMAS["combine"], values, **attrs)
