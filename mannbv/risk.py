"""Risk of collision: value-at-risk, average value-at-risk, and the field over a map, Eqs. (6)-(9).

α is a distance in metres: smaller means more dangerous, negative means that the bad outcomes lie beyond contact.
"""

import dataclasses
import math
from collections.abc import Callable
from typing import NamedTuple, TypeVar

import numpy as np
import torch
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike
from scipy.special import erfcx, ndtri
from torch import Tensor

from mannbv.config import Config
from mannbv.kernels import field as kernel
from mannbv.splats import SplatMap

_DEFAULT = Config()
Amount = TypeVar("Amount", float, np.ndarray, Tensor)


def _check(level: float) -> None:
    if not 0 < float(level) < 1:
        raise ValueError(f"risk: level must lie strictly between 0 and 1, got {level}")


def value_at_risk(mean: Amount, std: Amount | float, level: float) -> Amount:
    """The distance [m] that a Gaussian distance undercuts with probability `level`, Eq. (7).

        V@R = mean + std · √2 · ι,    ι = erf⁻¹(2·level − 1)

    mean, std: numbers, arrays or tensors [m]. Raises ValueError unless 0 < level < 1. √2 ι is the normal distribution's
    quantile; taken as such it is exact for the smallest levels too, where 2·level − 1 rounds to −1.
    """
    _check(level)
    return mean + std * float(ndtri(float(level)))


def average_value_at_risk(mean: Amount, std: Amount | float, level: float) -> Amount:
    """Mean of the worst `level` fraction of a Gaussian distance [m], Eqs. (6), (8).

        AV@R = mean − std · exp(−ι²) / (level · √(2π)),    ι = erf⁻¹(2·level − 1)

    mean, std: numbers, arrays or tensors [m]. Raises ValueError unless 0 < level < 1. With level = erfc(−ι)/2 the
    fraction is √(2/π) / (exp(ι²) erfc(−ι)), in which nothing small is left.
    """
    _check(level)
    iota = float(ndtri(float(level))) / math.sqrt(2)
    return mean - std * (math.sqrt(2 / math.pi) / float(erfcx(-iota)))


def sampled(samples: ArrayLike, level: float) -> tuple[float, float]:
    """V@R and AV@R [m] of samples (k,) [m] of any distance: the worst `level` share, and its mean."""
    _check(level)
    ordered = np.sort(np.asarray(samples, float).ravel())
    if not len(ordered) or np.isnan(ordered).any():
        raise ValueError("risk: needs at least one sample, none of them NaN")
    count = max(1, math.ceil(level * len(ordered) - 1e-9))
    return float(ordered[count - 1]), float(ordered[:count].mean())


class Measure(NamedTuple):
    """A risk measure (mean, std, level) → risk; `linear`: it is mean + std · c(level), which allows fast fields."""

    function: Callable[..., Tensor]
    linear: bool


MEASURES = {
    "avar": Measure(average_value_at_risk, linear=True),
    "var": Measure(value_at_risk, linear=True),
    "mean": Measure(lambda mean, std, level: mean + 0 * std, linear=True),
}
_OURS = frozenset(MEASURES)


def register(name: str, function: Callable, linear: bool = False) -> None:
    """Add a risk measure under a name that `Config.measure` and `field` then understand.

    function(mean, std, level) → risk takes tensors of distances and standard deviations [m]; smaller is riskier.
    Raises ValueError for one of our own names.
    """
    if name in _OURS:
        raise ValueError(f"risk: '{name}' is one of our own measures; choose another name")
    MEASURES[name] = Measure(function, linear)


def field(
    splat_map: SplatMap,
    points: ArrayLike,
    level: float = _DEFAULT.level,
    measure: str = "avar",
    spread: str = "largest",
    posterior: Float[Tensor, "n d"] | None = None,
) -> Float[Tensor, " k"]:
    """α at points (k, d) [m], Eq. (9): exactly the smallest risk over all splats; +inf on an empty map.

    measure: a name in `MEASURES`. spread: σ of an anisotropic splat is its "largest" standard deviation, or that
    "along" the line of sight n, √(nᵀ Σ n). posterior (n, d): the variances of each splat's mean [m²], by
    `information.mean_variances`; they widen σ² by nᵀ P n, P = diag(posterior), for a splat may also stand elsewhere.
    Raises ValueError for an unknown name, a level outside (0, 1), or variances that are negative or none of this map's.
    """
    _check(level)
    if measure not in MEASURES:
        raise ValueError(f"risk: no measure '{measure}'; known: {', '.join(MEASURES)}")
    if spread not in ("largest", "along"):
        raise ValueError(f"risk: spread must be 'largest' or 'along', got '{spread}'")
    places = torch.as_tensor(points)
    if places.ndim != 2 or places.shape[1] != splat_map.dim:
        raise ValueError(f"risk: points must be (k, {splat_map.dim}) beside this map, got {tuple(places.shape)}")
    if posterior is not None and posterior.shape != splat_map.means.shape:
        shapes = f"{tuple(splat_map.means.shape)} beside this map, got {tuple(posterior.shape)}"
        raise ValueError(f"risk: posterior must be {shapes}")
    if not (splat_map.n_splats and len(places)):
        return torch.full((len(places),), math.inf).to(splat_map.means)
    inputs = (places, splat_map.means, splat_map.log_scales, *(() if posterior is None else (posterior,)))
    if not all(bool(torch.isfinite(t).all()) for t in inputs):
        raise ValueError("risk: splats, points and posterior must be finite")
    if posterior is not None and bool((posterior < 0).any()):
        raise ValueError(f"risk: a variance of a mean must not be negative, got {posterior.min():g}")
    rule = MEASURES[measure]
    if rule.linear and spread == "largest" and not any(t.requires_grad for t in inputs):
        return _linear(splat_map, places, -float(rule.function(0.0, 1.0, level)), posterior)
    rows = max(1, 2_000_000 // splat_map.n_splats)  # bounds the memory of a chunk
    return torch.cat([_every_splat(splat_map, part, level, rule, spread, posterior) for part in places.split(rows)])


def _every_splat(splat_map: SplatMap, points: Tensor, level, rule: Measure, spread: str, posterior) -> Tensor:
    away = points[:, None].to(splat_map.means) - splat_map.means
    distance = torch.linalg.norm(away, dim=-1)
    std = splat_map.scales.amax(1).expand_as(distance)
    if spread == "along" or posterior is not None:
        covariance = splat_map.covariances() if spread == "along" else torch.zeros_like(splat_map.covariances())
        covariance = covariance if posterior is None else covariance + torch.diag_embed(posterior.to(covariance))
        alike = 0 if spread == "along" else std**2  # what is the same in every direction
        sight = away / distance.clamp_min(kernel.ON)[..., None]
        along = torch.einsum("kni,nij,knj->kn", sight, covariance, sight)
        worst = torch.linalg.eigvalsh(covariance)[:, -1]  # on a mean every line of sight is one
        std = (alike + torch.where(distance > kernel.ON, along, worst)).clamp_min(1e-24).sqrt()
    return rule.function(distance, std, level).amin(1)


def _linear(splat_map: SplatMap, points: Tensor, factor: float, posterior: Tensor | None) -> Tensor:
    """min (distance − factor · σ), box by box of splats: exact, and far fewer than k · n distances."""
    wide = torch.zeros(0, splat_map.dim) if posterior is None else posterior
    tensors = points, splat_map.means, splat_map.scales.amax(1), wide
    where, means, std, wide = (np.ascontiguousarray(t.detach().double().numpy(force=True)) for t in tensors)
    if not np.isfinite(std).all():  # a finite log-scale may be too large for its exponential
        raise ValueError("risk: splats and points must be finite")
    order = kernel.ordered(means) if len(where) > 256 else np.arange(len(means))  # sorting pays for many points
    risk = kernel.lowest(means[order], std[order], wide[order] if len(wide) else wide, factor, where)
    return torch.from_numpy(risk).to(splat_map.means)


def in_reach(splat_map: SplatMap, height: ArrayLike, config: Config) -> Bool[Tensor, " n"]:
    """Which splats (n,) count for the risk of a robot whose camera is at `height` (d − 2,) [m], [] in flatland.

    Those opaque enough (`risk_opacity`) and, in 3-D, between `body_low` and `body_high` above the floor; without that
    cut the floor alone would make every place look dangerous.
    """
    floor = torch.as_tensor(height).to(splat_map.means) - config.camera_height
    above = splat_map.means[:, 2:] - floor
    standing = ((above >= config.body_low) & (above <= config.body_high)).all(1)
    return standing & (splat_map.opacities >= config.risk_opacity)


def along(
    splat_map: SplatMap,
    points: ArrayLike,
    config: Config,
    posterior: Float[Tensor, "n d"] | None = None,
    spread: str | None = None,
) -> Float[Tensor, " k"]:
    """α of a robot's waypoints (k, d) [m], all at the height of its camera, by the constants of `config`: `field` over
    the splats `in_reach`; posterior and spread: as there; None: the config's spread.

    In 3-D a robot is as tall as it is: a splat beside its body is as far away as the two are horizontally. With
    `risk_from` "camera" the distance is the paper's ‖μ − p‖, slantwise from the camera to low things.
    """
    places, spread = torch.as_tensor(points), spread or config.spread
    if not len(places):
        return field(splat_map, places, config.level, config.measure, spread)
    near = in_reach(splat_map, places[0, 2:], config)
    if not bool(near.all()):
        splat_map, posterior = splat_map.select(near), None if posterior is None else posterior[near]
    if config.risk_from == "body":
        height = places[:1, 2:].to(splat_map.means).expand(splat_map.n_splats, -1)
        splat_map = dataclasses.replace(splat_map, means=torch.cat([splat_map.means[:, :2], height], 1))
    return field(splat_map, places, config.level, config.measure, spread, posterior)


def total(
    splat_map: SplatMap, path: Float[Tensor, "k d"], level: float = _DEFAULT.level, measure: str = "avar"
) -> float:
    """Mean risk of a path's waypoints (k, d) [m] over all splats, Section VI-C; higher is safer. In 3-D see `along`."""
    return field(splat_map, path, level, measure).mean().item()
