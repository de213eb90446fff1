"""A ranging calibration as discovery sees it: half sub-manoeuvres as blocks of whitened range residuals.

With a whole sub-manoeuvre left out, curvature and y or z of the same satellite cannot be told apart, and nothing could
be predicted; with half of one left out everything stays determined.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from gravcal.calibrations.kbr_phase_centre import noise as noises
from gravcal.calibrations.kbr_phase_centre import solve
from gravcal.calibrations.kbr_phase_centre.schemas import PARAMETERS
from gravcal.effects.base import Context
from gravcal.estimation import crn
from gravcal.estimation.resampling import Resampler
from gravcal.physics import constants, frames, orbit_environment

LETTERS = "ab"
#: Epochs that a half needs beyond its own columns.
LEAST = 60
#: Degree of the slow orbit error in a half over that in the whole: 10 instead of 15 leaves less than 1 nm of 5 mm.
HALF = 2 / 3


@dataclass(frozen=True)
class Arc:
    """Half of a sub-manoeuvre.

    Attributes
    ----------
    label : number, satellite, sign and axis, half
    rows : places in the observations of all halves, one after the other
    time : (n,) s
    place : (n,) int, numbers of the epochs on the even grid
    own : (n, k) columns of slow orbit error and biases, not whitened
    lever : (n, 1, 4) m, range per radian of pointing error
    """

    label: str
    rows: slice
    time: np.ndarray
    place: np.ndarray
    own: np.ndarray
    lever: np.ndarray


@dataclass(frozen=True)
class View:
    """All halves of sub-manoeuvres of a pair, and how a signal on whole seconds gets into their rows.

    Attributes
    ----------
    context : Context on whole seconds
    turning_b : (n, 2, 3) s-1, change of the measured line of sight by the turning of each satellite
    through : filter from whole seconds to the ranging epochs
    arcs : list of Arc
    residual : (m,) m, ranging less orbit less the phase centres of the solution, each half less its mean
    column : (m, 6) 1, of the phase centres
    centre : (6,) m, of the solution
    nominal : (2, 3) m, of the catalogue
    step_s : s, of the ranging epochs
    """

    context: Context
    turning_b: np.ndarray
    through: Resampler
    arcs: list[Arc]
    residual: np.ndarray
    column: np.ndarray
    centre: np.ndarray
    nominal: np.ndarray
    step_s: float


def view(aligned, pointed, equations, measured, solved, *, nominal_m, orbit_degree, crn_window_s, crn_bandwidth_hz):
    """View of the products of a calibration.

    Parameters
    ----------
    aligned, pointed, equations, measured, solved : Dataset, products of kbr_phase_centre, of the range
    nominal_m : (2, 3) m, phase centres of the catalogue
    orbit_degree : of the polynomial per sub-manoeuvre that takes up slow orbit errors
    crn_window_s, crn_bandwidth_hz : s and Hz, of the filter of the ranging

    Returns
    -------
    view : View
    """
    nominal = np.asarray(nominal_m, dtype=float).reshape(2, 3)
    time, good = pointed["time"].values, pointed["usable"].values != 0
    filter_ = crn.Crn(window_s=crn_window_s, bandwidth_hz=crn_bandwidth_hz)
    centre = solved["centre"].values[0, 0]
    centre = np.where(np.isfinite(centre), centre, nominal.reshape(6))
    step = float(measured.attrs["step_s"])
    halves = [(rows, k) for whole in solve.of_manoeuvres(equations) for k, rows in enumerate(np.array_split(whole, 2))]
    degree = int(np.ceil(HALF * orbit_degree))
    arcs = [_arc(equations, half, degree, step) for half in halves if half[0].size > 1]
    kept = [(rows, arc) for rows, arc in arcs if arc["time"].size > arc["own"].shape[1] + LEAST]
    ends = np.cumsum([0, *(rows.size for rows, _ in kept)])
    arcs = [Arc(rows=slice(a, b), **arc) for a, b, (_, arc) in zip(ends[:-1], ends[1:], kept, strict=True)]
    rows = np.concatenate([r for r, _ in kept] or [np.zeros(0, dtype=int)])
    through = crn.operator(filter_, 0, good, (time[0], 1.0), equations["time_kbr"].values[rows])
    column = equations["column"].values[rows]
    residual = equations["observed"].values[rows] - column @ centre
    for arc in arcs:
        residual[arc.rows] -= residual[arc.rows].mean()  # a bias of 220 km would cost six digits
    about = (context(aligned, pointed, nominal), turning(aligned), through)
    return View(*about, arcs, residual, column, centre, nominal, step)


def _arc(equations, half, degree, step):
    """Half of a sub-manoeuvre with its own columns, and its places in the product."""
    rows, number_of_half = half
    time = equations["time_kbr"].values[rows]
    number = int(equations["arc"].values[rows[0]])
    found = {"label": f"{label(equations, number)} {('begin', 'end')[number_of_half]}", "time": time}
    found["place"] = np.rint((time - time[0]) / step).astype(int)
    found["own"] = noises.slow_columns(time, equations["segment"].values[rows], degree, 0)
    return rows, found | {"lever": equations["lever"].values[rows, :1]}


def label(equations: xr.Dataset, number: int) -> str:
    """Words for a sub-manoeuvre, such as "C +pitch".

    Parameters
    ----------
    equations : Dataset with the manoeuvres
    number : of the manoeuvre
    """
    satellite, axis, sign = (int(equations[n][number]) for n in ("satellite_index", "axis_index", "sign"))
    name = equations.attrs["satellites"][satellite]
    return f"{number + 1} {name} {('', '+', '-')[sign]}{('pitch', 'yaw')[axis]}"


def context(aligned: xr.Dataset, pointed: xr.Dataset, nominal: np.ndarray) -> Context:
    """What the effects of the ranging look at, on whole seconds, as measured.

    Parameters
    ----------
    aligned, pointed : Dataset, "kbr_phase_centre.align" and "kbr_phase_centre.pointing"
    nominal : (2, 3) m, phase centres of the catalogue
    """
    time, distance = pointed["time"].values, pointed["range_com"].values
    line = np.moveaxis(pointed["line_of_sight_b"].values, 0, 1)
    position = aligned["position_i"].values[0]
    extra = {
        "angle": np.moveaxis(pointed["angle"].values, 0, 1),
        "range": distance,
        "range_rate": np.gradient(distance, time),
        "line_of_sight_b": line,
        "antenna_x": nominal[:, 0],
        "antenna_correction": np.einsum("nka,ka->n", line, nominal),
    } | _along_the_orbit(time, position)
    noon = constants.DAY * np.round(time.mean() / constants.DAY)
    return Context(time=time, epoch=float(noon), extra=extra)


def _along_the_orbit(time, position):
    """Argument of latitude, latitude, sunlight and warmth of the first satellite."""
    known = np.isfinite(position).all(axis=1)
    orbit, position = time[known][::10], position[known][::10]
    normal = np.cross(position[0], position[min(100, len(position) - 1)])
    argument = np.unwrap(orbit_environment.argument_of_latitude(position, normal))
    latitude = np.arcsin(position[:, 2] / np.linalg.norm(position, axis=1))
    sun = orbit_environment.sun_i(orbit[[0, -1]]).mean(axis=0)
    series = {
        "argument": argument,
        "latitude": latitude,
        "sunlit": orbit_environment.sunlit(position, sun).astype(float),
    }
    series = {name: np.interp(time, orbit, values) for name, values in series.items()}
    return series | {"warmth": orbit_environment.warmth(time, orbit, position)}


def turning(aligned: xr.Dataset) -> np.ndarray:
    """Change of the measured lines of sight by the turning of the satellites, the line itself held.

    Parameters
    ----------
    aligned : Dataset, "kbr_phase_centre.align"

    Returns
    -------
    turning_b : (n, 2, 3) s-1

    Notes
    -----
    (R_bi(t + 1 s) - R_bi(t - 1 s)) e(t) / 2 s; error (2 pi / 250 s)^2 / 6, a ten thousandth.
    """
    position, quaternion = aligned["position_i"].values, aligned["quaternion"].values
    line = position[1] - position[0]
    line = line / np.linalg.norm(line, axis=1, keepdims=True)
    result = np.zeros((line.shape[0], 2, 3))
    for k, toward in enumerate((line, -line)):
        q = np.where(np.isfinite(quaternion[k]), quaternion[k], [1.0, 0.0, 0.0, 0.0])
        rotation = frames.R_bi_from_quaternion(q)
        result[1:-1, k] = np.matvec(rotation[2:] - rotation[:-2], toward[1:-1]) / 2
    return result


def factors(view: View, measured: xr.Dataset) -> list[np.ndarray]:
    """Lower Cholesky factor (n, n) m of the noise of each half.

    Parameters
    ----------
    view : View
    measured : Dataset, "kbr_phase_centre.noise"
    """
    from scipy.linalg import cholesky

    longest = max((int(arc.place[-1]) for arc in view.arcs), default=0)
    lags = noises.lags(measured, 0, longest + 3)
    matrices = [noises.covariance_matrix(lags, arc.place, arc.lever) for arc in view.arcs]
    return [cholesky(m, lower=True, overwrite_a=True, check_finite=False) for m in matrices]


def filtered(view: View, signal: np.ndarray) -> np.ndarray:
    """A signal on whole seconds at the ranging epochs, through their filter.

    Parameters
    ----------
    view : View
    signal : (n, q) m

    Returns
    -------
    columns : (m, q)
    """
    return view.through(np.where(np.isfinite(signal), signal, 0.0))


def white(factor: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Columns (n, q) of a half divided by its factor.

    Parameters
    ----------
    factor : (n, n) m
    columns : (n, q) m
    """
    from scipy.linalg import solve_triangular

    return solve_triangular(factor, columns, lower=True, check_finite=False)


def blocks(view: View, factors: list[np.ndarray]) -> list[dict]:
    """Fields of `gravcal.discovery.blocks.Block` of every half.

    Parameters
    ----------
    view : View
    factors : of `factors`
    """
    found = []
    for arc, factor in zip(view.arcs, factors, strict=True):
        turned = view.column[arc.rows] - view.column[arc.rows].mean(axis=0)  # x is all bias where nothing turns
        data = np.column_stack([view.residual[arc.rows], turned, arc.own])
        rows, width = white(factor, data), 1 + len(PARAMETERS)
        found.append(
            {
                "label": arc.label,
                "observed": rows[:, 0],
                "shared": rows[:, 1:width],
                "own": rows[:, width:],
                "channel": np.array(["range"] * arc.time.size),
                "axis": np.zeros(arc.time.size, dtype=int),
                "time": arc.time,
            }
        )
    return found


def reading(view: View, number: int, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Range less orbit of a half as the phase centres of the solution predict it, and columns in the form of readings.

    Parameters
    ----------
    view : View
    number : of the half
    columns : (n, q) m, not whitened

    Returns
    -------
    time : (n,) s
    model : (n, 1) m
    columns : (q, n, 1) m
    """
    arc = view.arcs[number]
    model = view.column[arc.rows] @ view.centre
    return arc.time, model[:, None], columns.T[:, :, None]
