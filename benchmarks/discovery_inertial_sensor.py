"""How discovery does on swings: python -m benchmarks.discovery_inertial_sensor clean|one [runs] [first seed].

Effects are hidden in simulated swings in memory at a signal-to-noise ratio of 10 with all baseline parameters free.
"""

import json
import sys
from dataclasses import replace

from flows.engine import single_threaded

single_threaded()

import numpy as np  # noqa: E402
from scipy import stats  # noqa: E402

from benchmarks.inertial_sensor import START  # noqa: E402
from flows.inertial_sensor import geometry, views  # noqa: E402
from gravcal import catalog  # noqa: E402
from gravcal.calibrations.inertial_sensor import observations, offset, records, scale  # noqa: E402
from gravcal.discovery import attribution, driver  # noqa: E402
from gravcal.discovery.problem import baseline_of, prepare  # noqa: E402
from gravcal.effects import catalogue  # noqa: E402
from gravcal.simulation import inertial_sensor as simulation  # noqa: E402

TARGET = 10.0
LISTED = ("accelerometer.bias_step", "accelerometer.stray_tone", *(
    f"inertial_sensor.{name}" for name in ("tracker_misalignment", "loop_delay", "cross_coupling", "quadratic")
))  # fmt: skip
FIXED = ("time", "frequency", "phase")
#: Size in plausible sizes beyond which an effect is not drawn: it is far out of its first order.
MOST = 150.0


def products(seed, effects=None):
    """Truth and products of a swing."""
    chosen, settings = catalog.parameters("simulate_inertial_sensor"), catalog.parameters("inertial_sensor")
    rng = np.random.default_rng(seed)
    truth = simulation.draw(catalog.satellite("T").settings(), chosen, rng)
    record = simulation.swing(chosen, START, truth, rng, simulation.Hidden(effects or {}, START))
    found = records.detect(lambda: record["ATT"], **settings.for_stage("detect"))
    readers = [lambda *_, name=name: record[name] for name in ("IS1", "ATT", "ORB")]
    aligned = records.align(found, *readers, **settings.for_stage("align"))
    scaled = scale.scale(aligned, geometry=geometry(), **settings.for_stage("scale"))
    moved = offset.offset(aligned, scaled, **settings.for_stage("offset"))
    return truth, {"align": aligned, "scale": scaled, "offset": moved}


def settings():
    """Settings of the observations, and of the search."""
    chosen = catalog.parameters("inertial_sensor")
    limits = chosen.for_stage("discovery")
    row = (limits[n] for n in ("discovery_level", "tie_chi2", "round_limit", "heldout_s", "discovery_seed"))
    return views(None, chosen), driver.Limits(*row)


def ratio(clean, changed):
    """Signal-to-noise ratio of the difference of two swings with the same noise, all baseline parameters free."""
    one, other = (observations.observe(parts, **settings()[0]).swing for parts in (clean, changed))
    if one.system.lower.shape != other.system.lower.shape:
        return np.nan
    system = replace(other.system, lower=one.system.lower)
    other = replace(other, system=system, record=replace(other.record, noise=one.record.noise))
    pairs = zip(one.blocks(), other.blocks(), strict=True)
    problem = prepare([replace(a, observed=b.observed - a.observed) for a, b in pairs], [])
    return float(np.sqrt(attribution.projected(problem.total, baseline_of(problem, ()))[0, 0]))


def drawn(rng):
    """One effect, {slug: {parameter: value}}."""
    entry = catalogue()[LISTED[rng.integers(len(LISTED))]]
    axis = "xyz"[rng.integers(3)]
    if entry.slug == "accelerometer.bias_step":
        return {entry.slug: {axis: 1e-9, "time": START + rng.uniform(420, 580)}}
    if entry.slug == "accelerometer.stray_tone":
        return {entry.slug: {"frequency": rng.uniform(0.06, 0.4), axis: 1e-9, "phase": rng.uniform(0, 6)}}
    one = entry.parameters[rng.integers(len(entry.parameters))]
    return {entry.slug: {one.name: 30 * one.prior_sigma * rng.choice([-1, 1])}}


def scaled(effects, factor):
    """Effects with their strength multiplied."""
    return {s: {n: v if n in FIXED else factor * v for n, v in given.items()} for s, given in effects.items()}


def _plausible(effects):
    """Whether a size is at most so many plausible ones; steps and tones have none."""
    ((slug, given),) = effects.items()
    priors = {p.name: p.prior_sigma for p in catalogue()[slug].parameters}
    return slug.startswith("accelerometer.") or all(abs(v) < MOST * priors[n] for n, v in given.items())


def hidden(seed):
    """An effect at the wanted ratio."""
    rng, (_, clean) = np.random.default_rng([seed, 3]), products(seed)
    for _ in range(40):
        effects = drawn(rng)
        for _ in range(2):
            size = ratio(clean, products(seed, effects)[1])
            effects = scaled(effects, TARGET / size) if np.isfinite(size) and size > 0.02 else effects
        if _plausible(effects) and abs(ratio(clean, products(seed, effects)[1]) - TARGET) < 2:
            return effects
    raise ValueError(f"seed {seed}: no effect reached the ratio in forty draws")


def case(seed, kind):
    """What was hidden and what was found."""
    effects = hidden(seed) if kind == "one" else {}
    truth, parts = products(seed, effects)
    scene, limits = settings()
    observed = observations.observe(parts, **scene)
    found = driver.discover(observed, limits)
    numbers = json.loads(found.attrs["numbers"])
    true = observed.scale * np.concatenate([truth.beta[:2], [truth.delay], truth.offset])
    change = numbers["calibration_change"]
    error = (np.array(change["after"]) - true) / np.array(change["sigma_after"])
    found = [{k: f[k] for k in ("cause", "form", "tied_with", "parameters")} for f in numbers["findings"]]
    return {
        "seed": seed,
        "hidden": effects,
        "found": found,
        "p": numbers["p_before"],
        "errors": error.round(1).tolist(),
    }


def right(row):
    """Whether the hidden effect alone is named, or its tied set."""
    named = [{f["cause"], *f["tied_with"]} for f in row["found"]]
    return len(named) == 1 and next(iter(row["hidden"])) in named[0]


def parameter_errors(row):
    """Errors over sigma of the hidden parameters where the cause was named untied."""
    ((slug, given),) = row["hidden"].items()
    found = [f for f in row["found"] if f["cause"] == slug and not f["tied_with"]]
    pairs = [(f["parameters"].get(n, {"value": None}), v) for f in found for n, v in given.items()]
    sign = 1 if slug != "accelerometer.stray_tone" else None  # of a tone the amplitude has none
    return [((p["value"] - (v if sign else abs(v))) / p["sigma"]) for p, v in pairs if p["value"] is not None]


def main():
    """Run the study and print its lines."""
    kind = sys.argv[1]
    count, first = (int(a) if a else d for a, d in zip((sys.argv[2:] + ["", ""])[:2], (20, 1), strict=True))
    rows = []
    for seed in range(first, first + count):
        rows.append(case(seed, kind))
        names = [[f["cause"], f["form"], f["tied_with"]] for f in rows[-1]["found"]]
        print(json.dumps(rows[-1] | {"found": names}), flush=True)
    if kind == "clean":
        chance = stats.kstest([r["p"] for r in rows], "uniform").pvalue
        print(f"named on clean data: {sum(bool(r['found']) for r in rows)} of {count}; uniform p-values: {chance:.3f}")
        return
    errors = np.abs([e for r in rows for e in parameter_errors(r)])
    print(f"named right, alone or in the tied set: {sum(map(right, rows))} of {count}")
    print(f"parameters within 3 sigma: {np.sum(errors < 3)} of {errors.size}")


if __name__ == "__main__":
    main()
