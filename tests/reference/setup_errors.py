"""Mistakes of a measurement set-up: what the case or a recording states is not what was tested."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class SetupErrors:
    """One mistake of the setup, far beyond the usual `MeasurementErrors`: the case states one thing, the test was another.

    `load`, `speed` and `density` are ratios of the real value to the stated one; the load cell measures both forces.
    What concerns images is made in `recordings` (file names), or in every side wall where these are None.
    """

    length: float = 0.0  # m that the block is longer than stated
    load: float = 1.0
    speed: float = 1.0
    density: float = 1.0  # of the rubber
    larger: float | None = None  # pixel, relative; like the next three, it replaces what the usual errors draw
    turned: float | None = None  # rad
    mirrored: bool | None = None
    fixed: tuple[float, float] | None = None  # shares of the image: the point about which it turns and grows
    clock: float = 0.0  # s that the time stamps are late
    emissivity: float = 0.0  # stated value less the real one
    recordings: tuple[str, ...] | None = None
    exchanged: tuple[str, ...] = ()  # two recordings, each of which bears the name of the other

    def is_affected(self, file):
        """Whether errors of images are made in a recording."""
        return "_sidewall" in file if self.recordings is None else file in self.recordings

    def place_image(self, geometry):
        """The geometry of an image with the errors of this setup in place of its own."""
        own = {k: getattr(self, k) for k in ("larger", "turned", "mirrored", "fixed")}
        return replace(geometry, **{k: v for k, v in own.items() if v is not None})

    def exchange_recordings(self, folder):
        """Rename the two recordings that are exchanged."""
        if self.exchanged:
            first, second = (folder / name for name in self.exchanged)
            aside = first.rename(folder / "exchanged.nc")
            second.rename(first)
            aside.rename(second)
