"""Finished products in an object store: what the operational configuration delivers, with all it was made of.

An object store has no rename and no lock, so the store that runs write to is a folder, and its products are copied:
``objects/ab/<key>/`` as they are, the record last, and for each readable link an object ``latest/<event>/<stage>``
that holds the key. Addresses are those of fsspec: ``s3://BUCKET/FOLDER``, ``gs://``, ``sftp://``, or a plain path.
"""

import contextlib
import os
import shutil
from pathlib import Path

import fsspec

from gravcal.errors import ProductError
from gravcal.store import housekeeping, location, store

RECORD = "meta.json"


def push(url: str) -> tuple[int, int]:
    """Copy what is delivered and not there yet; number of products and their bytes.

    Two stores that push the same product write the same content; of links the last one stays.
    """
    latest = [entry.ref for entry in housekeeping.entries(configuration=location.OPERATIONAL)]
    pushed = size = 0
    with _reached(url) as (system, root):
        there = set(_keys(system, root))
        for key, record in store.ancestry(*(ref.key for ref in latest)).items():
            folder = store.folder_of(key)
            if key in there or record is None or store.doubt(folder, record):
                continue
            for name in ("product.nc", *record["files"], RECORD):
                system.pipe_file(f"{root}/objects/{key[:2]}/{key}/{name}", (folder / name).read_bytes())
            pushed, size = pushed + 1, size + record["bytes"]
        for ref in latest:
            system.pipe_file(f"{root}/latest/{ref.name}", ref.key.encode())
    return pushed, size


def pull(url: str) -> tuple[int, int]:
    """Copy what is there and not here, verified; number of products and their bytes.

    Readable links follow where there is none, or one to a product that was made earlier. What does not agree with its
    record is refused: ProductError.
    """
    pulled = size = 0
    with _reached(url) as (system, root):
        location.prepare()
        for key in _keys(system, root):
            if store.find(key) is None:
                pulled, size = pulled + 1, size + _fetch(system, f"{root}/objects/{key[:2]}/{key}", key)
        for path in system.find(f"{root}/latest"):
            key = system.cat_file(path).decode(errors="replace")
            ref = store.find(key) if store.KEY.fullmatch(key) else None
            if ref is None:
                continue
            held = store.linked(location.links(ref.event, location.OPERATIONAL) / ref.stage)
            records = [store.read_record(folder) for folder in (held, ref.folder) if folder]
            if len(records) == 1 or records[0] is None or records[0]["made"] < records[1]["made"]:
                with location.configured(location.OPERATIONAL):
                    store.point(ref)
    return pulled, size


def _keys(system, root):
    """Keys of the products that are there in full, sorted."""
    found = (path.split("/")[-2:] for path in system.find(f"{root}/objects"))
    return sorted(key for key, name in found if name == RECORD and store.KEY.fullmatch(key))


def _fetch(system, there, key):
    """Bytes of a product that has been fetched, compared with its record and published."""
    aside = location.new_aside()
    folder = aside / key
    try:
        folder.mkdir(parents=True)
        (folder / RECORD).write_bytes(system.cat_file(f"{there}/{RECORD}"))
        record, reason = store.believed(folder)
        for name in ("product.nc", *record["files"]) if record else ():
            (folder / Path(name).name).write_bytes(system.cat_file(f"{there}/{name}"))
        reason = reason or store.doubt(folder, record)
        if reason:
            raise ProductError(f"{there}: {reason}. Push it again from the store that made it; nothing was taken.")
        os.utime(folder / "product.nc", ns=(record["mtime_ns"], record["mtime_ns"]))
        store.publish(folder, key)
    finally:
        shutil.rmtree(aside, ignore_errors=True)
    return record["bytes"]


@contextlib.contextmanager
def _reached(url):
    """File system and root of an address; what fsspec raises becomes one clear line."""
    try:
        system, root = fsspec.core.url_to_fs(url)
        system.invalidate_cache()
        system.auto_mkdir = True  # folders of a plain path
        yield system, root.rstrip("/")
    except ImportError as error:
        remedy = "pip install 'gravcal[s3]' for s3://; for others what fsspec names"
        raise ProductError(f"{url}: {error}. Install what it needs ({remedy}).") from error
    except ProductError:
        raise
    except Exception as error:
        raise ProductError(
            f"{url}: cannot be read or written ({type(error).__name__}: {error}). Look at address, rights and login; "
            f"what was copied before stays, and the next time goes on from there."
        ) from error
