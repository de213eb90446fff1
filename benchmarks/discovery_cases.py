"""Hidden effects for the study of discovery: drawn, scaled to a signal-to-noise ratio, written as Level-1 files.

Listed effects are hidden by the project's simulator, effects in no list by the second simulator of the tests. The ratio
is that of the whitened change of the data with all baseline parameters free, from two events with the same noise; the
change is made large against the rounding of the readings, which differs from event to event.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

#: Effects in no list: settings of the second simulator with a first guess of the size, and words of the right driver.
UNLISTED = {
    "odd_field_current": ({"value": {"y": 2e-7}}, ("torquer_current", "field")),
    "odd_current_squared": ({"value": {"y": 1e-13}, "lag_s": 2.0}, ("torquer_current",)),
    "odd_edge_spike": ({"value": {"y": 3e-9}, "decay_s": 0.7, "signed": True}, ("torquer_current",)),
    "odd_hysteresis": ({"value": {"y": 1e-11}, "width_ma": 60.0}, ("torquer_current",)),
    "odd_current_latitude": ({"value": {"y": 1e-11}}, ("torquer_current", "latitude")),
    "odd_settling": ({"value": {"y": 1e-9}, "decay_s": 40.0}, ("time",)),
    "odd_angular_field": ({"value": {"y": 1e-4}}, ("torquer_current", "field")),
    "odd_pointing": ({"value": {"yz": 1e-6}}, ("attitude",)),
}
#: Listed effects that cannot be drawn as a direction of their parameters.
SPECIAL = ("accelerometer.stray_tone", "accelerometer.bias_step", "accelerometer.flexible_mode", "torque.dipole_lag")
#: Part of the baseline, of other records, or slow, so that free drifts and torques take them up whatever their size.
SLOW = ("constant", "aerodynamic", "radiation", "gravity_gradient", "residual_dipole", "eddy_current")
SKIPPED = (
    "accelerometer.offset",
    "accelerometer.temperature",
    "attitude.star_camera_misalignment",
    "magnetometer.bias",
    "torque.thruster_firings",
    "timing.thruster_delay",
    "timing.clock_drift",
    *(f"torque.{name}" for name in SLOW),
)
LARGEST = 5.0  # times the plausible size; a scale of the readings off by a half is a broken instrument
FAMILIES = ("timing", "torque", "accelerometer", "attitude", "magnetometer")


@dataclass(frozen=True)
class Case:
    """What is hidden.

    Attributes
    ----------
    seed : of the event
    kind : "clean", "one", "two", "unlisted"
    effects : {"slug.parameter": value} or, unlisted, {name: settings}
    """

    seed: int
    kind: str
    effects: dict


def listed(rng: np.random.Generator, truth: dict) -> dict:
    """One listed effect of a plausible size, {"slug.parameter": value}.

    Parameters
    ----------
    rng : source of randomness
    truth : of the event without it, for the times of the manoeuvres
    """
    from gravcal.effects import catalogue

    known = {s: e for s, e in catalogue().items() if s.partition(".")[0] in FAMILIES and s not in SKIPPED}
    slug = sorted(known)[rng.integers(len(known))]
    if slug in SPECIAL:
        return {f"{slug}.{k}": v for k, v in _special(slug, rng, truth).items()}
    entry = known[slug]
    if slug == "torque.saturation":
        return {f"{slug}.limit": 27.5 * (1 - abs(rng.normal(0, 0.01)))}
    values = {p.name: p.prior_sigma * rng.standard_normal() for p in entry.parameters}
    if rng.integers(2) and len(values) > 1:
        name = sorted(values)[rng.integers(len(values))]
        values = {name: values[name]}
    return {f"{slug}.{name}": float(value) for name, value in values.items()}


def _special(slug, rng, truth):
    axis = "xyz"[rng.integers(3)]
    if slug == "accelerometer.stray_tone":
        return {"frequency": rng.uniform(0.02, 0.7), axis: 1e-10, "phase": rng.uniform(0, 6.28)}
    if slug == "accelerometer.flexible_mode":
        return {"frequency": rng.uniform(0.12, 0.75), "damping": 0.02, axis: 3e-12}
    if slug == "torque.dipole_lag":
        return {"tau": abs(rng.normal(0, 0.3)) + 0.1}
    wave = truth["manoeuvres"][rng.integers(len(truth["manoeuvres"]))]
    return {axis: 1e-9, "time": rng.uniform(wave["start"] + 20, wave["stop"] - 20)}


def scaled(effects: dict, factor: float) -> dict:
    """Effects with their strength multiplied, times and frequencies as they are.

    Parameters
    ----------
    effects : {"slug.parameter": value} or {name: settings}
    factor : 1
    """
    fixed = ("time", "frequency", "phase", "damping", "lag_s", "decay_s", "signed", "width_ma")
    out = {}
    for name, value in effects.items():
        if isinstance(value, dict):
            out[name] = {k: v if k in fixed else _times(v, factor) for k, v in value.items()}
        elif name.endswith("saturation.limit"):
            out[name] = 27.5 - factor * (27.5 - value)
        else:
            out[name] = value if name.rpartition(".")[2] in fixed else factor * value
    return out


def plausible(effects: dict) -> bool:
    """Whether no parameter of a listed effect is more than five times its plausible size.

    Parameters
    ----------
    effects : {"slug.parameter": value} or {name: settings}
    """
    from gravcal.effects import effect

    for name, value in effects.items():
        slug, _, parameter = name.rpartition(".")
        if not slug or slug in SPECIAL or slug == "torque.saturation":
            continue
        (known,) = (p for p in effect(slug).parameters if p.name == parameter)
        if abs(value) > LARGEST * known.prior_sigma:
            return False
    return True


def _times(value, factor):
    return {k: factor * v for k, v in value.items()} if isinstance(value, dict) else factor * value


def written(folder: Path, case: Case) -> dict:
    """Level-1 files of a case; its truth.

    Parameters
    ----------
    folder : for the files
    case : Case
    """
    if case.kind == "unlisted":
        truth = _second_simulator()(folder, case.seed, effects=case.effects, window_s=(420.0, 420.0))
        return {"offset_um": list(truth["offset_um"]), "date": truth["date"], "manoeuvres": truth["manoeuvres"]}
    from flows import com_offset

    return com_offset.CALIBRATION.simulate(folder, seed=case.seed, truth=None, effects=case.effects, settings={})


def _second_simulator():
    """The simulator of the tests, under the name that the tests import it by (compiled code is kept by name)."""
    import sys

    tests = str(Path(__file__).resolve().parents[1] / "tests")
    if tests not in sys.path:
        sys.path.insert(0, tests)
    from independent import make_event

    return make_event


def ratio(clean, changed, candidates=()) -> tuple[float, float]:
    """Signal-to-noise ratio of the difference of two events with the same noise, all baseline parameters free.

    Parameters
    ----------
    clean, changed : blocks of `gravcal.calibrations.com_offset.observations`, whitened alike
    candidates : on the clean event, of which the listed ones count

    Returns
    -------
    ratio : 1
    left : share of its square that the best of the candidates leaves
    """
    from gravcal.discovery import attribution, rounds
    from gravcal.discovery.problem import prepare

    blocks = []
    for one, other in zip(clean, changed, strict=True):
        if one.observed.shape != other.observed.shape:
            return np.nan, np.nan
        blocks.append(replace(one, observed=other.observed - one.observed))
    problem = prepare(blocks, [c for c in candidates if c.listed])
    gram = attribution.projected(problem.total, rounds.baseline_of(problem, ()))
    gains = [attribution.ratio(gram, place, problem.size).gain for place in problem.places]
    whole = max(float(gram[0, 0]), 1e-300)
    return float(np.sqrt(whole)), 1 - max(gains, default=0.0) / whole


def known(blocks, forms, start) -> dict:
    """Offset by an estimator that knows the forms of what is hidden and fits their sizes, and what it gains.

    Parameters
    ----------
    blocks : of the event
    forms : of each effect, what it adds to the rows of each block
    start : (3,) m, offset that the blocks start from

    Returns
    -------
    numbers : "known_um" and "known_sigma_um" of the offset, "known_gain" of the likelihood ratio; empty where an
        effect changed which samples are used, so that its rows do not fit
    """
    from gravcal.discovery import attribution
    from gravcal.discovery.problem import baseline_of
    from gravcal.estimation.records import Candidate, prepare

    columns = [np.stack(one, axis=1) for one in zip(*forms, strict=True)]
    if any(len(c) != b.observed.size for c, b in zip(columns, blocks, strict=True)):
        return {}
    names = [f"size_{k}" for k in range(len(forms))]
    hidden = Candidate("unknown:hidden", "", names, ["1"] * len(names), columns)
    problem = prepare(blocks, [hidden])
    total, fixed = problem.total, baseline_of(problem, [0])
    covariance = attribution.inverse_of(total[np.ix_(fixed, fixed)])
    value = np.asarray(start) + (covariance @ total[fixed, 0])[:3]
    alone = attribution.projected(total, baseline_of(problem, ()))
    gain = attribution.ratio(alone, problem.places[0], problem.size).gain
    sigma = np.sqrt(np.diag(covariance)[:3])
    return {"known_um": (1e6 * value).tolist(), "known_sigma_um": (1e6 * sigma).tolist(), "known_gain": float(gain)}
