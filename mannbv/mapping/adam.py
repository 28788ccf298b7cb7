"""Adam (Kingma and Ba 2015) on splats: a row of parameters for each, and a memory of its own."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from mannbv.config import Config
from mannbv.kernels import adam

_DEFAULT = Config()


@dataclass(frozen=True)
class Moments:
    """Adam's memory of n splats of w parameters each: running means of slopes and of their squares, steps taken."""

    first: Float[Tensor, "n w"]
    second: Float[Tensor, "n w"]
    steps: Int[Tensor, " n"]

    @staticmethod
    def none(n: int, width: int, dtype: torch.dtype = torch.float32) -> "Moments":
        """No memory yet of n splats; dtype: that of their parameters."""
        empty = torch.zeros(n, width, dtype=dtype)
        return Moments(empty, empty.clone(), torch.zeros(n, dtype=torch.int64))

    def tensors(self) -> tuple[Tensor, Tensor, Tensor]:
        """The three fields in order."""
        return self.first, self.second, self.steps

    def select(self, index: Tensor) -> "Moments":
        """The memory of the splats at `index`."""
        return Moments(*(part[index] for part in self.tensors()))

    def grown(self, n: int) -> "Moments":
        """The memory of these splats and of n more, of which there is none yet."""
        more = Moments.none(n, self.first.shape[1], self.first.dtype)
        return Moments(*(torch.cat(pair) for pair in zip(self.tensors(), more.tensors(), strict=True)))

    def copy(self) -> "Moments":
        """Tensors of its own, which a step may change."""
        return Moments(*(part.clone() for part in self.tensors()))


def step_all(rows: Tensor, slopes: Tensor, moments: Moments, rates: Tensor, config: Config = _DEFAULT) -> None:
    """One step of every splat in place, as `torch.optim.Adam` takes it to the last bit; all took equally many before.

    rows, slopes: (n, w). rates: the length of a step (w,), in double precision.
    """
    beta1, beta2 = config.adam_beta1, config.adam_beta2
    moments.steps.add_(1)
    steps = int(moments.steps[0])
    moments.first.lerp_(slopes, 1 - beta1)
    moments.second.mul_(beta2).addcmul_(slopes, slopes, value=1 - beta2)
    spread = moments.second.sqrt().div_((1 - beta2**steps) ** 0.5).add_(config.adam_epsilon)
    rows.addcdiv_(moments.first * (-rates / (1 - beta1**steps)).to(rows), spread)


def step_seen(rows: Tensor, slopes: Tensor, moments: Moments, rates: Tensor, config: Config = _DEFAULT) -> None:
    """One step, in place, of the splats with any slope; the others keep their place and their memory."""
    first, second, steps = (part.numpy() for part in moments.tensors())
    settings = config.adam_beta1, config.adam_beta2, config.adam_epsilon
    adam.step(rows.numpy(), slopes.numpy(), first, second, steps, rates.to(rows).numpy(), *settings)
