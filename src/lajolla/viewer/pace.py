"""How large previews may be, by the measured speed of the renderer."""

from __future__ import annotations

from collections.abc import Iterator

FIRST_SECONDS = 0.025  # that the first picture of a view may take
DIRECT_SECONDS = 0.2  # a picture with all pixels that takes less needs no previews between
FIRST_DIVISOR = 8  # of previews whose speed is unknown
MOST_DIVISOR = 32
SMALL = 64 * 64  # pixels of pictures that need no preview


class Pace:
    """The speeds of the layers that were rendered so far, in samples per second."""

    def __init__(self) -> None:
        self.speeds: dict[str, float] = {}

    def measure(self, layer: str, samples: float, seconds: float) -> None:
        """Notes a speed; a slower one counts at once, a faster one half."""
        speed = samples / max(seconds, 1e-6)
        before = self.speeds.get(layer, speed)
        self.speeds[layer] = min(speed, 0.5 * (before + speed))

    def divisors(self, layer: str, pixels: int) -> Iterator[int]:
        """By what the sides of a picture are divided in its previews, one after the other.

        The first preview takes FIRST_SECONDS at most, if a small enough one does, and each further one has 16
        times as many pixels. The speeds may be measured meanwhile.
        """
        if pixels <= SMALL:
            return
        divisor = FIRST_DIVISOR
        if layer in self.speeds:
            divisor = 1
            while divisor < MOST_DIVISOR and pixels / divisor**2 > self.speeds[layer] * FIRST_SECONDS:
                divisor *= 2
        if divisor > 1:
            yield divisor
        while divisor > 4 and pixels > self.speeds[layer] * DIRECT_SECONDS:
            divisor //= 4
            yield divisor
