"""Routine attitude as discovery sees it: whitened rows, a smooth torque of each block, candidates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gravcal.calibrations.attitude_thrusters import drivers, placebo, response
from gravcal.calibrations.attitude_thrusters import noise as noises
from gravcal.calibrations.attitude_thrusters.series import Camera, Firings
from gravcal.effects import Context, catalogue
from gravcal.estimation import least_squares

#: Whitened components; with a single camera the second and third are mixtures of pitch and yaw.
CHANNELS = ("roll", "pitch", "yaw")
DELAY_S = 0.5  # s, half the step of the derivative by the delay of the firings


@dataclass(frozen=True)
class Scene:
    """One block of time.

    Attributes
    ----------
    camera : Camera, its epochs
    place : (n,) int, on the even grid
    angle_b : (n, 3) rad, attitude against a steady turn
    own : (n, k) what a smooth torque about one axis can do
    table : callable, response to an impulse
    """

    camera: Camera
    place: np.ndarray
    angle_b: np.ndarray
    own: np.ndarray
    table: Callable

    def answer(self, epochs: np.ndarray, impulse_b: np.ndarray) -> np.ndarray:
        """Attitude (n, 3, q) rad after impulses (k, 3, q) N m s."""
        return response.after_impulses(self.camera.time, epochs, impulse_b, self.table)

    def sharp(self, columns: np.ndarray) -> np.ndarray:
        """Columns (n, 3, q) less what the smooth torque can do, so that the rest is not small beside it."""
        flat = columns.reshape(len(columns), -1)
        return (flat - self.own @ np.linalg.lstsq(self.own, flat, rcond=None)[0]).reshape(columns.shape)


def view(
    camera: Camera, firings: Firings, other: Firings | None, orbit, inertia_b, **settings
) -> tuple[list[dict], list[dict], dict]:
    """Blocks and candidates of one satellite and day.

    Parameters
    ----------
    camera : Camera
    firings : Firings, of this satellite
    other : Firings of its twin, a driver that should explain nothing; None without it
    orbit : (time (m,) s, position_i (m, 3) m, field_i (m, 3) T) or None
    inertia_b : (3, 3) kg m2
    settings : block_s, knot_s, quiet_minimum_s, noise_order, head_minimum

    Returns
    -------
    blocks, candidates : fields of `gravcal.discovery.blocks.Block` and `Candidate`
    facts : noise of the quiet stretches, and how much wrong times of the firings gain
    """
    noise = noises.measured(camera, firings.time, settings)
    usable = camera.part(np.isin(camera.head, list(noise.factor)))
    scenes = [_scene(part, inertia_b, settings) for part in _parts(usable, settings["block_s"])]
    blocks = [_block(scene, noise) for scene in scenes]
    found = [_firings(scenes, firings)]
    bases = [placebo.basis(b["own"]) for b in blocks]
    share = _share(blocks, bases, _whitened(found[0], scenes, noise)["columns"])
    found += [*_others(scenes, Firings(firings.time, firings.impulse_b * share))]
    found += drivers.candidates(scenes, other, orbit)
    found = [_whitened(c, scenes, noise) for c in found]
    factor, gains = _inflation(blocks, bases, (scenes, firings, noise), found)
    scaled = [b | {k: b[k] / np.sqrt(factor) for k in ("observed", "own")} for b in blocks]
    found = [c | {"columns": [p / np.sqrt(factor) for p in c["columns"]]} for c in found]
    return scaled, found, {"inflation": factor, "placebo_gains": gains.tolist(), "quiet_epochs": noise.samples}


def _inflation(blocks, bases, given, found):
    """Of `placebo`, with firings, their delay and the camera in use in the model."""
    scenes, firings, noise = given
    names = ("torque.thruster_firings", "timing.thruster_delay", "unknown:star_camera_in_use")
    present = [c["columns"] for c in found if c["cause"] in names]
    moved = (Firings(firings.time + s, firings.impulse_b) for s in placebo.SHIFTS_S)
    wrong = (_whitened(_firings(scenes, m), scenes, noise)["columns"] for m in moved)
    return placebo.inflation(blocks, bases, present, wrong)


def _whitened(candidate, scenes, noise):
    rows = [noise.rows(s.camera.head, s.place, c) for s, c in zip(scenes, candidate["columns"], strict=True)]
    return candidate | {"columns": rows}


def _share(blocks, bases, columns):
    """Share of the nominal impulses (3,) that fits best: where the delays, not linear, are differentiated."""
    normal, right = np.zeros((3, 3)), np.zeros(3)
    for block, basis, column in zip(blocks, bases, columns, strict=True):
        clean = placebo.less(basis, column)
        normal, right = normal + clean.T @ clean, right + clean.T @ block["observed"]
    return least_squares.stable_inverse(normal) @ right


def _parts(camera, block_s):
    """Epochs of each block of time, those with less than half of theirs left out."""
    index = np.floor((camera.time - camera.time[0]) / block_s)
    rows = [np.flatnonzero(index == i) for i in np.unique(index)]
    return [camera.part(r) for r in rows if r.size * camera.step_s > block_s / 2]


def _scene(part, inertia_b, settings):
    angle, rate = response.reference(part.time, part.quaternion)
    place = np.rint((part.time - part.time[0]) / part.step_s).astype(int)
    own = response.smooth_torque(part.time, settings["knot_s"])
    table = response.table(np.asarray(inertia_b, dtype=float), rate, np.ptp(part.time))
    return Scene(part, place, angle, own, table)


def _block(scene, noise):
    """Observed rows and the smooth torque of a block; nothing is shared between blocks."""
    eye = np.eye(3)
    own = np.einsum("nk,ac->nakc", scene.own, eye).reshape(scene.place.size, 3, -1)
    rows = noise.rows(scene.camera.head, scene.place, np.concatenate([scene.angle_b[..., None], own], axis=2))
    count = len(rows) // 3
    time = scene.camera.time[0] + scene.camera.step_s * np.arange(count)
    return {
        "label": f"from {scene.camera.time[0]:.0f} s",
        "observed": rows[:, 0],
        "shared": np.zeros((3 * count, 0)),
        "own": rows[:, 1:],
        "channel": np.repeat(CHANNELS, count),
        "axis": np.zeros(3 * count, dtype=int),
        "time": np.tile(time, 3),
    }


def _firings(scenes, firings):
    """Impulses of the firings as shares of the nominal ones."""
    entry = catalogue()["torque.thruster_firings"]
    impulse = entry.columns(Context(time=firings.time, extra={"nominal_impulse_b": firings.impulse_b}))
    return named(entry, [s.sharp(s.answer(firings.time, impulse)) for s in scenes])


def _others(scenes, firings):
    """Other effects of the catalogue that act on torque or attitude."""
    late = [s.sharp(_delayed(s, firings)) for s in scenes]
    yield named(catalogue()["timing.thruster_delay"], late)
    yield named(catalogue()["timing.star_camera_delay"], [-c for c in late])  # the smooth part of the rate is free
    for slug in ("torque.constant", "attitude.star_camera_misalignment"):
        entry = catalogue()[slug]
        columns = [entry.columns(Context(time=s.camera.time)) for s in scenes]
        if entry.channel == "torque_b":
            columns = [drivers.after_torque(s, c) for s, c in zip(scenes, columns, strict=True)]
        yield named(entry, columns)


def _delayed(scene, firings):
    """Change of the attitude by each second that the tags of the firings are late."""
    impulse = firings.impulse_b[:, :, None]
    early, late = (scene.answer(firings.time + d, impulse) for d in (-DELAY_S, DELAY_S))
    return (early - late) / (2 * DELAY_S)


def named(entry, columns) -> dict:
    """Candidate of an effect of the catalogue.

    Parameters
    ----------
    entry : Effect
    columns : (n, 3, q) a block
    """
    names, units = [p.name for p in entry.parameters], [p.unit for p in entry.parameters]
    return {"cause": entry.slug, "form": "", "names": names, "units": units, "columns": columns}
