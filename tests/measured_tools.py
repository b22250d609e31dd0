"""Materials as a goniophotometer would see them, and files of them.

They are rough metals (GGX) sampled at few directions, with a colour that varies over the square in which
measurements are stored, so that every table matters.
"""

from __future__ import annotations

import struct
from functools import cache
from pathlib import Path

import numpy as np

from lajolla import _core
from lajolla.scene.description.plugins.measured import measurement

Tensors = dict[str, np.ndarray]
TYPES = {np.dtype(np.uint8): 1, np.dtype(np.float32): 10, np.dtype(np.float64): 11}
ALL_ROUND = {1: (-np.pi, np.pi), 2: (-np.pi, 0), 4: (-np.pi, -np.pi / 2)}


def directions(theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
    return np.stack(
        np.broadcast_arrays(np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)), axis=-1
    )


def square(width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
    """Elevation and azimuth of the nodes of a table (height, width)."""
    return np.meshgrid(np.linspace(0, 1, width) ** 2 * np.pi / 2, np.linspace(-np.pi, np.pi, height))


def facets(m: np.ndarray, alpha: tuple[float, float]) -> np.ndarray:
    slope2 = (m[..., 0] / alpha[0]) ** 2 + (m[..., 1] / alpha[1]) ** 2
    return 1 / (np.pi * alpha[0] * alpha[1] * (slope2 + m[..., 2] ** 2) ** 2)


@cache
def synthetic(fold: int = 0, jacobian: bool = True, channels: int = 3, size: int = 24) -> Tensors:
    """The tensors of a file: isotropic (fold 0), or with azimuths all round, half (2) or a quarter (4)."""
    alpha = (0.4, 0.25) if fold else (0.3, 0.3)
    phi = np.linspace(*ALL_ROUND[fold], 7 if fold == 1 else 4) if fold else np.zeros(1)
    theta = np.linspace(0, 1.5, 5)
    fine_theta, fine_phi = square(128, 128)
    fine = directions(fine_theta, fine_phi)
    weight = facets(fine, alpha) * np.sin(fine_theta) * np.linspace(0, 1, 128) * 2 * np.pi**2 / 127**2
    sigma_at = directions(*square(size, size)).reshape(-1, 3)
    sigma = [(weight[1:] * np.maximum(fine[1:] @ w, 0)).sum() for w in sigma_at]
    m_theta, m_phi = square(size, size + 3)
    m = directions(m_theta, m_phi)
    known = directions(*np.meshgrid(theta, phi))[..., None, None, :]
    area = facets(m, alpha) * np.sin(m_theta) * np.linspace(0, 1, size)
    x, y = np.meshgrid(np.linspace(0, 1, size - 5), np.linspace(0, 1, size - 5))
    level = 1 if jacobian else 0.12
    colours = [
        level * (0.55 + 0.2 * np.cos(3 * x + c) * np.cos(2 * np.pi * y) + 0.05 * c / channels)
        for c in range(channels)
    ]
    tilt = np.cos(np.add.outer(phi, theta))[:, :, None, None]
    tensors = {
        "theta_i": theta,
        "phi_i": phi,
        "ndf": facets(m, alpha),
        "sigma": np.reshape(sigma, (size, size)),
        "vndf": area * np.maximum((known * m).sum(-1), 0),
        "luminance": 1 + 0.5 * x * tilt + 0.2 * np.sin(2 * np.pi * y),
        "rgb" if channels == 3 else "spectra": np.array(colours) * (1 + 0.1 * tilt[..., None]),
    }
    tensors = {name: np.ascontiguousarray(value, np.float32) for name, value in tensors.items()}
    if channels != 3:
        tensors["wavelengths"] = np.linspace(360, 830, channels, dtype=np.float32)
    text = np.frombuffer(b"synthetic", np.uint8)
    return {**tensors, "description": text, "jacobian": np.array([jacobian], np.uint8)}


def tensor_bytes(tensors: Tensors) -> bytes:
    """The bytes of a tensor file."""
    head, data = bytearray(b"tensor_file\0\1\0" + struct.pack("<I", len(tensors))), bytearray()
    start = len(head) + sum(2 + len(name) + 11 + 8 * value.ndim for name, value in tensors.items())
    for name, value in tensors.items():
        head += struct.pack("<H", len(name)) + name.encode()
        head += struct.pack("<HBQ", value.ndim, TYPES[value.dtype], start + len(data))
        head += struct.pack(f"<{value.ndim}Q", *value.shape)
        data += value.tobytes()
        data += bytes(-(start + len(data)) % 8)
    return bytes(head + data)


def write_tensors(path: Path, tensors: Tensors) -> Path:
    path.write_bytes(tensor_bytes(tensors))
    return path


MEASUREMENTS = {
    "isotropic": _core.Measurement(**measurement(synthetic())),
    "all round": _core.Measurement(**measurement(synthetic(1))),
    "half": _core.Measurement(**measurement(synthetic(2, jacobian=False))),
    "quarter": _core.Measurement(**measurement(synthetic(4))),
}
