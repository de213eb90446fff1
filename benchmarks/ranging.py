"""Routine pointing with star-camera noise as measured: errors over sigma, and what the file's correction would give.

python -m benchmarks.ranging [RUNS] [setting=value ...]; or python -m benchmarks.ranging --data FOLDER for one day

Antenna vectors are drawn apart from the mean pointing, 3 mm scatter, so that pointing noise with x held, which returns
the vector along the mean pointing, is found out. Every run is a whole day of Level-1 columns.
"""

import sys
import time
from pathlib import Path

from flows.engine import one_thread, single_threaded

single_threaded()

import numpy as np  # noqa: E402
from scipy import stats  # noqa: E402

from benchmarks.kbr_phase_centre import DAY, FILES  # noqa: E402
from flows import engine  # noqa: E402
from flows.calibration import load  # noqa: E402
from gravcal import catalog  # noqa: E402
from gravcal.calibrations.ranging import model  # noqa: E402
from gravcal.simulation import kbr_phase_centre as simulation  # noqa: E402
from tasks import common, ranging  # noqa: E402
from tasks import kbr_phase_centre as stages  # noqa: E402

#: As on 2014-01-15; antenna vectors off the pointing axis.
SETTINGS = simulation.MEASURED | {"phase_step_s": 1.0, "phase_centre_scatter_mm": 3.0}


def process(columns, truth):
    """Rows of a day and what is found, in memory; shares are those of the true antenna correction."""
    observed, of_pair = simulation.ingested(columns), catalog.parameters("kbr_phase_centre")
    chosen = catalog.parameters("ranging")
    nominal = {"nominal_m": tuple(tuple(1e-3 * v for v in truth["phase_centre_mm"][letter]) for letter in "CD")}
    aligned = stages.align(*(observed[name] for name in FILES), **of_pair.for_stage("align"))
    pointed = stages.pointing(aligned, **of_pair.for_stage("pointing"), **nominal, given=())
    equations = stages.observable(aligned, pointed, variant="range", **of_pair.for_stage("observable"), **nominal)
    rows = ranging.align(aligned, pointed, equations, **nominal, **chosen.for_stage("align"))
    return rows, equations, ranging.estimate(rows, **chosen.for_stage("estimate"))


def undiluted(rows, equations):
    """The same (4,) of y and z, mm, with pointing as measured as the regressor: x free, and x held at the catalogue."""
    chosen = catalog.parameters("ranging").for_stage("estimate")
    chosen.pop("determined_limit_mm")
    column = 1e-3 * equations["column"].values[equations["arc"].values == -1]
    parts = model.blocks(rows, **chosen)
    information, right, _ = model.equations_of(parts, rows["observed"].values, column, rows["time"].values)
    normal, side = information.sum(axis=0), right.sum(axis=0)
    free, held = [1, 2, 4, 5], np.array([catalog.satellite(x).com_to_antenna.value[0] for x in "CD"]) * 1e3
    fixed = np.linalg.solve(normal[np.ix_(free, free)], side[free] - normal[np.ix_(free, [0, 3])] @ held)
    return np.linalg.solve(normal, side)[free], fixed


def study(count, settings):
    """Errors (count, 4) mm of y and z, their sigmas; errors with noisy pointing, x free and held; shares over sigma."""
    invented = catalog.parameters("simulate_ranging").with_settings(SETTINGS | settings)
    found = []
    for seed in range(count):
        columns, truth = simulation.simulate("CD", invented, DAY, 40_000 + seed, {})
        rows, equations, one = process(columns, truth)
        true = np.concatenate([truth["phase_centre_mm"][x][1:] for x in "CD"])
        free = [1, 2, 4, 5]
        noisy, held = undiluted(rows, equations)
        share = (one["share"].values - one["expected"].values) / np.sqrt(np.diag(one["share_covariance"].values))
        found.append(
            [one["value"].values[free] - true, one["sigma"].values[free], noisy - true, held - true, share[1:]]
        )
        assert np.isnan(one["value"].values[[0, 3]]).all()
    return [np.array(one) for one in zip(*found, strict=True)]


def of_day(folder):
    """Print what a measured day says."""
    calibration = load("ranging")
    ref = engine.run(calibration.flow, calibration.source(data=folder), catalog.parameters("ranging"), engine="inline")
    print(common.document(ref, "result.json")["verdict"]["text"])


def main():
    """Run the study and print its table."""
    if "--data" in sys.argv:
        of_day(Path(sys.argv[sys.argv.index("--data") + 1]))
        return
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    settings = dict(text.split("=", 1) for text in sys.argv[2:])
    begin = time.perf_counter()
    with one_thread():
        error, sigma, noisy, held, share = study(count, settings)
    z = error / sigma
    low, high = np.sqrt(stats.chi2.ppf([0.005 / 4, 1 - 0.005 / 4], count) / count)
    print(f"{count} days, {settings or 'as measured'}; error/sigma rms has to lie in {low:.3f} .. {high:.3f}")
    diluted, trapped = (np.sqrt(np.mean(one**2, axis=0)) for one in (noisy, held))
    for k, name in enumerate(("y_c", "z_c", "y_d", "z_d")):
        print(
            f"{name}  error/sigma rms {np.sqrt(np.mean(z[:, k] ** 2)):.3f}  mean {z[:, k].mean():+.3f}  "
            f"rms error {np.sqrt(np.mean(error[:, k] ** 2)):.2f} mm, sigma {sigma[:, k].mean():.2f} mm; pointing as "
            f"measured: x free {diluted[k]:.2f}, x held {trapped[k]:.2f} mm"
        )
    print(
        "share of the correction less that expected, over sigma, rms by band",
        np.sqrt(np.mean(share**2, axis=0)).round(2),
    )
    print("mean", share.mean(axis=0).round(2), f"; {(time.perf_counter() - begin) / count:.1f} s a day")


if __name__ == "__main__":
    main()
