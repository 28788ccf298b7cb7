"""What one robot may evaluate on: splats, what is known of each, and the ground; and what a view would tell of them."""

from dataclasses import dataclass

from jaxtyping import Bool, Float
from numpy.typing import ArrayLike
from torch import Tensor

from mannbv import grid, information
from mannbv.camera import Camera
from mannbv.config import Config
from mannbv.geometry import Pose
from mannbv.information import YawProfile
from mannbv.information.gain import Options
from mannbv.splats import SplatMap


@dataclass(frozen=True)
class Belief:
    """What one robot may evaluate on: splats, the information about each (n, p), the ground it knows (or None).

    views: how many past views the prior tells of; it counts where "+λI" belongs to every view (`Config.damped`).
    """

    splats: SplatMap
    prior: Float[Tensor, "n p"]
    ground: grid.Occupancy | None = None
    views: int = 0

    @property
    def known(self) -> grid.Occupancy:
        """Its ground. Raises ValueError where it has none."""
        if self.ground is None:
            raise ValueError("belief: this needs to know the ground; give Belief(…, ground=…)")
        return self.ground


def gain_options(
    belief: Belief,
    config: Config,
    weights: Float[Tensor, " n"] | None = None,
    selected: Bool[Tensor, " n"] | None = None,
) -> Options:
    """What `information.gain` is given beside information: weights, selection, and how the config reads the prior."""
    return {
        "weights": weights,
        "selected": selected,
        "damping": information.damping(belief.splats.dim, config),
        "weigh_prior": config.weighs == "both",
        "literal_views": belief.views if config.damped == "views" else None,
    }


def shown(belief: Belief, camera: Camera, pose: Pose, config: Config, others: SplatMap | None = None) -> Tensor:
    """Fisher information (n, p) of one view about a belief's splats, Eqs. (3)-(5); `others` occlude."""
    return information.fisher(belief.splats, camera, pose, others, **config.noise)


def profile(
    belief: Belief,
    camera: Camera,
    position: ArrayLike,
    config: Config,
    weights: Float[Tensor, " n"] | None = None,
    selected: Bool[Tensor, " n"] | None = None,
    n_yaws: int | None = None,
) -> YawProfile:
    """Gain (15) of all yaws at `position` (d,) [m], `config.n_yaws` of them unless told otherwise.

    weights v and selection as in `information.gain`; without them the whole map counts, Eq. (5).
    """
    return information.yaw_profile(
        belief.splats, camera, position, belief.prior, n_yaws=n_yaws or config.n_yaws,
        **gain_options(belief, config, weights, selected), **config.noise,
    )  # fmt: skip
