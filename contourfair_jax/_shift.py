"""Where levels are traced: counted from the middle of the samples, and a little above plateaus.

Places that are flat but for rounding would make specks at the level of the plateau.  So a level is
raised by `5e-10` of the range of the samples, or by two roundings of the largest sample where these
are more.  Levels that differ by less cannot be told apart.

What is traced is the field less the middle of the range, at levels less the same number.  Of
samples that lie far from zero this difference is exact, and subdivision rounds to digits of the
range, not of the samples.  Subtraction keeps the order of floats, so that bounds stay bounds.
"""

from dataclasses import dataclass

import numpy as np

# In the range of the samples, and in roundings of the largest.
_PART, _ROUNDINGS = 5e-10, 2


@dataclass(frozen=True)
class Values:
    """What the finite samples of a net are like; all zero where there is none.

    Parameters
    ----------
    low, high : float
    precision : float
        Rounding of numbers near 1, in the precision that the net was computed in.
    """

    low: float
    high: float
    precision: float

    @property
    def rounding(self) -> float:
        """Rounding of the largest sample."""
        return self.precision * max(-self.low, self.high)

    @property
    def middle(self) -> float:
        """What is taken off before tracing."""
        return 0.5 * self.low + 0.5 * self.high

    @property
    def spread(self) -> float:
        """Range of the samples."""
        return self.high - self.low

    def shift(self) -> float:
        """By how much levels are raised."""
        return max(_PART * self.spread, _ROUNDINGS * self.rounding)

    def placed(self, levels: np.ndarray) -> np.ndarray:
        """The levels that are traced in the field less its middle."""
        return levels - self.middle + self.shift()


def values_of(net: np.ndarray) -> Values:
    """Range and rounding of the samples of a control net."""
    samples = net[(slice(None, None, 3),) * net.ndim]
    samples = samples[np.isfinite(samples)]
    precision = float(np.finfo(net.dtype).eps)
    if not samples.size:
        return Values(0.0, 0.0, precision)
    return Values(float(samples.min()), float(samples.max()), precision)


def distinct(levels: np.ndarray, least: float) -> np.ndarray:
    """Of sorted levels those that are more than `least` above the one kept before."""
    if not (np.diff(levels) <= least).any():
        return levels
    kept = [levels[0]]
    for level in levels[1:]:
        if level - kept[-1] > least:
            kept.append(level)
    return np.array(kept)
