"""Routine pointing with star-camera noise as measured: errors over sigma, and what the file's correction would give.

Antenna vectors are drawn apart from the mean pointing, 3 mm scatter, so that pointing noise with x held, which returns
the vector along the mean pointing, is found out. Every run is a whole day of Level-1 columns. With --data: one day.
"""

import functools

import numpy as np

from benchmarks.kbr_phase_centre import DAY
from benchmarks.tables import Figure, cases, numbers, rms, rms_figure, say, show, title
from flows import engine
from flows.calibration import load
from gravcal import catalog
from gravcal.calibrations.ranging import model
from gravcal.simulation import kbr_phase_centre as simulation
from gravcal.store import location, product
from tasks import common
from tasks import kbr_phase_centre as of_pair
from tasks import ranging as stages

FILES = (("KBR1B", "Y"), ("GNI1B", "C"), ("GNI1B", "D"), ("SCA1B", "C"), ("SCA1B", "D"))
FREE = [1, 2, 4, 5]  # y and z of both
#: As on 2014-01-15; antenna vectors off the pointing axis.
SETTINGS = simulation.MEASURED | {"phase_step_s": 1.0, "phase_centre_scatter_mm": 3.0}
BANDS_MHZ = (*np.arange(0.5, 5.1, 0.5), *range(6, 11), 12, 14, 17, 20, 25, 30, 40, 60, 80, 100.1)


def ranging(options) -> list[Figure]:
    """What the measured day of --data says; without it a study of simulated days."""
    if options.data:
        return of_day(options.data)
    count = options.runs or 100
    title(f"ranging: {count} days, {options.settings or 'as measured'}")
    found = zip(*cases(functools.partial(one_day, options.settings), range(count), options.workers), strict=True)
    error, sigma, noisy, held, share = (np.array(part) for part in found)
    figures = []
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
    one, chosen = load("ranging"), catalog.parameters("ranging")
    ref = engine.run(one.flow, one.source(data=folder), chosen, engine="inline")
    document = common.document(ref, "result.json")
    say(document["verdict"]["text"])
    path = location.folder() / "latest" / document["event"] / "ranging.align" / "product.nc"
    rows = product.from_bytes(path.read_bytes())
    settings, shared = chosen.for_stage("estimate"), -rows["correction_band"].values
    settings.pop("determined_limit_mm")
    parts = model.blocks(rows, **settings, beside=np.column_stack([rows["column"].values, shared]))
    observed = rows["observed"].values - shared @ [band["value"] for band in document["share"]]
    powers, figures = [model.whitened_power(part, observed, model.step_of(rows)) for part in parts], []
    for low, high in zip(BANDS_MHZ, BANDS_MHZ[1:], strict=False):
        each = [power[(1e3 * f >= low) & (1e3 * f < high)].mean() for f, power in powers]
        said = f"{np.mean(each):.2f} +- {np.std(each) / len(each) ** 0.5:.2f}, largest of a block {max(each):.2f}"
        figures.append(Figure(f"power of whitened readings over noise, {low:g} to {high:g} mHz", said))
    return show(figures)


def one_day(settings, seed):
    """Errors (4,) mm of y and z, sigmas; errors with noisy pointing, x free and held; shares over sigma by band."""
    invented = catalog.parameters("simulate_ranging").with_settings(SETTINGS | settings)
    columns, truth = simulation.simulate("CD", invented, DAY, 40_000 + seed, {})
    rows, equations, one = process(columns, truth)
    true = np.concatenate([truth["phase_centre_mm"][letter][1:] for letter in "CD"])
    noisy, held = undiluted(rows, equations)
    share = (one["share"].values - one["expected"].values) / np.sqrt(np.diag(one["share_covariance"].values))
    if not np.isnan(one["value"].values[[0, 3]]).all():
        raise ValueError(f"seed {seed}: x is determined without a wiggle")
    return one["value"].values[FREE] - true, one["sigma"].values[FREE], noisy - true, held - true, share[1:]


def process(columns, truth):
    """Rows of a day and what is found, in memory; shares are those of the true antenna correction."""
    observed, pair = simulation.ingested(columns), catalog.parameters("kbr_phase_centre")
    chosen = catalog.parameters("ranging")
    nominal = {"nominal_m": tuple(tuple(1e-3 * v for v in truth["phase_centre_mm"][letter]) for letter in "CD")}
    aligned = of_pair.align(*(observed[name] for name in FILES), **pair.for_stage("align"))
    pointed = of_pair.pointing(aligned, **pair.for_stage("pointing"), **nominal, given=())
    equations = of_pair.observable(aligned, pointed, variant="range", **pair.for_stage("observable"), **nominal)
    rows = stages.align(aligned, pointed, equations, **nominal, **chosen.for_stage("align"))
    return rows, equations, stages.estimate(rows, **chosen.for_stage("estimate"))


def undiluted(rows, equations):
    """The same (4,) of y and z, mm, with pointing as measured as the regressor: x free, and x held at the catalogue."""
    chosen = catalog.parameters("ranging").for_stage("estimate")
    chosen.pop("determined_limit_mm")
    column = 1e-3 * equations["column"].values[equations["arc"].values == -1]
    parts = model.blocks(rows, **chosen, beside=column)
    information, right, _ = model.equations_of(parts, rows, rows["observed"].values, column)
    normal, side = information.sum(axis=0), right.sum(axis=0)
    held = np.array([catalog.satellite(x).com_to_antenna.value[0] for x in "CD"]) * 1e3
    fixed = np.linalg.solve(normal[np.ix_(FREE, FREE)], side[FREE] - normal[np.ix_(FREE, [0, 3])] @ held)
    return np.linalg.solve(normal, side)[FREE], fixed
