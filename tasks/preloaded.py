"""Import this to have what nearly every event needs at its end: libraries without the compiler and its kernels.

Short campaigns import it before they fork, so that their children begin with it. Nothing here starts a thread.
"""

import h5py  # noqa: F401
import jinja2  # noqa: F401
import jsonschema_rs  # noqa: F401
import scipy.special  # noqa: F401
import threadpoolctl  # noqa: F401
import xarray  # noqa: F401
