"""How discovery does on ranging calibrations: python -m benchmarks.discovery_kbr_phase_centre KIND [runs] [first seed].

KIND is clean, one, two or unlisted. Effects are hidden in simulated campaigns at a signal-to-noise ratio of 10 with
all baseline parameters free; the lines say what was hidden and what was named, the last ones count.
"""

import json
import sys
import time
from dataclasses import replace
from unittest import mock

from flows.engine import single_threaded

single_threaded()

import numpy as np  # noqa: E402
from scipy import stats  # noqa: E402

from gravcal import catalog  # noqa: E402
from gravcal.calibrations.kbr_phase_centre.noise import white  # noqa: E402
from gravcal.calibrations.kbr_phase_centre.observations import observe  # noqa: E402
from gravcal.discovery import attribution  # noqa: E402
from gravcal.discovery.driver import Limits, discover  # noqa: E402
from gravcal.discovery.problem import baseline_of, prepare  # noqa: E402
from gravcal.effects import catalogue  # noqa: E402
from gravcal.effects.base import Effect, Parameter  # noqa: E402
from gravcal.simulation import kbr_phase_centre as simulation  # noqa: E402
from tasks import kbr_phase_centre as stages  # noqa: E402

DAY = 653011200.0 - 43200.0
FILES = (("KBR1B", "Y"), ("GNI1B", "C"), ("GNI1B", "D"), ("SCA1B", "C"), ("SCA1B", "D"))
NOMINAL = tuple(tuple(catalog.satellite(letter).com_to_antenna.value) for letter in "CD")
TARGET = 10.0
LISTED = (
    "ranging.multipath",
    "ranging.phase_centre_curvature",
    "ranging.phase_centre_drift",
    "ranging.phase_break",
    "ranging.thermal",
    "timing.star_camera_delay",
)


def _unlisted(slug, function):
    """An effect that the catalogue does not hold; function: (angle (n, 4) rad, extra, time) -> (n,)."""

    def contribution(context, values):
        extra = context.extra
        return values[0] * function(extra["angle"].reshape(-1, 4), extra, context.time - context.epoch)

    return Effect(slug, "range", (Parameter("size", "m", "", 1e-6),), contribution, "")


def _ripple(angle, _, __):
    return np.sin(2 * np.pi * angle[:, 1] / np.radians(0.7))


def _cube(angle, _, __):
    return (angle[:, 2] / 0.05) ** 3


def _rate(angle, _, time):
    return np.abs(np.gradient(angle[:, 0], time)) / 4e-4


def _warm_pointing(angle, extra, _):
    return angle[:, 3] * extra["warmth"] / 0.05


def _latitude(_, extra, __):
    return np.sin(27 * extra["argument"])


def _tone(_, __, time):
    return np.sin(2 * np.pi * 0.0231 * time)


#: Effects in no list, and the driver that has to be named first.
DRIVERS = {
    "odd.ripple": (_ripple, "pointing"),
    "odd.cube": (_cube, "pointing"),
    "odd.rate": (_rate, "pointing_rate"),
    "odd.warm_pointing": (_warm_pointing, "pointing*eclipse"),
    "odd.latitude": (_latitude, "latitude"),
    "odd.tone": (_tone, "time"),
}
UNLISTED = {slug: (_unlisted(slug, law), driver) for slug, (law, driver) in DRIVERS.items()}


def simulated(seed, effects):
    """Columns and truth of a campaign, {slug: {parameter: value}} hidden."""
    chosen = catalog.parameters("simulate_kbr_phase_centre").with_settings({"phase_step_s": 1.0})
    known = {slug: entry for slug, (entry, _) in UNLISTED.items()} | catalogue()
    found = {slug: (known[slug], known[slug].values(given)) for slug, given in effects.items()}
    with mock.patch.object(simulation, "known_effects", return_value=found):
        return simulation.simulate("CD", chosen, DAY, seed, effects)


def products(columns):
    """Products that discovery looks at."""
    chosen, observed = catalog.parameters("kbr_phase_centre"), simulation.ingested(columns)
    nominal = {"nominal_m": NOMINAL}
    aligned = stages.align(*(observed[name] for name in FILES), **chosen.for_stage("align"))
    pointed = stages.pointing(aligned, **chosen.for_stage("pointing"), **nominal, given=())
    equations = stages.observable(aligned, pointed, variant="range", **chosen.for_stage("observable"), **nominal)
    quiet = stages.noise(equations, **chosen.for_stage("noise"))
    solved = stages.solve(equations, quiet, variant="range", **chosen.for_stage("solve"), **nominal)
    return {"align": aligned, "pointing": pointed, "observable": equations, "noise": quiet, "solve": solved}


def settings():
    """Settings of the observations."""
    chosen = catalog.parameters("kbr_phase_centre")
    known = chosen.for_stage("solve") | chosen.for_stage("observable")
    names = ("orbit_degree", "crn_window_s", "crn_bandwidth_hz")
    return {n: known[n] for n in names} | {"nominal_m": NOMINAL}


def limits():
    """Limits of the search."""
    chosen = catalog.parameters("kbr_phase_centre").for_stage("discovery")
    names = ("discovery_level", "tie_chi2", "round_limit", "segment_s", "discovery_seed")
    return Limits(*(chosen[name] for name in names))


def ratio(clean, changed):
    """Signal-to-noise ratio of the difference of two campaigns with the same noise, all baseline parameters free."""
    one, other = (observe(parts, **settings()) for parts in (clean, changed))
    if one.residual.size != other.residual.size:
        return np.nan
    change = (other.residual - one.residual)[:, None]
    rows = [
        replace(block, observed=white(factor, change[half.rows])[:, 0])
        for block, factor, half in zip(one.blocks, one.factors, one.halves, strict=True)
    ]
    problem = prepare(rows, [])
    return float(np.sqrt(attribution.projected(problem.total, baseline_of(problem, ()))[0, 0]))


def drawn(rng, truth, kind):
    """One effect of a plausible size, {slug: {parameter: value}}."""
    if kind == "unlisted":
        return {list(UNLISTED)[rng.integers(len(UNLISTED))]: {"size": 1e-6}}
    entry = catalogue()[LISTED[rng.integers(len(LISTED))]]
    if entry.slug == "ranging.phase_break":
        wave = truth["manoeuvres"][rng.integers(len(truth["manoeuvres"]))]
        return {entry.slug: {"size": 1e-5, "time": rng.uniform(wave["start"] + 150, wave["stop"] - 150)}}
    values = {p.name: p.prior_sigma * rng.standard_normal() for p in entry.parameters}
    if len(values) > 1 and rng.integers(2):
        name = sorted(values)[rng.integers(len(values))]
        values = {name: values[name]}
    return {entry.slug: values}


def scaled(effects, factor):
    """Effects with their strength multiplied, times as they are."""
    return {s: {n: v if n == "time" else factor * v for n, v in given.items()} for s, given in effects.items()}


def hidden(seed, kind):
    """Effects at the wanted ratio."""
    rng = np.random.default_rng([seed, 7])
    columns, truth = simulated(seed, {})
    clean, effects = products(columns), {}
    while len(effects) < (2 if kind == "two" else 1):
        tried = drawn(rng, truth, kind)
        size = ratio(clean, products(simulated(seed, tried)[0]))
        if np.isfinite(size) and 0.3 < size < 300 and not set(tried) & set(effects):
            effects |= scaled(tried, TARGET / size)
    return effects


def case(seed, kind):
    """What was hidden and what was found."""
    effects = {} if kind == "clean" else hidden(seed, kind)
    columns, truth = simulated(seed, effects)
    parts = products(columns)
    begin = time.process_time()
    numbers = json.loads(discover(observe(parts, **settings()), limits()).attrs["numbers"])
    change, true = numbers["calibration_change"], np.concatenate([truth["phase_centre_mm"][x] for x in "CD"])
    errors = {
        w: ((np.array(change[w]) - true) / np.array(change[f"sigma_{w}"])).round(2).tolist()
        for w in ("before", "after")
    }
    found = [{k: f[k] for k in ("cause", "form", "tied_with", "parameters")} for f in numbers["findings"]]
    kept = {k: numbers[k] for k in ("p_before", "p_after")} | {"seconds": time.process_time() - begin}
    return {"kind": kind, "seed": seed, "hidden": effects, "found": found, "errors": errors} | kept


def right(row):
    """Whether exactly the hidden effects are named, each alone or in a tied set that holds it."""
    left = [{f["cause"], *f["tied_with"]} for f in row["found"]]
    for slug in row["hidden"]:
        match = next((one for one in left if slug in one), None)
        if match is None:
            return False
        left.remove(match)
    return not left


def parameter_errors(row):
    """Errors over sigma of the parameters of untied findings that were hidden."""
    found = []
    for one in row["found"]:
        if one["cause"] in row["hidden"] and not one["tied_with"]:
            given = catalogue()[one["cause"]].values(row["hidden"][one["cause"]])
            true = dict(zip((p.name for p in catalogue()[one["cause"]].parameters), given, strict=True))
            if not {n for n, v in true.items() if v} <= set(one["parameters"]):
                continue  # named by one of several parameters that the data do not tell apart
            pairs = [(one["parameters"][n], v) for n, v in true.items() if n in one["parameters"]]
            found += [(p["value"] - v) / p["sigma"] for p, v in pairs if p["value"] is not None]
    return found


def counted(rows, kind):
    """Lines with the figures of a study."""
    lines = []
    if kind == "clean":
        named = sum(bool(r["found"]) for r in rows)
        p = stats.kstest([r["p_before"] for r in rows], "uniform").pvalue
        lines.append(f"named on clean data: {named} of {len(rows)}; uniform p-values: Kolmogorov-Smirnov p = {p:.3f}")
    if kind in ("one", "two"):
        lines.append(f"named right, alone or in the tied set: {sum(map(right, rows))} of {len(rows)}")
        errors = np.abs([e for r in rows for e in parameter_errors(r)])
        lines.append(f"parameters within 3 sigma: {np.sum(errors < 3)} of {errors.size}")
    if kind == "unlisted":
        first = [r["found"][0]["cause"] if r["found"] else "" for r in rows]
        words = [UNLISTED[next(iter(r["hidden"]))][1] for r in rows]
        driver = sum(f == f"unknown:{w}" for f, w in zip(first, words, strict=True))
        listed = sum(any(not f["cause"].startswith("unknown:") for f in r["found"]) for r in rows)
        lines.append(
            f"noticed {sum(map(bool, first))}, driver first {driver}, a catalogue name {listed} of {len(rows)}"
        )
    z = np.array([r["errors"]["after"] for r in rows], dtype=float)
    lines.append(f"phase centres after, rms of error/sigma: {np.sqrt(np.nanmean(z**2)):.3f}")
    return [*lines, f"seconds of processor for one discovery: median {np.median([r['seconds'] for r in rows]):.1f}"]


def main():
    """Run the study and print its lines."""
    kind = sys.argv[1]
    count, first = (int(a) if a else d for a, d in zip((sys.argv[2:] + ["", ""])[:2], (20, 1000), strict=True))
    rows = []
    for seed in range(first, first + count):
        rows.append(case(seed, kind))
        names = [[f["cause"], f["form"], f["tied_with"]] for f in rows[-1]["found"]]
        print(
            json.dumps(
                {
                    "seed": seed,
                    "hidden": rows[-1]["hidden"],
                    "found": names,
                    "p": rows[-1]["p_before"],
                    "errors": rows[-1]["errors"]["after"],
                }
            ),
            flush=True,
        )
    print("\n".join(counted(rows, kind)))


if __name__ == "__main__":
    main()
