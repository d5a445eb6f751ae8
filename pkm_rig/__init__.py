"""On-machine calibration of over-constrained parallel kinematic machines."""

import os

from pkm_rig.version import __version__ as __version__

# All matrices here are small: the threads of a linear algebra library would only wait for one another, on a busy
# computer for ten times as long as the work takes. It reads this when it is first loaded, so before numpy.
for _library in ("OPENBLAS", "OMP", "MKL"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")
