"""From information to gain, Eqs. (5), (14), (15), and how a gain changes with the yaw."""

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from mannbv import geometry
from mannbv.camera import Camera
from mannbv.config import Config
from mannbv.information.fisher import fisher, n_parameters
from mannbv.splats import SplatMap

_DEFAULT = Config()


def damping(dim: int, config: Config = _DEFAULT) -> Float[Tensor, " p"]:
    """λ per parameter: what is known of it before any view, 1 / std² in the parameter's own units."""
    groups = [config.damping_mean] * dim + [config.damping_scale] * dim
    groups += [config.damping_rotation] * (dim * (dim - 1) // 2) + [config.damping_opacity]
    return torch.tensor(groups + [config.damping_color] * 3)


def default_damping(prior: Tensor) -> Float[Tensor, " p"]:
    """`damping` for the dimension whose parameters are the columns of `prior` (n, p)."""
    dims = {n_parameters(dim): dim for dim in (2, 3)}
    if prior.shape[1] not in dims:
        raise ValueError(f"gain: the prior has {prior.shape[1]} columns, not 9 (flatland) or 13; give a damping for it")
    return damping(dims[prior.shape[1]])


def worth_of(prior: Tensor, weights, selected, damping) -> Tensor:
    """v / (H + λ) for every parameter (n, p), zero outside the selection."""
    damping = default_damping(prior) if damping is None else damping
    worth = torch.ones(len(prior)).to(prior) if weights is None else torch.as_tensor(weights).to(prior)
    _check_rows("weights", worth, prior)
    if selected is not None:
        selected = torch.as_tensor(selected, device=prior.device)
        _check_rows("selected", selected, prior)
        if selected.dtype != torch.bool and len(selected):
            raise ValueError(f"gain: selected must say True or False of each splat, got {selected.dtype}")
        worth = torch.where(selected.bool(), worth, 0.0)
    denominator = prior + torch.as_tensor(damping).to(prior)
    if not bool((denominator > 0).all()):
        raise ValueError("gain: prior + damping must be positive; give a damping above 0 for splats never seen")
    return worth[:, None] / denominator


def _check_rows(name: str, values: Tensor, prior: Tensor) -> None:
    if values.shape != prior.shape[:1]:
        raise ValueError(f"gain: {name} must be ({len(prior)},), one a splat, got {tuple(values.shape)}")


def gain(
    acquired: Float[Tensor, "n p"],
    prior: Float[Tensor, "n p"],
    weights: Float[Tensor, " n"] | None = None,
    selected: Bool[Tensor, " n"] | None = None,
    damping=None,
    weigh_prior: bool = False,
    literal_views: int | None = None,
) -> Float[Tensor, ""]:
    """Expected information gain tr(H″ H″_prior⁻¹), Eqs. (5) and (15): Σ v · h / (H + λ) over the selected splats.

    acquired, prior: `fisher` of the new view and of all past ones. weights v: Eq. (13), on the acquired information
    only. selected: the masked zone, Eq. (11). damping λ: number or (p,), by default one value a parameter group.
    The paper's literal forms: `weigh_prior` puts V̄ on the prior too, as Eqs. (14)-(15) do, where it cancels;
    `literal_views` = number of past views adds λI to the new view and to each of those, as Section III-B does.
    """
    if acquired.shape != prior.shape:
        raise ValueError(f"gain: acquired {tuple(acquired.shape)} and prior {tuple(prior.shape)} must match")
    damping = torch.as_tensor(default_damping(prior) if damping is None else damping).to(prior)
    if literal_views is not None:
        acquired, prior = acquired + damping, prior + (literal_views - 1) * damping
    if weigh_prior and weights is not None:
        weights = (torch.as_tensor(weights) > 0).to(prior)  # v / v
    return (acquired * worth_of(prior, weights, selected, damping)).sum()


def gain_and_slope(
    splat_map: SplatMap, camera: Camera, position, yaw: float, prior: Tensor, others=None, noise=None, **options
):
    """Gain of the view from `position` (d,) along `yaw` [rad], and its exact derivative [1/rad], as two floats.

    noise: sigma_color, sigma_depth of `fisher`. options: weights, selected, damping as in `gain`. The order of the
    splats by range does not change with the yaw, so the derivative is that of a smooth function, but for splats that
    enter at the near plane.
    """
    angle = torch.tensor(float(yaw), dtype=splat_map.means.dtype, requires_grad=True)
    view = geometry.yaw_pose(torch.as_tensor(position).to(splat_map.means), angle)
    value = gain(fisher(splat_map, camera, view, others, **(noise or {})), prior, **options)
    slope = torch.autograd.grad(value, angle)[0] if value.requires_grad else 0.0
    return value.item(), float(slope)
