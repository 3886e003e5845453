"""Images that are means of neighbouring frames: what a simulation shows of them from their middles alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class AveragedFrames:
    """Per image: how many `frames` of the camera it is the mean of, the standard deviation `spread` of their times (s),
    and the number of the `part` between two events that they lie in."""

    frames: tuple[int, ...]
    spread: tuple[float, ...]
    part: tuple[int, ...]

    def time_mean(self, time: Array, images: Array) -> Array:
        """Means over frames of what is known in their middles: `time` (images,) s, `images` (images, ...).

        T(t) + spread^2 T''(t)/2, the curvature from three images of the same part; exact where T is a parabola.
        """
        out, spread, part = images.copy(), np.array(self.spread), np.array(self.part)
        for number in np.unique(part):
            own = np.flatnonzero(part == number)
            if len(own) < 3:
                continue
            for k in own[spread[own] > 0.0]:
                a = min(max(k - 1, own[0]), own[-1] - 2)
                left, right = time[a + 1] - time[a], time[a + 2] - time[a + 1]
                slope = (images[a + 2] - images[a + 1]) / right - (images[a + 1] - images[a]) / left
                out[k] += spread[k] ** 2 * slope / (left + right)
        return out
