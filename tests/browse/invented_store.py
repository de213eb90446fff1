"""Invented products for the pages, a server for them, and a client that asks it."""

import contextlib
import http.client
import json
import threading
import time
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import xarray as xr

from flows.calibration import load_all
from gravcal.browse import app
from gravcal.store import history, keys, location, store

TIME = {"units": "seconds since 2000-01-01 12:00:00", "long_name": "GPS time", "units_metadata": "leap_seconds: none"}
EVENT = "grace-c-2020-03-01"


def dataset(count, scale=1.0, start=6.4e8):
    """Three sines of different size, on a grid of 0.1 s."""
    time = start + 0.1 * np.arange(count)
    waves = scale * np.sin(2 * np.pi * 0.5 * (time - start))[:, None] * np.array([1.0, 2.0, 3.0])
    labels = {"units": "m s-2", "long_name": "an acceleration", "frame": "b"}
    return xr.Dataset(
        {"acceleration_b": (("time", "axis"), waves, labels), "factor": ((), scale, {"units": "1"})},
        {"time": ("time", time, TIME)},
    )


#: Modules of the invented code, with the digests of their text.
MODULES = {"gravcal.estimation.noise": "old", "catalog/igrf.shc": "old", "gravcal.physics.frames": "same"}

#: Label of a raw file, but for its digest.
FILE = {"file": "MAG1B_2020-03-01_C_04.txt", "product": "MAG1B", "satellite": "C", "date": "2020-03-01"}
FILE |= {"release": "04"}


def model(value, **more):
    """Settings with a model as a stage takes it: one rod of a gain of the dipole."""
    rod = {"sigma": 0.002, "unit": "1", "value": value}
    effect = {"cause": "torque.dipole_gain", "form": "rod_y alone", "parameters": {"rod_y": rod}}
    return {"model": json.dumps([effect | more], sort_keys=True)}


def put(name, data, settings=(), inputs=(), files=None, modules=MODULES, stage="", source=""):
    """Publish an invented product; its reference. The source is the digest of a raw file that it was made of."""
    event, _, named = name.partition("/")
    kind, _, variant = named.partition(":")
    labels = [{"kind": one.kind, "variant": one.variant, "digest": one.digest} for one in inputs]
    labels += [FILE | {"digest": source}] if source else []
    recipe = {"event": event, "kind": kind, "variant": variant, "version": 1, "settings": dict(settings)}
    recipe |= {"inputs": labels, "code": repr(sorted(modules.items()))}
    facts = {"stage": stage or f"tasks.{kind}", "seconds": 0.5, "modules": modules, "versions": {"gravcal": "0"}}
    facts["from"] = [{"key": one.key} for one in inputs]
    facts["from"] += [{"path": f"/data/{FILE['file']}", "member": None}] if source else []
    ref = store.put(keys.key(recipe), recipe, (data, files or {}), facts)
    store.point(ref)
    return ref


def result(event, offset_um, origin="measured"):
    """Result document of an invented calibration."""
    adopted = {"offset_um": offset_um, "sigma_um": [1.0, 1.0, 1.0], "sigma_total_um": [8.0, 9.0, 1.0]}
    verdict = {"text": f"Delivered: {event}.", "accuracy_met": True, "consistent": True, "requirement": ["within"] * 3}
    return {"schema_version": "1.0", "status": "delivered", "calibration": "com_offset", "event": event,
            "origin": origin, "verdict": verdict, "adopted": {"variant": "mtq"}, "variants": {"mtq": adopted},
            "manoeuvres": [{"kind": "pitch", "start": 6.36e8, "stop": 6.36e8 + 180}]}  # fmt: skip


def calibration(event, scale, origin="measured", modules=MODULES, extended=(), **settings):
    """Publish the chain of one event: align, two solutions, report; references by stage. Extended: by `model`."""
    align = put(f"{event}/com_offset.align", dataset(20000, scale).assign_attrs(origin=origin))
    solved = dataset(3000, scale * settings.get("gain", 1.0))
    taken = put(f"{event}/com_offset.align:extended", dataset(99, scale), extended, [align]) if extended else align
    ones = {v: put(f"{event}/com_offset.solve:{v}", solved, settings, [taken], modules=modules) for v in ("mtq", "acc")}
    page = "<!DOCTYPE html><title>r</title><p class='verdict'>the report</p><script>document.title = 'ran'</script>"
    told = {"settings": settings | dict(extended)}
    files = {"report.html": page, "result.json": json.dumps(result(event, [10 * scale, 0.0, -5.0], origin) | told)}
    report = put(f"{event}/com_offset.report", dataset(10), told, list(ones.values()), files)
    return {"align": align, "extended": taken, "report": report} | ones


def experiment(name, scale, **settings):
    """Publish the chain of an experiment with a run of its own; references by stage."""
    with location.configured(name):
        own = calibration(EVENT, scale, **settings)
        with history.recorded("com_offset", EVENT) as note:
            note(SimpleNamespace(event=EVENT, unmade=own["report"]), "made", own["report"])
    return own


@dataclass(frozen=True)
class Answer:
    """What the server said."""

    status_code: int
    headers: dict
    text: str


@contextlib.contextmanager
def server(token="", hosts=app.LOCAL):
    """Real server on a free port of this machine; its port."""
    import uvicorn

    listening = app.bound("127.0.0.1", 0)
    settings = uvicorn.Config(app.application(load_all(), token, hosts), log_level="warning", lifespan="off", ws="none")
    running = uvicorn.Server(settings)
    thread = threading.Thread(target=running.run, kwargs={"sockets": [listening]}, daemon=True)
    thread.start()
    while not running.started:
        time.sleep(0.01)
    try:
        yield listening.getsockname()[1]
    finally:
        running.should_exit = True
        thread.join(10)
        listening.close()


@contextlib.contextmanager
def client(token="", hosts=app.LOCAL):
    """Function that asks a server of its own, the path sent as it is, and follows no redirect."""
    with server(token, hosts) as port:

        def ask(path, method="GET", **headers):
            line = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
            with contextlib.closing(line):
                line.request(method, path, headers={name.title(): value for name, value in headers.items()})
                answer = line.getresponse()
                found = {name.lower(): value for name, value in answer.getheaders()}
                return Answer(answer.status, found, answer.read().decode(errors="replace"))

        yield ask
