"""The store of products: found by key, made at most once, never half.

    objects/ab/<key>/product.nc, meta.json     one product with its record and the files that belong to it
    latest/<event>/<stage>                     readable link to the newest product of that name
    tmp/  locks/  quarantine/  memo/           being written; who computes; set aside; what is cheap to remember

A product is written aside, flushed and published by one rename of its folder, so it is there in full or not at all. A
folder counts when its record names its key and the file has the recorded size and time of change; otherwise, and at
every first read, the digest of the bytes decides. What fails is moved to ``quarantine`` and made again.
"""

import contextlib
import datetime
import errno
import fcntl
import hashlib
import json
import math
import os
import platform
import shutil
import uuid
from pathlib import Path

from gravcal.data import disk, location, memory
from gravcal.data.references import ProductRef


def folder_of(key):
    """Folder of the product with this key, whether it exists or not."""
    return location.folder() / "objects" / key[:2] / key


def find(key):
    """Product with this key, or None; one that is not what its record says is set aside.

    Parameters
    ----------
    key : str

    Returns
    -------
    ref : ProductRef or None
    """
    folder = folder_of(key)
    record = read_record(folder)
    if record is None:
        if os.path.lexists(folder):  # also a link that leads nowhere
            set_aside(folder, "no readable record")
        return None
    reason = _doubt(folder, record, key)
    if reason:
        set_aside(folder, reason)
        return None
    return reference(record, folder)


def load(ref):
    """Content of a product, verified; None if it is damaged, and then it has been set aside.

    Parameters
    ----------
    ref : ProductRef

    Returns
    -------
    dataset : Dataset, its arrays shared and not to be changed, without provenance attributes; or None
    """
    held = memory.recall(ref.path)
    if held is not None:
        return held
    record = read_record(ref.folder)
    image = _verified_bytes(ref.folder, record) if record else None
    if image is None:
        set_aside(ref.folder, "bytes differ from the record")
        return None
    from gravcal.data import layout

    dataset = layout.content(image, record)
    memory.keep(ref.path, dataset)
    return dataset.copy()


def arrays(ref, names):
    """Some variables of a product as plain arrays {name: array}, verified; None if it is damaged.

    Parameters
    ----------
    ref : ProductRef; names : of the variables
    """
    record = read_record(ref.folder)
    image = _verified_bytes(ref.folder, record) if record else None
    if image is None:
        return None
    from gravcal.data import netcdf_reading

    return netcdf_reading.arrays(image, names)


def put(key, recipe, made, facts):
    """Publish a product; if another process was first, its product is returned.

    Parameters
    ----------
    key : str
    recipe : dict, what the key was made of
    made : tuple of dataset (checked) and mapping of file name to str or bytes
    facts : dict, joins the record: modules, inputs, stage, seconds

    Returns
    -------
    ref : ProductRef

    Raises
    ------
    ProductError : disk full or store not writable; the store is as before
    """
    dataset, files = made
    aside = disk.new_aside()
    try:
        disk.prepare()
        aside.mkdir()
        record = _write_folder(aside, key, recipe, dataset, files) | facts
        (aside / "meta.json").write_text(json.dumps(record))
        disk.flush(aside)
        ref = _publish(aside, key)
    except OSError as error:
        shutil.rmtree(aside, ignore_errors=True)
        raise disk.unwritable(error, f"{recipe['event']}/{recipe['kind']}") from error
    if ref.digest == record["digest"]:
        memory.keep(ref.path, dataset)
    return ref


def point(ref):
    """Let the readable link of a product's name lead to it; a store that can only be read keeps the old one."""
    link = location.folder() / "latest" / ref.event / ref.stage
    target = os.path.relpath(ref.folder, link.parent)
    with contextlib.suppress(OSError):
        if link.is_symlink() and str(link.readlink()) == target:
            return
        link.parent.mkdir(parents=True, exist_ok=True)
        aside = link.with_name(f".{link.name}.{uuid.uuid4().hex[:8]}")
        aside.symlink_to(target)
        aside.replace(link)


def last_seconds(ref):
    """Seconds that the newest product of this name took to compute; infinite where there is none.

    Parameters
    ----------
    ref : ProductRef, made or not
    """
    record = read_record(location.folder() / "latest" / ref.event / ref.stage) or {}
    return record.get("seconds", math.inf)


@contextlib.contextmanager
def lock(key):
    """Hold the key: others who want to make the same product wait. The kernel releases it when a process dies."""
    try:
        disk.prepare()
        path = location.folder() / "locks" / key
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
    except OSError as error:
        raise disk.unwritable(error, key[:12]) from error
    try:
        with contextlib.suppress(OSError):  # a file system without locks: the rename still protects
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
        path.unlink(missing_ok=True)
    finally:
        os.close(descriptor)


def read_record(folder):
    """Record of a product folder, or None if there is none that can be read."""
    try:
        record = json.loads((folder / "meta.json").read_bytes())
    except (OSError, ValueError):
        return None
    return (
        record if isinstance(record, dict) and {"key", "recipe", "digest", "sha256", "bytes"} <= set(record) else None
    )


def reference(record, folder):
    """ProductRef of a record."""
    recipe = record["recipe"]
    return ProductRef(
        recipe["event"], recipe["kind"], recipe["variant"], record["key"], record["digest"], folder / "product.nc"
    )


def set_aside(folder, reason):
    """Move a product folder to quarantine with a note why; one that vanished meanwhile is no error."""
    memory.drop(folder / "product.nc")
    target = location.folder() / "quarantine" / f"{folder.name}-{uuid.uuid4().hex[:8]}"
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        folder.rename(target)
    except FileNotFoundError:
        return
    except OSError as error:
        raise disk.unwritable(error, f"{folder.name[:12]} ({reason})") from error
    with contextlib.suppress(OSError):
        why = target / "why.txt" if target.is_dir() else target.with_name(f"{target.name}.txt")
        why.write_text(reason + "\n")


def _doubt(folder, record, key):
    """Why a folder cannot be taken as it stands, or None; a changed time of change makes the bytes decide."""
    if record["key"] != key:
        return f"the record names another key, {record['key']}"
    try:
        status = (folder / "product.nc").stat()
    except OSError:
        return "product.nc is missing"
    if status.st_size != record["bytes"]:
        return f"product.nc has {status.st_size} bytes, the record says {record['bytes']}"
    known = status.st_mtime_ns == record.get("mtime_ns") or memory.is_trusted(folder, status)
    if not known and _verified_bytes(folder, record) is None:
        return "bytes differ from the record"
    return _doubtful_file(folder, record)


def _doubtful_file(folder, record):
    """Which of the files beside a product is not as recorded, or None; they are read without another check."""
    for name, digest in record.get("files", {}).items():
        try:
            image = (folder / name).read_bytes()
        except OSError:
            return f"{name} is missing"
        if hashlib.sha256(image).hexdigest() != digest:
            return f"bytes of {name} differ from the record"
    return None


def _verified_bytes(folder, record):
    """Bytes of the product file if their SHA-256 is the recorded one, otherwise None."""
    try:
        image = (folder / "product.nc").read_bytes()
    except OSError:
        return None
    if hashlib.sha256(image).hexdigest() != record["sha256"]:
        return None
    memory.trust(folder, (folder / "product.nc").stat())
    return image


def _write_folder(aside, key, recipe, dataset, files):
    """Write product and files; their record without the facts of the run."""
    from gravcal import __version__
    from gravcal.data import layout, netcdf, product

    content = product.digest(dataset)
    dataset.encoding[product.DIGEST] = content
    labels = product.provenance(recipe, key, content, __version__)
    image, places = netcdf.written(dataset.assign_attrs(labels))
    (aside / "product.nc").write_bytes(image)
    extra = {name: text.encode() if isinstance(text, str) else text for name, text in files.items()}
    for name, text in extra.items():
        (aside / Path(name).name).write_bytes(text)
    return {
        "key": key,
        "digest": content,
        "sha256": hashlib.sha256(image).hexdigest(),
        "bytes": len(image),
        "mtime_ns": (aside / "product.nc").stat().st_mtime_ns,
        "files": {name: hashlib.sha256(text).hexdigest() for name, text in extra.items()},
        "made": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "machine": platform.node(),
        "recipe": recipe,
        **layout.recorded(dataset, places),
    }


def _publish(aside, key):
    """Rename the finished folder to its place; a product that is there already and whole stays, and is returned."""
    folder = folder_of(key)
    if os.path.lexists(folder.parent) and not folder.parent.is_dir():
        set_aside(folder.parent, "no folder")
    folder.parent.mkdir(parents=True, exist_ok=True)
    try:
        aside.rename(folder)
    except OSError as error:
        if error.errno not in (errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR):
            raise
    ref = find(key)
    if aside.exists() and ref is None:
        return _publish(aside, key)
    shutil.rmtree(aside, ignore_errors=True)
    return ref
