"""Images that are means of neighbouring frames, predicted from the simulation at their mean times alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class AveragedFrames:
    """Per image: number of `frames` of the camera in the mean, standard deviation `spread` of their times (s), `part`.

    `part` numbers the intervals between events of the schedule; no mean reaches over an event.
    """

    frames: tuple[int, ...]
    spread: tuple[float, ...]
    part: tuple[int, ...]

    def time_mean(self, time: Array, images: Array) -> Array:
        """Means over frames from `images` (images, ...) predicted at their mean times `time` (images,) s.

        T(t) + spread^2 T''(t)/2, with the curvature from three images of the same part; exact where T is a parabola.
        """
        out, spread, part = images.copy(), np.array(self.spread), np.array(self.part)
        for number in np.unique(part):
            within = np.flatnonzero(part == number)
            if len(within) < 3:
                continue
            for k in within[spread[within] > 0.0]:
                a = min(max(k - 1, within[0]), within[-1] - 2)
                left, right = time[a + 1] - time[a], time[a + 2] - time[a + 1]
                slope = (images[a + 2] - images[a + 1]) / right - (images[a + 1] - images[a]) / left
                out[k] += spread[k] ** 2 * slope / (left + right)
        return out
