"""Drivers of routine attitude that are no effect of the catalogue: camera in use, shadow, the twin's firings."""

from __future__ import annotations

import numpy as np

from gravcal.effects import Context, catalogue
from gravcal.physics import frames, orbit_environment

AXES = ("x", "y", "z")


def candidates(scenes, other, orbit) -> list[dict]:
    """Candidates with columns (n, 3, q) rad in every block.

    Parameters
    ----------
    scenes : list of Scene
    other : Firings of the twin, or None
    orbit : (time, position_i, field_i) or None
    """
    heads = sorted({int(h) for s in scenes for h in np.unique(s.camera.head)})
    found = [_quality(scenes)]
    if len(heads) > 1:
        found.append(_heads(scenes, heads[:-1]))
    if other is not None:
        impulse = other.impulse_b[:, :, None] * np.eye(3)
        found.append(
            _unknown("twin_firings", "impulse", "N m s", [s.sharp(s.answer(other.time, impulse)) for s in scenes])
        )
    if orbit is not None:
        found += [_shadow(scenes, orbit), _dipole(scenes, orbit)]
    return found


def _unknown(driver, form, unit, columns, names=AXES):
    return {
        "cause": f"unknown:{driver}",
        "form": form,
        "names": list(names),
        "units": [unit] * len(names),
        "columns": columns,
    }


def _quality(scenes):
    columns = [s.camera.quality[:, None, None] * np.eye(3) for s in scenes]
    return _unknown("star_camera_quality", "attitude follows qual_rss", "1", columns)


def _heads(scenes, heads):
    """Attitude that steps when another camera is in use, against the last of the list."""
    columns = [np.concatenate([(s.camera.head == h)[:, None, None] * np.eye(3) for h in heads], axis=2) for s in scenes]
    names = [f"{a}_of_{h}" for h in heads for a in AXES]
    return _unknown("star_camera_in_use", "attitude steps", "rad", columns, names)


def after_torque(scene, torque_b: np.ndarray) -> np.ndarray:
    """Attitude (n, 3, q) rad under torques (n, 3, q) N m at the epochs of a block.

    Parameters
    ----------
    scene : Scene
    torque_b : (n, 3, q) N m
    """
    time = scene.camera.time
    width = np.diff(time, append=time[-1] + scene.camera.step_s)
    return scene.answer(time + width / 2 - 1e-3, torque_b * width[:, None, None])


def _shadow(scenes, orbit):
    """Torque that is there in sunlight only."""
    time, position, _ = orbit
    light = orbit_environment.sunlit(position, orbit_environment.sun_i(time[:1])).astype(float)
    columns = []
    for scene in scenes:
        lit = np.interp(scene.camera.time, time, light)
        columns.append(scene.sharp(after_torque(scene, lit[:, None, None] * np.eye(3))))
    return _unknown("sunlight", "torque in sunlight", "N m", columns)


def _dipole(scenes, orbit):
    """Constant dipole of the satellite in the field along the orbit."""
    entry = catalogue()["torque.residual_dipole"]
    columns = []
    for s in scenes:
        field_i = np.stack([np.interp(s.camera.time, orbit[0], c) for c in orbit[2].T], axis=1)
        field_b = np.matvec(frames.R_bi_from_quaternion(s.camera.quaternion), field_i)
        dipole = entry.columns(Context(time=s.camera.time, dipole_b=np.zeros((s.camera.time.size, 3))))
        torque = np.cross(np.moveaxis(dipole, 2, 1), field_b[:, None, :])
        columns.append(after_torque(s, np.moveaxis(torque, 1, 2)))
    names, units = [p.name for p in entry.parameters], [p.unit for p in entry.parameters]
    return {"cause": entry.slug, "form": "", "names": names, "units": units, "columns": columns}
