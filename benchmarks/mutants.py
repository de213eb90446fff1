"""`python -m benchmarks mutants`: one line of the code changed at a time, and whether the tests beside it notice.

A fixed table of wrong signs, factors, bounds and units in physics, estimation, noise, readers and discovery. Each is
put into a copy of the project, and of the suite only the tests nearest to it, named beside it, run there: until one
fails, in a fork of a process that has loaded the libraries, and once without any change to see them pass. What they
kill the suite kills. What survives is a hole in the tests, or changes nothing; a text that is gone is stale.
"""

import importlib
import os
import shlex
import shutil
import sys
import tempfile
from multiprocessing import get_context
from pathlib import Path

from benchmarks.tables import Figure, at_least, say, show, title

ROOT = Path(__file__).parents[1]
COPIED = ("gravcal", "flows", "tasks", "catalog", "tests", "benchmarks", "pyproject.toml")
LOADED = ("numba", "numpy", "pandas", "pytest", "scipy.signal", "scipy.stats", "xarray")
LIMIT_S = 1200  # then a mutant hangs, which is noticed
WANTED = 0.95  # share of the mutants that tests have to notice
FIELD, SERIES, ATTITUDE = "physics/test_gravity.py", "physics/test_gravity_field.py", "physics/test_dynamics.py"
FRAMES, EARTH, IGRF = "physics/test_frames.py", "physics/test_earth.py", "physics/test_magnetic.py"
NOISE, SQUARES, TIMES = "estimation/test_noise.py", "estimation/test_estimation.py", "estimation/test_timing.py"
WRITTEN, BAD, ROUNDS = "io/test_read_round_trip.py", "io/test_read_bad_input.py", "discovery/test_rounds.py"
MOTION, SENSING, SCAN = "physics/test_kinematics.py", "physics/test_sensing.py", "discovery/test_scan.py"
PARTS, HELD = "calibrations/inertial_sensor/test_inertial_sensor_parts.py", "discovery/test_held_out.py"
#: File below gravcal/, text that stands there once, what is put in its place, tests that should fail.
MUTANTS = (
    ("physics/gravity.py", "* r + 2 * z * k)", "* r - 2 * z * k)", FIELD),
    ("physics/gravity.py", "(5 - 35 * u**2)", "(5 - 30 * u**2)", FIELD),
    ("physics/gravity.py", "(3 * rr / d**2 - one)", "(one - 3 * rr / d**2)", FIELD),
    ("physics/gravity.py", "R @ tensor_b @ np.swapaxes(R, -1, -2)", "np.swapaxes(R, -1, -2) @ tensor_b @ R", FIELD),
    ("physics/gravity_field.py", "(n + m + 1) * (n - m + 1), 0", "(n + m + 1) * (n - m), 0", SERIES),
    ("physics/gravity_field.py", "up, down = (-0.5, 0.5)", "up, down = (-0.5, -0.5)", SERIES),
    ("physics/gravity_field.py", "(n - 1) * n * (n + 1) * (n + 2) / 8", "(n - 1) * n * (n + 1) * (n + 2) / 4", SERIES),
    ("physics/gravity_field.py", "[kept, None] < lowest", "[kept, None] <= lowest", SERIES),
    ("physics/dynamics.py", "vex(J @ G - G @ J)", "vex(G @ J - J @ G)", ATTITUDE),
    ("physics/dynamics.py", "(torque_b - gyroscopic)", "(torque_b + gyroscopic)", ATTITUDE),
    ("physics/dynamics.py", "2 * (x * y + s * z), 2 * (x * z", "2 * (x * y - s * z), 2 * (x * z", ATTITUDE),
    ("physics/dynamics.py", 'searchsorted(edges, middle, side="right")', "searchsorted(edges, breaks)[:-1]", ATTITUDE),
    ("physics/frames.py", "b0 * a2 + a3 * b1 - a1 * b3", "b0 * a2 - a3 * b1 + a1 * b3", FRAMES),
    ("physics/frames.py", "np.stack([S[..., 2, 1],", "np.stack([S[..., 1, 2],", FRAMES),
    ("physics/frames.py", "q[1:], q[:-1]) < 0", "q[1:], q[:-1]) > 0", FRAMES),
    ("physics/frames.py", "(conjugate(reference), quaternion)", "(quaternion, conjugate(reference))", FRAMES),
    ("physics/frames.py", "y = np.cross(velocity, position)", "y = np.cross(position, velocity)", PARTS),
    ("physics/kinematics.py", "2 * coefficients[:, 2]", "coefficients[:, 2]", MOTION),
    ("physics/kinematics.py", "(axis + 1) % 3, (axis + 2) % 3", "(axis + 2) % 3, (axis + 1) % 3", MOTION),
    ("physics/kinematics.py", "+ step**2 / 12 *", "- step**2 / 12 *", MOTION),
    ("physics/kinematics.py", "return R_bi @ running_integral", "return running_integral", PARTS),
    ("physics/sensing.py", "cross_matrix(rate_b) @ cross_matrix(rate_b)", "cross_matrix(rate_b)", SENSING),
    ("physics/sensing.py", "rate_dot_b) - check_shape", "rate_dot_b) + check_shape", SENSING),
    ("physics/earth.py", "(None, 3)) + np.cross(rate_e", "(None, 3)) - np.cross(rate_e", EARTH),
    ("physics/earth.py", "_julian(time + TAI_MINUS_GPS,", "_julian(time,", EARTH),
    ("physics/earth.py", "(97, 106), 1e-3 * ARCSECOND", "(97, 106), ARCSECOND", EARTH),
    ("physics/earth.py", "[-sin * cos_l, -sin * sin_l, cos]", "[sin * cos_l, -sin * sin_l, cos]", EARTH),
    ("physics/magnetic.py", "(year[here] - epochs[k])", "(year[here] - epochs[k + 1])", IGRF),
    ("physics/magnetic.py", "(starts[at + 1] - starts[at])", "31557600.0", IGRF),
    ("physics/magnetic.py", "field * -1e-9", "field * 1e-9", IGRF),
    ("estimation/noise.py", "(1 - reflection[k] ** 2)", "(1 + reflection[k] ** 2)", NOISE),
    ("estimation/noise.py", "= 2 * (ahead @ behind) / power", "= (ahead @ behind) / power", NOISE),
    ("estimation/noise.py", "max(count - removed, 1)", "max(count, 1)", NOISE),
    ("estimation/noise.py", "2 * self.step_s * self.variance", "self.step_s * self.variance", NOISE),
    ("estimation/noise.py", ": k - 1] - reflection[k - 1]", ": k - 1] + reflection[k - 1]", NOISE),
    ("estimation/noise.py", "np.append(-rows[order][::-1], 1.0)", "np.append(-rows[order], 1.0)", NOISE),
    ("estimation/least_squares.py", "columns - basis @ (basis.T", "columns - 0.9 * basis @ (basis.T", SQUARES),
    ("estimation/least_squares.py", "result[lost, lost] = np.inf", "result[lost, lost] = 0.0", SQUARES),
    ("estimation/least_squares.py", "normal[size:, size:] = np.eye(count)", "normal[size:, size:] = 0.0", SQUARES),
    ("estimation/least_squares.py", "np.eye(len(modes)) + M.T", "np.eye(len(modes)) - M.T", SQUARES),
    ("estimation/least_squares.py", "rank - _rank(sum(informations))", "rank", SQUARES),
    ("estimation/least_squares.py", "(2 * time - start - stop)", "(time - start)", SQUARES),
    ("estimation/chi2_tail.py", "incc(shape, np", "incc(shape, 2 * np", "estimation/test_chi2_tail.py"),
    ("estimation/resampling.py", "found[j] /= total", "found[j] /= 1.0001 * total", "estimation/test_resampling.py"),
    ("estimation/resampling.py", "ok = ok and good[last]", "ok = ok or good[last]", "estimation/test_resampling.py"),
    ("estimation/timing.py", "flagged = clock.ends[:-1] | clock", "flagged = clock.ends[:-1] & clock", TIMES),
    ("estimation/timing.py", "(np.abs(past) <= limits", "(past <= limits", TIMES),
    ("estimation/timing.py", 'tags.second, side="right") - 1', "tags.second) - 1", TIMES),
    ("estimation/crn.py", "-(rate**2) * np.cos(phase)", "rate**2 * np.cos(phase)", "estimation/test_crn.py"),
    ("estimation/crn.py", "return taps - lowpass * taps.sum()", "return taps", "estimation/test_crn.py"),
    ("estimation/robust.py", "/ slope**2 * share", "/ slope * share", "estimation/test_robust.py"),
    ("estimation/robust.py", "(k1 - k0)) ** 2", "(k1 - k0))", "estimation/test_robust.py"),
    ("estimation/kalman.py", "total = noise[t] + h @ Ph", "total = h @ Ph", "estimation/test_kalman.py"),
    ("io/readers/__init__.py", "af[(i + 2) % 3]: af[i]", "af[(i + 1) % 3]: af[i]", "test_bad_input.py -k clean_event"),
    ("io/readers/__init__.py", "ticks = ticks + values * tick", "ticks = ticks + values", WRITTEN),
    ("io/readers/__init__.py", "and len(column.range) == 2", "and len(column.range) == 3", BAD),
    ("io/readers/__init__.py", "same & ~equal]] |= CONFLICTING", "same & ~equal]] |= REPEATED", BAD),
    ("io/readers/__init__.py", "!= satellite.encode()", "== satellite.encode()", BAD),
    ("io/readers/records.py", "return int(token, 2)", "return int(token[::-1], 2)", WRITTEN),
    ("io/readers/records.py", '">" + codes.get', '"<" + codes.get', BAD),
    ("io/readers/products/TIM1B.toml", '"nanoseconds", range', '"microseconds", range', WRITTEN),
    ("io/readers/products/MAG1B.toml", "current_b_sign = 1\n", "current_b_sign = -1\n", WRITTEN),
    ("io/vcm.py", 'observed["mag"].values[:, None] * cosines', "cosines", "io/test_vcm.py"),
    ("io/icgem.py", "(2.0 - (m == 0)) * (2 * n + 1)", "(2 * n + 1)", "io/test_icgem.py"),
    ("io/daily.py", "np.diff(time[order]) > 0", "np.diff(time[order]) >= 0", "io/test_sgrs_files.py"),
    ("discovery/attribution.py", "both) - _foretold(", "both) + _foretold(", HELD),
    ("discovery/attribution.py", "/ (1 - m) + np.log(m)", "/ (1 - m) - np.log(m)", HELD),
    ("discovery/attribution.py", "return whole - float(part @ part)", "return whole", f"{ROUNDS} -k looks_the_same"),
    ("discovery/attribution.py", "value > ROUNDING *", "value > 0 *", f"{ROUNDS} -k rounding"),
    ("discovery/scan.py", "return np.sum(part**2, axis=1)", "return np.sum(abs(part), axis=1)", SCAN),
    ("discovery/adequacy.py", "least[1:] <= least[0]", "least[1:] >= least[0]", f"{ROUNDS} -k line_is_found"),
    ("discovery/problem.py", "np.arange(block.time.size) % 2 == 0", "block.time < 0", f"{ROUNDS} -k few_numbers"),
    ("discovery/model_average.py", "log(width) + gain / width", "log(width) - gain / width", f"{ROUNDS} -k any_form"),
    ("discovery/rounds.py", "2 * np.sqrt(tie * apart) - apart", "-apart", f"{ROUNDS} -k chance_lets"),
)  # fmt: skip


def run(options) -> list[Figure]:
    """Every mutant of the table, or `--runs` of them from `--first` on; a line each."""
    chosen = MUTANTS[options.first :][: options.runs]
    title(f"mutants: {len(chosen)} changed lines, each with the tests beside it")
    with tempfile.TemporaryDirectory() as folder:
        copy, left = Path(folder), 0
        for name in COPIED:
            of = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
            of(ROOT / name, copy / name)
        named = list(dict.fromkeys(tests for *_, tests in chosen))
        whole = " tests/".join(tests for tests in named if " -k " not in tests)
        for tests in filter(None, (whole, *(tests for tests in named if " -k " in tests))):
            if noticed(copy, tests):
                raise SystemExit(f"tests/{tests} fails without any change")
        for path, old, new, tests in chosen:
            file = copy / "gravcal" / path
            whole = file.read_text()
            found = "STALE"
            if whole.count(old) == 1:
                file.write_text(whole.replace(old, new))
                found = "killed" if noticed(copy, tests) else "SURVIVED"
                file.write_text(whole)
            left += found != "killed"
            say(f"{found:8} {path}: {old.strip()} -> {new.strip()}")
    return show([at_least("share killed", 1 - left / len(chosen), WANTED)])


def noticed(copy: Path, tests: str) -> bool:
    """True if some of the tests fail in the copy.

    Parameters
    ----------
    copy : folder of the project
    tests : arguments of pytest, below tests/
    """
    for name in LOADED:
        importlib.import_module(name)
    fork = get_context("fork").Process(target=_test, args=(copy, tests))
    fork.start()
    fork.join(LIMIT_S)
    if fork.is_alive():
        fork.kill()
        return True
    if fork.exitcode not in (0, 1, 2):
        raise SystemExit(f"pytest tests/{tests} ended with {fork.exitcode}")
    return fork.exitcode != 0


def _test(copy, tests):
    """Exit as pytest does, with the code of the copy and without a word."""
    import pytest

    for name in [name for name in sys.modules if name.partition(".")[0] in COPIED]:
        del sys.modules[name]
    os.chdir(copy)
    sys.path[:0], sys.dont_write_bytecode, os.environ["PYTHONPATH"] = [str(copy)], True, str(copy)
    for stream in (1, 2):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
    os._exit(pytest.main(["-x", "-q", "-p", "no:cacheprovider", *shlex.split(f"tests/{tests}")]))
