"""On-machine calibration of over-constrained parallel kinematic machines.

The functions of `__all__` are the Python interface (`pkm_rig.api`). Each imports what it works with when it is called,
so that `import pkm_rig` takes no time.
"""

import os

from pkm_rig.api import (
    build_tables,
    calibrate,
    compare,
    connect,
    diagnose,
    identify,
    load_machine,
    load_rig,
    measure,
    open_store,
    read_recording,
    reduce,
)
from pkm_rig.version import __version__ as __version__

__all__ = [
    "build_tables",
    "calibrate",
    "compare",
    "connect",
    "diagnose",
    "identify",
    "load_machine",
    "load_rig",
    "measure",
    "open_store",
    "read_recording",
    "reduce",
]

# All matrices here are small: the threads of a linear algebra library would only wait for one another, on a busy
# computer for ten times as long as the work takes. It reads this when it is first loaded, so before numpy.
for _library in ("OPENBLAS", "OMP", "MKL"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")
