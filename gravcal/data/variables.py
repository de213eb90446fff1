"""Variables made without the imports of dask that xarray does elsewhere, which a short run would wait for."""


def made(name, dims, values, attributes):
    """Variable; numbers along a dimension are its index at once.

    Parameters
    ----------
    name : str
    dims : tuple of str
    values : array
    attributes : dict
    """
    import pandas as pd
    import xarray as xr

    if dims == (name,) and values.dtype.kind in "fiu":
        return xr.IndexVariable(dims, pd.Index(values), attributes, fastpath=True)
    return xr.Variable(dims, values, attributes, fastpath=True)
