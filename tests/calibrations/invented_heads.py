"""Invented SCA1A of heads with a bias and noise of their own, by scipy alone, for tests and benchmarks."""

import numpy as np
from scipy.spatial.transform import Rotation

from gravcal import catalog
from gravcal.calibrations.align import QUATERNION
from gravcal.calibrations.thrusters import noise
from gravcal.io import readers, writers

DAY = "2014-01-15"
BEGIN = (np.datetime64(DAY) - np.datetime64("2000-01-01T12:00")) / np.timedelta64(1, "s")


def heads_file(folder, letter, time, attitude, turns, apart_s=0.0):
    """SCA1A as read of heads {head: turn (n, 3) or (3,) rad of the SRF, noise (n, 3) rad of the head}, by scipy alone.

    The attitude is a function, (n,) s -> Rotation from the SRF to the inertial frame; tags of a head are so much later
    than those of the one before.
    """
    mounting, rows = catalog.satellite(letter).settings()["star_camera_mounting"], []
    for place, (head, (bias, own)) in enumerate(turns.items()):
        tag = time + place * apart_s
        known = np.isfinite(own[:, 0])
        of_head = (
            attitude(tag) * Rotation.from_rotvec(bias) * Rotation.from_quat(mounting[head - 1], scalar_first=True).inv()
        )
        measured = (of_head[known] * Rotation.from_rotvec(own[known])).as_quat(scalar_first=True)
        rows.append(np.column_stack([tag[known], np.full(known.sum(), head), measured]))
    tag, head, *quaternion = (rows := np.concatenate(rows))[np.argsort(rows[:, 0], kind="stable")].T
    second = np.floor(tag + 5e-7)
    columns = {"rcvtime_intg": second.astype(int), "rcvtime_frac": np.rint(1e6 * (tag - second)).astype(int)}
    columns |= {"rcv_time": columns["rcvtime_intg"], "sca_id": head.astype(int), "sca_desig": np.full(tag.size, b"P")}
    nothing = ("nlocks", "nstars", "sca_confid", "sca_null1", "sca_null2", "sca_config1", "sca_config2", "sca_config3")
    columns |= dict.fromkeys(nothing, np.zeros(tag.size, int))
    columns |= dict(zip(QUATERNION, quaternion, strict=True))
    return readers.read(writers.write(columns, folder / writers.file_name("SCA1A", DAY, letter)))


def attitude(time):
    """Rotations from the SRF to the inertial frame: a turn with the orbit, and swings by milliradians."""
    swing = [-1.1e-3 * (time - BEGIN), 2e-3 * np.sin(time / 110), 1e-3 * np.cos(time / 140)]
    return Rotation.from_rotvec([0.3, -1.1, 0.4]) * Rotation.from_euler("YXZ", np.stack(swing, axis=1))


def errors(folder, heads, seed, sigma):
    """Names, errors over sigma and sigma over size (bias: rad) of a record of 3 h at 2 Hz with noise sigma (3, 3) rad.

    Biases of 50 urad, tags of a head 65 ms after those of the one before, each head blind for half an hour.
    """
    rng, time = np.random.default_rng(seed), BEGIN + 0.5 * np.arange(21600)
    bias = {head: 5e-5 * rng.standard_normal(3) for head in heads}
    turns = {head: (bias[head], sigma[head - 1] * rng.standard_normal((time.size, 3))) for head in heads}
    for _, own in turns.values():
        begin = rng.integers(0, time.size - 3600)
        own[begin : begin + 3600] = np.nan
        own[rng.random(time.size) < 0.01] = np.nan
    observed = heads_file(folder, "C", time, attitude, turns, 0.065)
    mounting = catalog.satellite("C").settings()["star_camera_mounting"]
    found = noise.heads(observed, mounting=mounting, block_s=900.0, parts=4)
    true = {f"bias_{h}_{a}": bias[h][i] - bias[heads[0]][i] for h in heads[1:] for i, a in enumerate("xyz")}
    for band in ("slow", "fast"):  # one-sided, 2 x 0.5 s x variance
        true |= {f"noise_{h}_{a}_{band}": sigma[h - 1, i] for h in heads for i, a in enumerate("xyz")}
    names, value, error = (found[name].values for name in ("parameter", "value", "sigma"))
    assert names.tolist() == list(true)
    size = [1.0 if name.startswith("bias") else one for name, one in true.items()]
    return list(true), (value - list(true.values())) / error, error / size
