"""The same loss for JAX, jitted with the algorithm: single precision, a population at once.

The radius at which a distortion stops growing is found once per individual, as ours is; on a grid of 64 steps halved
ten times, because a search that takes its own course for each individual is no work for JAX.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from workers.geometry.models import ModelName
from workers.geometry.projections.perspective import NEAREST_DEPTH_M

jax.config.update("jax_platforms", "cpu")


def losses_of(model: ModelName) -> Callable[[Any, Any, Any], Any]:
    """f(individuals (P, F), pack (6, M), numbers): losses (P,) in px, with pack and numbers of a `Contest`."""
    camera = {"pinhole": _pinhole, "brown_conrady": _brown_conrady, "kannala_brandt": _kannala_brandt}[model]

    def losses(individuals: Any, pack: Any, numbers: Any) -> Any:
        genes = individuals.shape[1]
        p = (numbers[2 : 2 + genes] + numbers[2 + genes :] * individuals).T[:, :, None]
        points = pack[None, :3, :]
        x, y, z = _turned(p[:3], points)
        u, v, violation = camera(p[6:], x + p[3], y + p[4], z + p[5])
        d = jnp.hypot(u - pack[3], v - pack[4])
        d = jnp.where(violation > 0.0, numbers[0] * (1.0 + violation), d)
        return jnp.nan_to_num(d @ pack[5] * numbers[1], nan=3e38)

    return losses


def _turned(w: Any, points: Any) -> tuple[Any, Any, Any]:
    # Rodrigues' formula; w (3, P, 1), points (1, 3, M).
    x, y, z = points[:, 0], points[:, 1], points[:, 2]
    angle = jnp.sqrt(w[0] ** 2 + w[1] ** 2 + w[2] ** 2 + 1e-20)
    a, b, c = w[0] / angle, w[1] / angle, w[2] / angle
    sine, cosine = jnp.sin(angle), jnp.cos(angle)
    along = (a * x + b * y + c * z) * (1.0 - cosine)
    return (
        x * cosine + (b * z - c * y) * sine + a * along,
        y * cosine + (c * x - a * z) * sine + b * along,
        z * cosine + (a * y - b * x) * sine + c * along,
    )


def _behind(z: Any) -> Any:
    gap = NEAREST_DEPTH_M - z
    return jnp.where(gap > 0.0, 1.0 + gap / (1.0 + gap), 0.0)


def _pinhole(k: Any, x: Any, y: Any, z: Any) -> tuple[Any, Any, Any]:
    depth = jnp.maximum(z, NEAREST_DEPTH_M)
    return k[0] * (x / depth) + k[2], k[1] * (y / depth) + k[3], _behind(z)


def _brown_conrady(k: Any, x: Any, y: Any, z: Any) -> tuple[Any, Any, Any]:
    depth = jnp.maximum(z, NEAREST_DEPTH_M)
    a, b = x / depth, y / depth
    skew, k1, k2, k3, k4, k5 = k[4], k[5], k[6], k[7], k[8], k[9]
    r2 = a * a + b * b
    grow = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k5))
    a_d = a * grow + 2.0 * k3 * a * b + k4 * (r2 + 2.0 * a * a)
    b_d = b * grow + k3 * (r2 + 2.0 * b * b) + 2.0 * k4 * a * b
    x_fold = _first_zero((3.0 * k1 - 3.0, 3.0 - 6.0 * k1 + 5.0 * k2, 3.0 * k1 - 5.0 * k2 + 7.0 * k5 - 1.0))
    past = r2 - jnp.where(x_fold < 1.0, x_fold / (1.0 - x_fold), jnp.inf)
    violation = jnp.where(z < NEAREST_DEPTH_M, _behind(z), jnp.maximum(past, 0.0) / (1.0 + r2))
    return k[0] * (a_d + skew * b_d) + k[2], k[1] * b_d + k[3], violation


def _kannala_brandt(k: Any, x: Any, y: Any, z: Any) -> tuple[Any, Any, Any]:
    r = jnp.sqrt(x * x + y * y)
    theta = jnp.arctan2(r, z)
    t2 = theta * theta
    k1, k2, k3, k4 = k[4], k[5], k[6], k[7]
    bent = theta * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
    scale = bent / jnp.maximum(r, 1e-12)
    square = jnp.pi**2
    x_fold = _first_zero((3.0 * k1 * square, 5.0 * k2 * square**2, 7.0 * k3 * square**3, 9.0 * k4 * square**4))
    past = theta - jnp.pi * jnp.sqrt(jnp.minimum(x_fold, 1.0))
    return k[0] * (x * scale) + k[2], k[1] * (y * scale) + k[3], jnp.maximum(past, 0.0)


def _first_zero(p: tuple[Any, ...]) -> Any:
    # The least x in (0, 1] at which 1 + p1 x + p2 x^2 + .. is no longer positive, 1 if none; each p (P, 1).
    def g(x: Any) -> Any:
        total = jnp.zeros_like(x)
        for coefficient in reversed(p):
            total = (total + coefficient) * x
        return 1.0 + total

    grid = jnp.arange(1, 65, dtype=jnp.float32)[None, :] / 64.0
    gone = g(grid) <= 0.0
    high = jnp.where(gone.any(axis=1, keepdims=True), (jnp.argmax(gone, axis=1, keepdims=True) + 1.0) / 64.0, 2.0)
    low = high - 1.0 / 64.0
    for _ in range(10):
        middle = 0.5 * (low + high)
        below = g(middle) <= 0.0
        low, high = jnp.where(below, low, middle), jnp.where(below, middle, high)
    return jnp.minimum(0.5 * (low + high), 1.0)
