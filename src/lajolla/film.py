"""Output settings of a film: channels, number formats and tone mapping."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lajolla.colour import FloatImage, luminance, rgb_to_xyz

# The channels of a picture, by the names that Mitsuba gives to pixel formats.
PIXEL_FORMATS = {
    "rgb": "RGB",
    "rgba": "RGBA",
    "luminance": "Y",
    "luminance_alpha": "YA",
    "xyz": "XYZ",
    "xyza": "XYZA",
}
COMPONENT_FORMATS = {"float16": "half", "float32": "float", "uint32": "uint"}
# The endings of the files that a render writes when none is named.
FILE_FORMATS = {
    "openexr": (".exr", ".png"),
    "rgbe": (".hdr", ".png"),
    "pfm": (".pfm", ".png"),
    "png": (".exr", ".png"),
    "jpeg": (".exr", ".jpg"),
    "matlab": (".m", ".png"),
    "mathematica": (".m", ".png"),
    "numpy": (".npy", ".png"),
}


@dataclass(frozen=True)
class Film:
    """Output settings of a scene's film; the core holds its size.

    `gamma` of -1 is sRGB's curve. `exposure` in stops is for "gamma" tone mapping, `key` and `burn` are for
    "reinhard". `digits` and `variable` are those of matrices for Matlab and Mathematica.
    """

    pixel_format: str = "rgb"
    component_format: str = "float32"
    file_format: str = "openexr"
    tonemap_method: str = "gamma"
    gamma: float = -1.0
    exposure: float = 0.0
    key: float = 0.18
    burn: float = 0.0
    digits: int = 4
    variable: str = "data"

    @property
    def names(self) -> tuple[str, ...]:
        """The picture's channels."""
        return tuple(PIXEL_FORMATS[self.pixel_format])

    @property
    def has_alpha(self) -> bool:
        """Whether alpha is rendered."""
        return "A" in self.names

    def with_alpha(self) -> "Film":
        """The same with an alpha channel."""
        names = "".join(self.names).removesuffix("A") + "A"
        return replace(self, pixel_format=next(f for f, known in PIXEL_FORMATS.items() if known == names))

    @property
    def endings(self) -> tuple[str, ...]:
        """Endings of the files that are written by default."""
        return FILE_FORMATS[self.file_format]

    def develop(
        self, rgb: FloatImage, channels: Mapping[str, FloatImage], pixel_format: str | None = None
    ) -> FloatImage:
        """The picture in the film's pixel format, or another: (height, width, number of its channels)."""
        names = PIXEL_FORMATS[pixel_format or self.pixel_format]
        colour = luminance(rgb) if "Y" in names else rgb
        if "X" in names:
            colour = rgb_to_xyz(rgb)
        if "A" not in names:
            return colour
        alpha = channels.get("A", np.ones(rgb.shape[:2], np.float32))
        return np.concatenate([colour, alpha[..., None]], axis=2)

    def tone_map(self, rgb: FloatImage) -> FloatImage:
        """Linear values for a display, before its transfer curve, as Mitsuba 0.6 computes them."""
        if self.tonemap_method == "reinhard":
            return reinhard(rgb, self.key, self.burn)
        with np.errstate(over="ignore"):
            return rgb * np.float32(2.0**self.exposure)


def reinhard(rgb: FloatImage, key: float, burn: float) -> FloatImage:
    """The global operator of Reinhard et al. 2002, "Photographic Tone Reproduction for Digital Images".

    The luminance L becomes s (1 + s/w^2) / (1 + s) of s = key L / (log-average of L), equations 1 to 4; the
    white point w is the largest s times (1 - burn)^2, which is the `burn` of Mitsuba 0.6.
    """
    light = np.where(np.isfinite(rgb).all(axis=2, keepdims=True), luminance(rgb), 0).astype(np.float64)
    if not light.max() > 0:
        return rgb
    scale = key / np.exp(np.mean(np.log(np.maximum(1e-3 + light, 1e-6))))
    white = light.max() * scale * np.clip(1 - burn, 1e-8, 1) ** 2
    scaled = np.maximum(light * scale, 0)
    factor = scale * (1 + scaled / white**2) / (1 + scaled)
    return (rgb * factor).astype(np.float32)


def matrix_text(pixels: FloatImage, film: Film) -> str:
    """A picture (height, width, channels) as an assignment in the language of Matlab or Mathematica."""
    layers = [
        [[f"{value:.{film.digits}g}" for value in row] for row in pixels[..., channel]]
        for channel in range(pixels.shape[2])
    ]
    return (_mathematica if film.file_format == "mathematica" else _matlab)(layers, film.variable)


def _matlab(layers: list[list[list[str]]], variable: str) -> str:
    texts = [";\n\t".join(", ".join(row) for row in layer) for layer in layers]
    targets = [variable, *(f"{variable}(:, :, {index})" for index in range(2, len(layers) + 1))]
    return "\n".join(f"{target} = [{text}];\n" for target, text in zip(targets, texts, strict=True))


def _mathematica(layers: list[list[list[str]]], variable: str) -> str:
    def braces(items: Any) -> str:  # noqa: ANN401
        return (
            items.replace("e", "*^") if isinstance(items, str) else "{" + ", ".join(map(braces, items)) + "}"
        )

    if len(layers) == 1:
        return f"{variable} = {braces(layers[0])};\n"
    return f"{variable} = Transpose[{braces(layers)}, {{3, 1, 2}}];\n"
