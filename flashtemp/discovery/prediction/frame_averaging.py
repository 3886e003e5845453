"""Averaging of frames in long recordings, where hardly anything changes between neighbouring frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from flashtemp.comparison.campaign import Campaign, RecordingEntry
from flashtemp.comparison.frame_means import AveragedFrames
from flashtemp.model.case import Case

MAX_UNAVERAGED_PIXELS = 4_000_000  # of all recordings of a campaign; above it frames are averaged
MAX_GROUP_TIME_FRACTION = 0.2  # of the time to the nearest event: sqrt(t) is then near enough to a parabola, to 1e-4


def average_frames(campaign: Campaign) -> Campaign:
    """The campaign with means of neighbouring frames if its recordings have more than MAX_UNAVERAGED_PIXELS pixels.

    The temperature rise after an event grows with the root of the time since, so a parabola gives the mean over a small
    fraction of that time (`AveragedFrames`).  White noise decreases with the root of the number of frames.
    """
    if sum(v.recording.temperature.size for v in campaign.views) <= MAX_UNAVERAGED_PIXELS:
        return campaign
    return replace(campaign, views=tuple(_average_view(v, campaign.load(v.given)) for v in campaign.views))


def _average_view(view: RecordingEntry, case: Case) -> RecordingEntry:
    r = view.recording
    begins = np.array([p.begin for p in case.scene.schedule.phases])
    groups = group_frames(r.time, r.repetition, begins, case.scene.schedule.end_time)
    starts = sorted({*groups, *r.frames_after_frozen})  # no mean reaches over a shutter event
    counts = np.diff([*starts, r.frames])
    means = np.stack([r.temperature[i : i + n].mean(axis=0) for i, n in zip(starts, counts, strict=True)])
    time = np.add.reduceat(r.time, starts) / counts
    spread = np.sqrt(np.add.reduceat((r.time - np.repeat(time, counts)) ** 2, starts) / counts)
    part = np.searchsorted(begins, time, side="right")
    short = replace(r, temperature=means, time=time, repetition=r.repetition[starts])
    over = AveragedFrames(tuple(map(int, counts)), tuple(map(float, spread)), tuple(map(int, part)))
    return replace(view, recording=short, means=over)


def group_frames(
    time: npt.NDArray[np.float64], repetition: npt.NDArray[np.int_], begins: npt.NDArray[np.float64], end: float
) -> list[int]:
    """First frames of groups that last no longer than MAX_GROUP_TIME_FRACTION of the time to the nearest event.

    `time` (frames,) s in order, `repetition` (frames,); events at `begins` and the `end`, s.

    >>> group_frames(np.array([0.0, 1.0, 10.0, 10.2, 10.4, 19.9, 20.0]), np.ones(7, int), np.array([0.0]), 20.0)
    [0, 1, 2, 5, 6]
    """
    events = np.append(begins, end)
    after = np.searchsorted(events, time, side="right")
    last = np.where(after > 0, events[np.maximum(after - 1, 0)], np.inf)
    coming = np.where(after < len(events), events[np.minimum(after, len(events) - 1)], -np.inf)
    starts = [0]
    for k in range(1, len(time)):
        first = starts[-1]
        near = min(time[first] - last[first], coming[k] - time[k])
        if (
            after[k] != after[first]
            or repetition[k] != repetition[first]
            or time[k] - time[first] > MAX_GROUP_TIME_FRACTION * near
        ):
            starts.append(k)
    return starts
