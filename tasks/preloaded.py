"""Import this to have what nearly every event needs: libraries, and the tables that the first compiled kernel loads.

Short campaigns import it before they fork, so that their children begin with it. Nothing here starts a thread.
"""

import h5py  # noqa: F401
import jinja2  # noqa: F401
import jsonschema_rs  # noqa: F401
import scipy.linalg  # noqa: F401
import scipy.special  # noqa: F401
import threadpoolctl  # noqa: F401
import xarray  # noqa: F401

from gravcal.physics.small_algebra import cross

cross((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
