"""Adam on splats against torch's own, which knows neither rows that rest nor memories of different age."""

import numpy as np
import pytest
import torch

from mannbv.config import Config
from mannbv.mapping import Moments
from mannbv.mapping.adam import step_all, step_seen

OTHER = Config(adam_beta1=0.9, adam_beta2=0.999, adam_epsilon=1e-6)
RATES = torch.tensor([0.002, 0.002, 0.03, 0.05, 0.02], dtype=torch.float64)


def slopes_of(rng, n: int, seen: float = 1.0) -> torch.Tensor:
    """Slopes (n, 5) of very different sizes; a share of the rows rests."""
    slopes = rng.normal(size=(n, 5)) * 10.0 ** rng.uniform(-6, 2, (n, 1))
    slopes[rng.random(n) >= seen] = 0.0
    return torch.from_numpy(slopes.astype(np.float32))


def theirs(start: torch.Tensor, history: list[torch.Tensor], betas=(0.8, 0.95), eps=1e-8) -> torch.Tensor:
    """Where torch.optim.Adam brings rows (n, 5) that take every step of a history."""
    columns = [column.clone().requires_grad_() for column in start.T]
    groups = [{"params": [column], "lr": rate} for column, rate in zip(columns, RATES.tolist(), strict=True)]
    optimiser = torch.optim.Adam(groups, betas=betas, eps=eps, foreach=True)
    for slopes in history:
        for column, slope in zip(columns, slopes.T, strict=True):
            column.grad = slope.clone()
        optimiser.step()
    return torch.stack([column.detach() for column in columns], 1)


@pytest.mark.parametrize("n", [1, 7, 1013])
def test_a_step_of_all_is_torchs_adam_to_the_last_bit(n, rng):
    start, history = slopes_of(rng, n), [slopes_of(rng, n, 0.6) for _ in range(20)]
    rows, moments = start.clone(), Moments.none(n, 5)
    for slopes in history:
        step_all(rows, slopes, moments, RATES)
    assert torch.equal(rows, theirs(start, history))


@pytest.mark.parametrize("step", [step_all, step_seen])
def test_adams_constants_are_the_configs(step, rng):
    start, history = slopes_of(rng, 12), [slopes_of(rng, 12) for _ in range(9)]
    rows, moments = start.clone(), Moments.none(12, 5)
    for slopes in history:
        step(rows, slopes, moments, RATES, OTHER)
    expected = theirs(start, history, (0.9, 0.999), 1e-6)
    assert torch.allclose(rows, expected, rtol=1e-5, atol=1e-6)
    assert not torch.allclose(rows, theirs(start, history), rtol=1e-3, atol=1e-4)


def test_a_step_of_the_seen_is_torchs_adam_on_the_steps_that_each_was_seen(rng):
    n = 40
    start, history = slopes_of(rng, n), [slopes_of(rng, n, 0.6) for _ in range(20)]
    rows, moments = start.clone(), Moments.none(n, 5)
    for slopes in history:
        step_seen(rows, slopes, moments, RATES)
    for s in range(n):
        own = [slopes[s : s + 1] for slopes in history if slopes[s].any()]
        assert int(moments.steps[s]) == len(own)
        assert torch.allclose(rows[s : s + 1], theirs(start[s : s + 1], own), rtol=1e-5, atol=1e-6)
    everyone = theirs(start, history)  # one clock for all, and momentum that carries the unseen on
    assert not torch.allclose(rows, everyone, rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize("step", [step_all, step_seen])
def test_double_precision_stays_double(step, rng):
    rows, moments = slopes_of(rng, 9).double(), Moments.none(9, 5, torch.float64)
    start, slopes = rows.clone(), slopes_of(rng, 9).double()
    step(rows, slopes, moments, RATES)
    assert moments.grown(2).first.dtype == torch.float64
    assert torch.allclose(rows, start - RATES * slopes / (slopes.abs() + 1e-8), atol=1e-12)  # Adam's first step


def test_what_is_not_seen_rests(rng):
    rows, moments = slopes_of(rng, 50), Moments.none(50, 5)
    step_seen(rows, slopes_of(rng, 50), moments, RATES)
    before, memory = rows.clone(), moments.copy()
    slopes = slopes_of(rng, 50, 0.5)
    slopes[3] = torch.tensor([0.0, 0, 0, 0, 1e-20])  # seen, if only just
    step_seen(rows, slopes, moments, RATES)
    rests = ~slopes.any(1)
    assert 10 < int(rests.sum()) < 40 and not rests[3]
    for old, new in zip((before, *memory.tensors()), (rows, *moments.tensors()), strict=True):
        assert torch.equal(old[rests], new[rests])
    assert (rows != before)[~rests].any(1).all()


def test_memories_follow_their_splats(rng):
    moments = Moments(slopes_of(rng, 6), slopes_of(rng, 6), torch.arange(6))
    grown = moments.grown(2)
    assert torch.equal(grown.first[:6], moments.first) and torch.equal(grown.second[:6], moments.second)
    assert not any(part[6:].any() for part in grown.tensors())
    kept = grown.select(torch.tensor([False, True] * 4))
    assert kept.steps.tolist() == [1, 3, 5, 0]
    assert torch.equal(kept.first[:3], moments.first[1::2])
