"""Computes which objects a picture shows: ids and Cryptomattes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lajolla import _core
from lajolla.aovs import AOVS, IDS, PRIMITIVE, RANKS, is_matte
from lajolla.colour import FloatImage
from lajolla.layers import NO_LAYERS, Cryptomatte, IdImage, Ids, Layer
from lajolla.scene import Numbered, Objects, numbered

MOST_COUNTED = 256  # samples per pixel that a Cryptomatte counts
BAND = 1 << 21  # samples after which Python looks for signals


@dataclass
class ObjectLayers:
    """Computes the layers of a scene that `aovs` name, for a render with this seed."""

    core: _core.Scene
    aovs: Sequence[str]
    objects: Objects  # and the description that they are the objects of
    description: Mapping[str, Any]
    seed: int
    first_sample: int
    threads: int
    _counted: tuple[int, Mapping[str, Layer]] = (0, NO_LAYERS)

    def layers(self, samples: int) -> dict[str, Layer]:
        """The layers after so many samples of the pixel that has most."""
        kinds = dict.fromkeys(AOVS[aov].kind for aov in self.aovs if AOVS[aov].kind)
        known = {kind: numbered(self.objects, self.description, f"{kind}s") for kind in kinds}
        found = {**self._ids(known), **self._mattes(known, min(samples, MOST_COUNTED))}
        return {aov: found[aov] for aov in self.aovs if aov in found}

    def _ids(self, known: Mapping[str, Numbered]) -> dict[str, Layer]:
        wanted = [aov for aov in self.aovs if aov in IDS]
        if not wanted:
            return {}
        found = _core.ids_at_centres(self.core, self.threads)
        result: dict[str, Layer] = {}
        for aov in wanted:
            values = np.ascontiguousarray(found[..., IDS.index(aov)])
            if aov == PRIMITIVE:
                result[aov] = Ids(values)
            else:
                result[aov] = Ids(known[aov].of(values), known[aov].names)
        return result

    def _mattes(self, known: Mapping[str, Numbered], samples: int) -> Mapping[str, Layer]:
        wanted = [aov for aov in self.aovs if is_matte(aov)]
        if not wanted or samples == 0:
            return {}
        if self._counted[0] != samples:
            objects = [known[AOVS[aov].kind] for aov in wanted]
            kinds = [(AOVS[aov].kind, one.numbers) for aov, one in zip(wanted, objects, strict=True)]
            found = self._count(kinds, samples)
            mattes = {
                aov: Cryptomatte(numbers, coverage, one.names)
                for aov, one, (numbers, coverage) in zip(wanted, objects, found, strict=True)
            }
            self._counted = samples, mattes
        return self._counted[1]

    def _count(self, kinds: list[tuple[str, IdImage]], samples: int) -> list[tuple[IdImage, FloatImage]]:
        """The ranked numbers and coverages of each kind, computed in bands of rows."""
        height, width = self.core.height, self.core.width
        rows = max(1, BAND // (width * samples * 16)) * 16
        bands = [
            _core.object_coverage(
                self.core,
                kinds,
                self.seed,
                self.first_sample,
                samples,
                RANKS,
                first,
                min(first + rows, height),
                self.threads,
            )
            for first in range(0, height, rows)
        ]
        return [
            (np.concatenate([band[i][0] for band in bands]), np.concatenate([band[i][1] for band in bands]))
            for i in range(len(kinds))
        ]
