"""A robot's private map, and what one keyframe more makes of it."""

import dataclasses
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from mannbv import splats
from mannbv.camera import Camera, Frame
from mannbv.config import Config
from mannbv.mapping.adam import Moments
from mannbv.mapping.fitting import refine
from mannbv.mapping.insertion import mistaken, newborn, survivors, unexplained
from mannbv.splats import SplatMap


@dataclass(frozen=True)
class LocalMap:
    """One robot's private map: its splats, their ids (n,) in order of birth, what is known of them, its keyframes.

    prior (n, p): information of the past keyframes. moments: Adam's memory, where `config.moments` keeps it. The rows
    of both follow insertion and pruning, and are 0 for new splats.
    """

    splats: SplatMap
    ids: Int[Tensor, " n"]
    prior: Float[Tensor, "n p"]
    keyframes: tuple[Frame, ...] = ()
    born: int = 0
    moments: Moments | None = None

    @staticmethod
    def empty(dim: int, n_parameters: int) -> "LocalMap":
        return LocalMap(SplatMap.empty(dim), torch.zeros(0, dtype=torch.int64), torch.zeros(0, n_parameters))

    def replace(self, **changes: object) -> "LocalMap":
        return dataclasses.replace(self, **changes)

    def grown(self, fresh: SplatMap) -> "LocalMap":
        """With new splats after the old ones, under new ids."""
        n = fresh.n_splats
        return self.replace(
            splats=splats.union(self.splats, fresh),
            ids=torch.cat([self.ids, self.born + torch.arange(n)]),
            prior=torch.cat([self.prior, torch.zeros(n, self.prior.shape[1])]),
            born=self.born + n,
            moments=self.moments and self.moments.grown(n),
        )

    def select(self, keep: Tensor) -> "LocalMap":
        """With the splats at the boolean index `keep` only."""
        moments = self.moments and self.moments.select(keep)
        return self.replace(
            splats=self.splats.select(keep), ids=self.ids[keep], prior=self.prior[keep], moments=moments
        )


def window(keyframes: tuple[Frame, ...], config: Config, rng: np.random.Generator) -> list[Frame]:
    """The latest keyframes, and `fit_older` older ones so that the past is not forgotten; the newest last."""
    recent, old = list(keyframes[-config.fit_window :]), keyframes[: -config.fit_window]
    chosen = sorted(rng.permutation(len(old))[: config.fit_older].tolist())
    return [old[k] for k in chosen] + recent


def observe(local: LocalMap, camera: Camera, frame: Frame, config: Config, rng: np.random.Generator) -> LocalMap:
    """A robot's map after one more keyframe: insert, fit on a window, densify half way, prune.

    The same map, frame and random generator give the same bits, whether the map comes from memory or from a file.
    """
    local = local.replace(keyframes=(*local.keyframes, frame), moments=_memory(local, config))
    local = local.grown(newborn(camera, frame, unexplained(local.splats, camera, frame, config), config))
    frames, steps = window(local.keyframes, config, rng), config.fit_steps
    if config.densify_error < 1:  # a colour is never wrong by more
        local = _refined(local, camera, frames, config, steps // 2)
        wrong = mistaken(local.splats, camera, frame, config)
        local = local.grown(newborn(camera, frame, wrong, config.replace(insert_spacing=1)))
        steps -= steps // 2
    local = _refined(local, camera, frames, config, steps)
    return local.select(survivors(local.splats, config))


def _memory(local: LocalMap, config: Config) -> Moments | None:
    """What the optimiser remembers when a keyframe comes."""
    if config.moments == "fresh":
        return None
    width = sum(part.shape[1:].numel() for part in local.splats.tensors())
    return local.moments or Moments.none(local.splats.n_splats, width, local.splats.means.dtype)


def _refined(local: LocalMap, camera: Camera, frames: list[Frame], config: Config, steps: int) -> LocalMap:
    fitted, moments = refine(local.splats, local.moments, camera, frames, config, steps)
    return local.replace(splats=fitted, moments=moments)
