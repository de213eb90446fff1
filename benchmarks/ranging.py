"""Routine pointing with star-camera noise as measured: errors over sigma, and what the file's correction would give.

Antenna vectors are drawn 3 mm apart from the mean pointing, so that pointing noise with x held, which returns the
vector along the mean pointing, is found out. Every run is a whole day. With --data: a measured one.
"""

import functools

import numpy as np

from benchmarks.kbr_phase_centre import DAY, chain
from benchmarks.tables import STUDIES, Figure, numbers, rms, rms_figure, say, show, study
from flows import engine, kbr_phase_centre, ranging
from flows.calibration import load
from gravcal import catalog
from gravcal.calibrations.ranging import model
from gravcal.estimation import least_squares, noise, robust
from gravcal.simulation import kbr_phase_centre as simulation
from tasks import common, stage
from tasks import kbr_phase_centre as of_pair
from tasks import ranging as stages

FILES = (("KBR1B", "Y"), ("GNI1B", "C"), ("GNI1B", "D"), ("SCA1B", "C"), ("SCA1B", "D"))
FREE, HELD = [1, 2, 4, 5], [0, 3]  # y and z of both, x
SETTINGS = {"phase_step_s": 1.0, "phase_centre_scatter_mm": 3.0}  # noise as measured; antenna vectors off the axis
SAID = STUDIES["measured"]["said"]
TRAP_HZ = (0.01, 0.04)  # where nearly all of the correction is noise
BANDS_MHZ = (*np.arange(0.5, 5.1, 0.5), *range(6, 11), 12, 14, 17, 20, 25, 30, 40, 60, 80, 100.1)


def ranging_days(options) -> list[Figure]:
    """What the measured day of --data says; without it a study of simulated days."""
    if options.data:
        return of_day(options.data)
    found = study(options, 100, "ranging: {} days", functools.partial(one_day, options.settings), 40_000)
    (error, sigma, noisy, held, share), figures = found, []
    for k, name in enumerate(("y_c", "z_c", "y_d", "z_d")):
        ratio = error[:, k] / sigma[:, k]
        size = f", mean {ratio.mean():+.3f}, rms error {rms(error[:, k]):.2f} mm, sigma {sigma[:, k].mean():.2f} mm"
        figures.append(rms_figure(f"error/sigma {name}", ratio, 4, size))
        other = f"x held {rms(held[:, k]):.2f} mm"
        figures.append(Figure("  rms error, pointing as measured, x free", f"{rms(noisy[:, k]):.2f} mm", other))
    name = "share of the correction less that expected, over sigma, rms by band"
    return show(
        [*figures, Figure(name, numbers(rms(share), ".2f")), Figure("  mean", numbers(share.mean(axis=0), ".2f"))]
    )


def of_day(folder) -> list[Figure]:
    """What a measured day says, and by band the power of readings that its noise model makes white."""
    source, *_, rows = records(folder)
    document, figures = document_of(source), []
    say(document["verdict"]["text"])
    shared = -rows["correction_band"].values
    blocks = beside(rows, np.column_stack([rows["column"].values, shared]))
    observed = rows["observed"].values - shared @ [band["value"] for band in document["share"]]
    powers = [model.whitened_power(one, observed, model.step_of(rows)) for one in blocks]
    for low, high in zip(BANDS_MHZ, BANDS_MHZ[1:], strict=False):
        each = [power[(1e3 * f >= low) & (1e3 * f < high)].mean() for f, power in powers]
        said = f"{np.mean(each):.2f} +- {np.std(each) / len(each) ** 0.5:.2f}, largest of a block {max(each):.2f}"
        figures.append(Figure(f"power of whitened readings over noise, {low:g} to {high:g} mHz", said))
    return show(figures)


def records(folder):
    """Source of a routine day; what is aligned, pointing, equations of the range and rows of routine pointing."""
    pair, source = catalog.parameters("kbr_phase_centre"), load("ranging").source(data=folder)
    aligned = kbr_phase_centre.aligned_records(source, pair)
    pointed, (equations,) = kbr_phase_centre.with_equations(source, pair, aligned, ("range",))
    rows, _ = ranging.quiet_rows(source, catalog.parameters("ranging"))
    return source, *map(stage.read, (aligned, pointed, equations, rows))


def document_of(source) -> dict:
    """Document of a day."""
    found = engine.run(load("ranging").flow, source, catalog.parameters("ranging"), engine="inline")
    return common.document(found, "result.json")


def held_mm(letters):
    """Phase centres (6,) mm of the catalogue."""
    return 1e3 * np.concatenate([catalog.satellite(letter).com_to_antenna.value for letter in letters])


def as_measured(equations):
    """Columns (n, 6) of routine pointing as measured, m of range per mm."""
    return 1e-3 * equations["column"].values[equations["arc"].values == -1]


def beside(rows, column):
    """Blocks of a day, their noise that beside columns (n, q)."""
    settings = catalog.parameters("ranging").for_stage("estimate")
    settings.pop("determined_limit_mm")
    return model.blocks(rows, **settings, beside=column)


def regressed(rows, observed, column):
    """Sizes and covariance of columns (n, q) of a range (n,), by the blocks and the noise of the day."""
    information, right, _ = model.equations_of(beside(rows, column), rows, observed, column)
    covariance = least_squares.covariance(information.sum(axis=0))
    return covariance @ right.sum(axis=0), covariance


def first_said(folder):
    """What the range of a routine day says of the antennas, and what it only seems to say."""
    source, aligned, pointed, equations, rows = records(folder)
    document, soe = document_of(source), held_mm(source.satellite)
    for band in document["share"]:
        low, high = band["band_mhz"]
        name, said = f"share of the correction, {low:g} to {high:g} mHz", SAID["share"].get(f"{low:g}", "")
        yield name, f"{band['value']:.2f} +- {band['sigma']:.2f} (expected {band['expected']:.2f})", said
    for (name, own), true in zip(document["parameters"].items(), soe, strict=True):
        value = f"{own['value']:.1f} +- {own['sigma']:.1f}" if own else "null"
        yield f"  {name}, smoothed pointing", f"{value} mm", f"{true:.1f}, or null"
    quiet = of_pair.noise(equations, **catalog.parameters("kbr_phase_centre").for_stage("noise"))
    density = [1e3 * np.sqrt(np.interp(f, quiet["frequency"], quiet["model"])) for f in (3e-3, 4e-3, 5e-3)]
    mean = 1e-3 * document["share"][0]["range_um"]["none"]
    yield "range minus orbit at 3, 4, 5 mHz", f"{numbers(density, '.2f')} mm/sqrt(Hz)", "0.32 at 4"
    yield "  mean from 2.5 to 5 mHz", f"{mean:.2f} mm/sqrt(Hz)", ""
    for name, one in (("as measured", as_measured(equations)), ("smoothed", 1e-3 * rows["column"].values)):
        value, covariance = regressed(rows, rows["observed"].values, one)
        text = ", ".join(f"{value[k]:.0f} +- {covariance[k, k] ** 0.5:.0f}" for k in HELD)
        yield f"x by pointing {name}", f"{text} mm", SAID[f"x {name}"]
    value, sigma, share = trap(rows, equations, soe)
    behind = numbers(1e3 * behind_correction(aligned, pointed).value, ".2f").split()
    for k, letter in enumerate(source.satellite):
        text = ", ".join(f"{value[i]:.2f} +- {sigma[i]:.2f}" for i in (2 * k, 2 * k + 1))
        yield f"{letter}: y, z by 10 to 40 mHz, x held", f"{text} mm", SAID["trap"][k]
        yield "  behind the file's correction", f"{' '.join(behind[3 * k : 3 * k + 3])} mm", SAID["behind"][k]
    yield "share of the correction, 10 to 40 mHz", "{:.2f} +- {:.2f}".format(*share), "about 0"


def trap(rows, equations, held):
    """y, z of both (4,) mm with x held, their sigmas, and (share, sigma) of the correction, where pointing is noise."""
    step, time, (low, high) = model.step_of(rows), rows["time"].values, TRAP_HZ
    even = np.arange(time[0], time[-1] + step, step)
    grid = np.stack([np.interp(even, time, one - one[0]) for one in as_measured(equations).T], axis=1)
    noisy = noise.filtered(grid, step, lambda f: (f >= low) & (f < high))[np.rint((time - time[0]) / step).astype(int)]
    observed = rows["observed"].values
    value, covariance = regressed(rows, observed - noisy[:, HELD] @ held[HELD], noisy[:, FREE])
    (share,), ((variance,),) = regressed(rows, observed, (noisy @ held)[:, None])
    return value, np.sqrt(np.diag(covariance)), (share, variance**0.5)


def behind_correction(aligned, pointed):
    """Phase centres (6,) m that the antenna correction of the file was made with, without a free bias."""
    second = np.rint(aligned["time_kbr"].values - pointed["time"].values[0]).astype(int)
    given = aligned["antenna_correction"].values
    inside = (second >= 0) & (second < pointed.sizes["time"]) & np.isfinite(given)
    line = np.concatenate(list(pointed["line_of_sight_b"].values[:, second[inside]]), axis=1)
    known = np.isfinite(line).all(axis=1)
    return robust.solve(given[inside][known], line[known], (2.0, 5.0), 6)


def one_day(settings, seed):
    """Errors (4,) mm of y and z, sigmas; errors with noisy pointing, x free and held; shares over sigma by band."""
    invented = catalog.parameters("simulate_ranging").with_settings(SETTINGS | settings)
    columns, truth = simulation.simulate("CD", invented, DAY, seed, {})
    rows, equations, one = process(columns, truth)
    true = np.concatenate([truth["phase_centre_mm"][letter][1:] for letter in "CD"])
    noisy, held = undiluted(rows, equations)
    share = (one["share"].values - one["expected"].values) / np.sqrt(np.diag(one["share_covariance"].values))
    return one["value"].values[FREE] - true, one["sigma"].values[FREE], noisy - true, held - true, share[1:]


def process(columns, truth):
    """Rows of a day and what is found, in memory; shares are those of the true antenna correction."""
    observed, pair = chain.ingested(columns), catalog.parameters("kbr_phase_centre")
    chosen = catalog.parameters("ranging")
    nominal = {"nominal_m": tuple(tuple(1e-3 * v for v in truth["phase_centre_mm"][letter]) for letter in "CD")}
    aligned = of_pair.align(*(observed[name] for name in FILES), **pair.for_stage("align"))
    pointed = of_pair.pointing(aligned, **pair.for_stage("pointing"), **nominal, given=())
    equations = of_pair.observable(aligned, pointed, variant="range", **pair.for_stage("observable"), **nominal)
    rows = stages.align(aligned, pointed, equations, **nominal, **chosen.for_stage("align"))
    return rows, equations, stages.estimate(rows, **chosen.for_stage("estimate"))


def undiluted(rows, equations):
    """The same (4,) of y and z, mm, with pointing as measured as the regressor: x free, and x held at the catalogue."""
    value, covariance = regressed(rows, rows["observed"].values, as_measured(equations))
    off, gain = value[HELD] - held_mm("CD")[HELD], covariance[np.ix_(FREE, HELD)]
    return value[FREE], value[FREE] - gain @ np.linalg.solve(covariance[np.ix_(HELD, HELD)], off)
