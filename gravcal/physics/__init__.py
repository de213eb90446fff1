"""Laws of physics: arrays in, arrays out; and cheap checks of the arrays handed in."""

import functools

import numpy as np

from gravcal import errors

refuse = functools.partial(errors.refuse, error=errors.GravcalError)


def check_shape(name, values, shape):
    """Array of floats, checked for a shape; ``None`` in shape stands for any length, a leading ``...`` for any axes."""
    array = np.asarray(values, dtype=float)
    open_ended = shape[0] is Ellipsis
    wanted = shape[1:] if open_ended else shape
    lengths = array.shape[-len(wanted) :] if open_ended else array.shape
    if len(lengths) != len(wanted) or any(w is not None and w != f for w, f in zip(wanted, lengths, strict=True)):
        text = "(" + ", ".join("..." if s is Ellipsis else "n" if s is None else str(s) for s in shape) + ")"
        refuse(name, f"shape {array.shape}", f"shape {text}", "Put vectors on the last axis.", shape=array.shape)
    return array


def check_increasing(name, time, strictly=True):
    """Array (n,) of finite epochs, checked to increase, or without strictly not to decrease."""
    array = check_shape(name, time, (None,))
    steps = np.diff(array)
    if not np.all(np.isfinite(array)):
        refuse(name, "epochs that are not finite", "finite seconds", "Remove them first.")
    wrong = steps <= 0 if strictly else steps < 0
    if np.any(wrong):
        at = int(np.argmax(wrong))
        pair = f"{array[at]:.9f} s followed by {array[at + 1]:.9f} s at index {at}"
        refuse(name, pair, "strictly increasing epochs" if strictly else "sorted epochs", "Sort them.", index=at)
    return array
