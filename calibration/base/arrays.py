"""The array that every computation takes and gives, and how rows of one are chosen."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
RowSelection = NDArray[np.intp] | NDArray[np.bool_] | slice
