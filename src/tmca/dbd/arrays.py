"""The kinds of array in this wing."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Complex = NDArray[np.complexfloating[Any, Any]]
Real = NDArray[np.floating[Any]]
Whole = NDArray[np.signedinteger[Any]]
Mask = NDArray[np.bool_]
