"""Finished products in an object store: pushed, read back, verified; an S3 server on loopback."""

import json
import logging

import fsspec
import numpy as np
import pytest
import xarray as xr

from gravcal.errors import ProductError
from gravcal.store import housekeeping, keys, location, product, remote, store

RECIPE = {"event": "e", "kind": "test.a", "variant": "", "version": 1, "settings": {}, "inputs": [], "code": ""}
FACTS = {"seconds": 0.0, "modules": {}, "from": [], "stage": "", "versions": {}}


def put(number, *made_of, **changes):
    """Publish a small product made of others."""
    recipe = RECIPE | changes | {"inputs": [keys.labelled(one) for one in made_of]}
    dataset = product.settled(xr.Dataset({"value": ("row", np.full(3, float(number)), {"units": "1"})}))
    facts = FACTS | {"from": [keys.traced(one) for one in made_of]}
    return store.put(keys.key(recipe), recipe, (dataset, {"note.txt": "n"}), facts)


@pytest.fixture
def delivered():
    """A product with a link and what it was made of; another without a link; the readable link of an experiment."""
    below = put(1)
    above = put(2, below, kind="test.b")
    store.point(above)
    put(3, kind="test.unlinked")
    with location.configured("what-if"):
        store.point(put(4, kind="test.tried"))
    return below, above


@pytest.fixture(scope="module")
def s3():
    """Options of an S3 server on loopback with one bucket."""
    boto3, server = pytest.importorskip("boto3"), pytest.importorskip("moto.server")
    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    running = server.ThreadedMotoServer(ip_address="127.0.0.1", port=0)
    running.start()
    host, port = running.get_host_and_port()
    login = {"aws_access_key_id": "a", "aws_secret_access_key": "b", "region_name": "us-east-1"}
    boto3.client("s3", endpoint_url=f"http://{host}:{port}", **login).create_bucket(Bucket="gravcal")
    yield f"http://{host}:{port}"
    running.stop()


@pytest.fixture(params=["folder", "s3"])
def url(request, tmp_path, monkeypatch):
    """Address of an empty place for products."""
    if request.param == "folder":
        return str(tmp_path / "there")
    for name, value in {"ACCESS_KEY_ID": "a", "SECRET_ACCESS_KEY": "b"}.items():
        monkeypatch.setenv(f"AWS_{name}", value)
    monkeypatch.setenv("AWS_ENDPOINT_URL_S3", request.getfixturevalue("s3"))
    return f"s3://gravcal/{tmp_path.name}"


def elsewhere(tmp_path, monkeypatch):
    """An empty store."""
    monkeypatch.setenv("GRAVCAL_PRODUCTS", str(tmp_path / "elsewhere"))


def test_what_is_delivered_is_read_back_elsewhere(delivered, url, tmp_path, monkeypatch):
    """Contract: with all it was made of, once, whole; no experiment, and nothing that no link leads to."""
    below, above = delivered
    assert remote.push(url)[0] == 2
    assert remote.push(url) == (0, 0)
    elsewhere(tmp_path, monkeypatch)
    assert remote.pull(url)[0] == 2
    assert remote.pull(url) == (0, 0)
    assert housekeeping.verify() == []
    assert {entry.ref.digest for entry in housekeeping.entries(newest_only=False)} == {below.digest, above.digest}
    found = housekeeping.resolve("e/test.b").ref
    assert found.digest == above.digest
    assert float(store.load(found)["value"][0]) == 2


def test_a_link_follows_what_was_made_later(delivered, tmp_path, monkeypatch):
    """Contract: pulling an earlier state again moves no link back."""
    there = str(tmp_path / "there")
    remote.push(there)
    later = put(9, kind="test.b", version=2)
    record = json.loads((later.folder / "meta.json").read_bytes())
    record.pop("sha256_of_record")
    (later.folder / "meta.json").write_bytes(store.sealed(record | {"made": "2999-01-01T00:00:00+00:00"}))
    store.point(later)
    remote.pull(there)
    assert housekeeping.resolve("e/test.b").ref.key == later.key


@pytest.mark.parametrize("name", ["product.nc", "meta.json", "note.txt"])
def test_what_was_damaged_there_is_refused(delivered, tmp_path, monkeypatch, name):
    """Robustness: one clear error, nothing of it in the store."""
    there = tmp_path / "there"
    remote.push(str(there))
    file = next((there / "objects").glob(f"*/{delivered[1].key}/{name}"))
    file.write_bytes(file.read_bytes()[:-3])
    elsewhere(tmp_path, monkeypatch)
    with pytest.raises(ProductError, match="Push it again"):
        remote.pull(str(there))
    assert delivered[1].key not in {path.name for path in housekeeping.folders()}


@pytest.mark.parametrize("url", ["nonsense://x/y", "s3://gravcal/x"])
def test_a_place_that_is_not_there_is_said_in_a_line(delivered, url, monkeypatch):
    """Robustness: an unknown kind of address, a server that does not answer."""
    monkeypatch.setenv("AWS_ENDPOINT_URL_S3", "http://127.0.0.1:9")
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "a")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "b")
    monkeypatch.setenv("AWS_MAX_ATTEMPTS", "1")
    fsspec.get_filesystem_class("s3").clear_instance_cache()
    with pytest.raises(ProductError, match=url):
        remote.push(url)
