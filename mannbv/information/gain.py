"""From information to gain, Eqs. (5), (14), (15), and how a gain changes with the view."""

from typing import TypedDict, Unpack

import torch
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike
from torch import Tensor

from mannbv import geometry
from mannbv.camera import Camera
from mannbv.config import Config, Noise
from mannbv.geometry import Pose
from mannbv.information.fisher import blocks, fisher, n_parameters
from mannbv.splats import SplatMap

_DEFAULT = Config()


class Options(TypedDict, total=False):
    """What `gain` is given beside the information."""

    weights: Tensor | None
    selected: Tensor | None
    damping: ArrayLike | None
    weigh_prior: bool
    literal_views: int | None


def damping(dim: int, config: Config = _DEFAULT) -> Float[Tensor, " p"]:
    """λ per parameter: what is known of it before any view, 1 / std² in the parameter's own units."""
    groups = [config.damping_mean] * dim + [config.damping_scale] * dim
    groups += [config.damping_rotation] * (dim * (dim - 1) // 2) + [config.damping_opacity]
    return torch.tensor(groups + [config.damping_color] * 3)


def default_damping(prior: Tensor) -> Float[Tensor, " p"]:
    """`damping` for the dimension whose parameters are the columns of `prior` (n, p)."""
    return damping(_dim_of(prior))


def _dim_of(prior: Tensor) -> int:
    dims = {n_parameters(dim): dim for dim in (2, 3)}
    if prior.shape[1] not in dims:
        raise ValueError(f"gain: the prior has {prior.shape[1]} columns, not 9 (flatland) or 13; give a damping for it")
    return dims[prior.shape[1]]


def worth_of(
    prior: Tensor,
    weights: ArrayLike | None,
    selected: ArrayLike | None,
    damping: ArrayLike | None,
    weigh_prior: bool = False,
    literal_views: int | None = None,
) -> Tensor:
    """v / (H + λ) for every parameter (n, p), zero outside the selection; arguments as in `gain`."""
    damping = torch.as_tensor(default_damping(prior) if damping is None else damping).to(prior)
    prior, weights = _literal(prior, weights, damping, weigh_prior, literal_views)
    value = _value_of(prior, weights, selected)
    denominator = prior + damping
    if not bool((denominator > 0).all()):
        raise ValueError("gain: prior + damping must be positive; give a damping above 0 for splats never seen")
    return value[:, None] / denominator


def _literal(
    prior: Tensor, weights: ArrayLike | None, damping: Tensor, weigh_prior: bool, literal_views: int | None
) -> tuple[Tensor, ArrayLike | None]:
    """Prior and weights as the paper's literal forms have them, where `gain` is asked for those."""
    if literal_views is not None:
        prior = prior + (literal_views - 1) * damping
    if weigh_prior and weights is not None:
        weights = (torch.as_tensor(weights) > 0).to(prior)  # v / v
    return prior, weights


def _value_of(prior: Tensor, weights: ArrayLike | None, selected: ArrayLike | None) -> Tensor:
    """v of every splat (n,), zero outside the selection."""
    value = torch.ones(len(prior)).to(prior) if weights is None else torch.as_tensor(weights).to(prior)
    _check_rows("weights", value, prior)
    if bool((value < 0).any()):
        raise ValueError(f"gain: weights must not be negative, got {value.min():g}")
    if selected is None:
        return value
    selected = torch.as_tensor(selected, device=prior.device)
    _check_rows("selected", selected, prior)
    if selected.dtype != torch.bool and len(selected):
        raise ValueError(f"gain: selected must say True or False of each splat, got {selected.dtype}")
    return torch.where(selected.bool(), value, 0.0)


def _check_rows(name: str, values: Tensor, prior: Tensor) -> None:
    if values.shape != prior.shape[:1]:
        raise ValueError(f"gain: {name} must be ({len(prior)},), one a splat, got {tuple(values.shape)}")


def _traces(acquired: Tensor, prior: Tensor, damping: Tensor) -> Tensor:
    """tr(h (H + Λ)⁻¹) of each splat's blocks (n, p, p), in float64: blocks of few views are all but singular."""
    factor = _factor(prior, damping)
    half = torch.linalg.solve_triangular(factor, acquired.double(), upper=False)
    whole = torch.linalg.solve_triangular(factor, half.transpose(1, 2), upper=False)
    return torch.diagonal(whole, dim1=1, dim2=2).sum(1).to(prior)


def _factor(prior: Tensor, damping: Tensor) -> Tensor:
    """Cholesky's factor of H + Λ (n, p, p), in float64.

    What rounding may have taken from H is given back to its diagonal, so that it stays positive.
    """
    slack = prior.shape[-1] * torch.finfo(prior.dtype).eps * torch.diagonal(prior, dim1=1, dim2=2)
    factor, faults = torch.linalg.cholesky_ex(prior.double() + damping.double() + torch.diag_embed(slack.double()))
    if bool(faults.any()):
        raise ValueError(
            "gain: prior + damping must be positive definite; give a damping above 0 for splats never seen"
        )
    return factor


def mean_variances(
    prior: Float[Tensor, "n p"] | Float[Tensor, "n p p"], damping: ArrayLike | None = None
) -> Float[Tensor, "n d"]:
    """Posterior variances [m²] of each splat's mean, by what past views tell of it: 1 / (H + λ), its own columns.

    Of `blocks` (n, p, p): the diagonal of (H + Λ)⁻¹, which also holds what the mean shares with the splat's other
    parameters; its covariances are left out. damping: as in `gain`. For `risk.field(..., posterior=...)`.
    """
    dim = _dim_of(prior)
    damping = torch.as_tensor(default_damping(prior) if damping is None else damping).to(prior).expand(prior.shape[1])
    if prior.ndim == 3:
        inverse = torch.cholesky_inverse(_factor(prior, torch.diag_embed(damping)))
        return torch.diagonal(inverse, dim1=1, dim2=2)[:, :dim].to(prior)
    known = prior[:, :dim] + damping[:dim]
    if not bool((known > 0).all()):
        raise ValueError("gain: prior + damping must be positive; give a damping above 0 for splats never seen")
    return 1 / known


def gain(
    acquired: Float[Tensor, "n p"] | Float[Tensor, "n p p"],
    prior: Float[Tensor, "n p"] | Float[Tensor, "n p p"],
    weights: Float[Tensor, " n"] | None = None,
    selected: Bool[Tensor, " n"] | None = None,
    damping: ArrayLike | None = None,
    weigh_prior: bool = False,
    literal_views: int | None = None,
) -> Float[Tensor, ""]:
    """Expected information gain tr(H″ H″_prior⁻¹), Eqs. (5) and (15): Σ v · h / (H + λ) over the selected splats.

    acquired, prior: `fisher` of the new view and of all past ones, or `blocks` of both, when a splat's term is
    v · tr(h (H + Λ)⁻¹), p × p matrices with Λ = diag(λ). weights v: Eq. (13), on the acquired information
    only. selected: the masked zone, Eq. (11). damping λ: number or (p,), by default one value a parameter group.
    The paper's literal forms: `weigh_prior` puts V̄ on the prior too, as Eqs. (14)-(15) do, where it cancels;
    `literal_views` = number of past views adds λI to the new view and to each of those, as Section III-B does.
    """
    if acquired.shape != prior.shape:
        raise ValueError(f"gain: acquired {tuple(acquired.shape)} and prior {tuple(prior.shape)} must match")
    damping = torch.as_tensor(default_damping(prior) if damping is None else damping).to(prior)
    if prior.ndim == 3:
        damping = torch.diag_embed(damping.expand(prior.shape[1]))
    if literal_views is not None:
        acquired = acquired + damping
    if prior.ndim == 3:
        prior, counted = _literal(prior, weights, damping, weigh_prior, literal_views)
        value = _value_of(prior, counted, selected)
        counts = (value != 0) & acquired.detach().flatten(1).any(1)
        return (value[counts] * _traces(acquired[counts], prior[counts], damping)).sum()
    return (acquired * worth_of(prior, weights, selected, damping, weigh_prior, literal_views)).sum()


def view_gain(
    splat_map: SplatMap,
    camera: Camera,
    pose: Pose,
    prior: Tensor,
    others: SplatMap | None = None,
    noise: Noise | None = None,
    **options: Unpack[Options],
) -> Tensor:
    """Gain of the view from `pose`, a scalar tensor. The prior says which information is meant: `fisher` or `blocks`.

    noise: sigma_color, sigma_depth of `fisher`. options: weights, selected, damping and the literal forms as in `gain`.
    """
    look = blocks if prior.ndim == 3 else fisher
    return gain(look(splat_map, camera, pose, others, **(noise or _DEFAULT.noise)), prior, **options)


@torch.enable_grad()
def gain_and_slope(
    splat_map: SplatMap,
    camera: Camera,
    position: ArrayLike,
    yaw: float,
    prior: Tensor,
    others: SplatMap | None = None,
    noise: Noise | None = None,
    **options: Unpack[Options],
) -> tuple[float, float]:
    """Gain of the view from `position` (d,) along `yaw` [rad], and its exact derivative [1/rad], as two floats.

    Arguments as in `view_gain`. The order of the splats by range does not change with the yaw, so the derivative is
    that of a smooth function, but for splats that enter at the near plane.
    """
    angle = torch.tensor(float(yaw), dtype=splat_map.means.dtype, requires_grad=True)
    view = geometry.yaw_pose(torch.as_tensor(position).to(splat_map.means), angle)
    value = view_gain(splat_map, camera, view, prior, others, noise, **options)
    slope = torch.autograd.grad(value, angle)[0] if value.requires_grad else 0.0
    return value.item(), float(slope)


def gain_and_gradient(
    splat_map: SplatMap,
    camera: Camera,
    pose: Pose,
    prior: Tensor,
    others: SplatMap | None = None,
    noise: Noise | None = None,
    **options: Unpack[Options],
) -> tuple[float, Tensor]:
    """Gain of the view from `pose`, a float, and its exact gradient (d + d(d−1)/2,) in the twist of `pose.moved`.

    Arguments as in `view_gain`; per metre and radian, in the camera's own frame; the yaw is one direction of it, see
    `directions`. Autograd goes through the dense twin: time and memory grow as splats × pixels (0.3 s for 500 splats
    and 64 × 64 pixels), so it is for small images. Where the camera moves, the splats' order by range can change:
    there the gain jumps a little.
    """
    place = pose.to(splat_map.means)
    with torch.enable_grad():
        twist = torch.zeros(splat_map.dim * (splat_map.dim + 1) // 2).to(splat_map.means).requires_grad_()
        value = view_gain(splat_map, camera, place.moved(twist), prior, others, noise, **options)
        gradient = torch.autograd.grad(value, twist)[0] if value.requires_grad else torch.zeros_like(twist)
    return value.item(), gradient
