import math

import mpmath
import numpy as np
import pytest
import torch
from helpers import camera_for, random_map, random_pose, shifted
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.stats import norm

from mannbv import information, risk, splats
from mannbv.config import Config
from mannbv.splats import SplatMap

LEVELS = [0.01, 0.1, 0.5, 0.9]


def tails(mean, std, level, n=2_000_000):
    """(V@R, AV@R, mean of the upper tail) from samples of the Gaussian that the paper posits."""
    samples = np.sort(np.random.default_rng(1).normal(mean, std, n))
    count = round(level * n)
    return samples[count], samples[:count].mean(), samples[-count:].mean()


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize(("mean", "std"), [(1.0, 0.3), (0.2, 1.5)])
def test_closed_forms_agree_with_two_million_samples(level, mean, std):
    var, avar, upper = tails(mean, std, level)
    bound = 0.01 * std
    assert abs(risk.value_at_risk(mean, std, level) - var) < bound
    assert abs(risk.average_value_at_risk(mean, std, level) - avar) < bound
    # the upper tail, or the value in place of the average, must not pass for AV@R
    assert abs(risk.average_value_at_risk(mean, std, level) - upper) > 10 * bound
    assert abs(risk.value_at_risk(mean, std, level) - avar) > 10 * bound


@given(st.floats(-5, 5), st.floats(0.001, 3), st.floats(0.001, 0.999))
def test_closed_forms_agree_with_scipy(mean, std, level):
    quantile = norm.ppf(level)
    assert_allclose(risk.value_at_risk(mean, std, level), mean + std * quantile, rtol=1e-9, atol=1e-9)
    expected = mean - std * norm.pdf(quantile) / level
    assert_allclose(risk.average_value_at_risk(mean, std, level), expected, rtol=1e-9, atol=1e-9)


@given(st.floats(-5, 5), st.floats(0, 3), st.floats(0.01, 0.99), st.floats(0.01, 10), st.floats(-5, 5))
def test_laws_of_scale_order_and_shift(mean, std, level, factor, shift):
    for measure in (risk.value_at_risk, risk.average_value_at_risk):
        value = measure(mean, std, level)
        assert_allclose(measure(factor * mean, factor * std, level), factor * value, rtol=1e-9, atol=1e-9)
        assert_allclose(measure(mean + shift, std, level), value + shift, rtol=1e-9, atol=1e-9)
        assert measure(mean, std, min(0.995, level + 0.004)) >= value - 1e-12
        assert measure(mean, 0.0, level) == mean
    assert risk.average_value_at_risk(mean, std, level) <= risk.value_at_risk(mean, std, level) + 1e-12
    assert risk.average_value_at_risk(mean, std, level) <= mean


@pytest.mark.parametrize("level", [5e-324, 1e-300, 1e-100, 1e-17, 1e-9, 0.1, 0.5, 0.999, 1 - 1e-16])
def test_levels_near_0_and_1_against_fifty_digits(level):
    """V@R solves Φ(q) = level by bisection; AV@R is −φ(q) / level."""
    with mpmath.workdps(50):
        exact = mpmath.mpf(level)
        low, high = mpmath.mpf(-60), mpmath.mpf(60)
        for _ in range(220):
            middle = (low + high) / 2
            low, high = (middle, high) if mpmath.ncdf(middle) < exact else (low, middle)
        quantile, tail = float(low), float(-mpmath.npdf(low) / exact)
    assert_allclose(risk.value_at_risk(0.0, 1.0, level), quantile, rtol=1e-14, atol=1e-16)
    assert_allclose(risk.average_value_at_risk(0.0, 1.0, level), tail, rtol=1e-14)


def test_the_smallest_levels_are_the_most_cautious():
    assert_allclose(risk.average_value_at_risk(1.0, 0.1, 1e-17), 0.139, atol=1e-3)  # not 1.0, as if riskless
    levels = np.geomspace(1e-300, 0.5, 400)
    for function in (risk.value_at_risk, risk.average_value_at_risk):
        assert (np.diff([function(0.0, 1.0, level) for level in levels]) > 0).all()


def test_arrays_and_tensors_go_through():
    expected = [risk.average_value_at_risk(m, 0.5, 0.1) for m in (1.0, 2.0)]
    assert_allclose(risk.average_value_at_risk(np.array([1.0, 2.0]), 0.5, 0.1), expected)
    assert_allclose(risk.average_value_at_risk(torch.tensor([1.0, 2.0]), torch.tensor(0.5), 0.1), expected, rtol=1e-6)


def test_sampled_risk_agrees_with_the_closed_form():
    samples = np.random.default_rng(2).normal(1.0, 0.4, 500_000)
    var, avar = risk.sampled(samples, 0.1)
    assert_allclose(var, risk.value_at_risk(1.0, 0.4, 0.1), atol=5e-3)
    assert_allclose(avar, risk.average_value_at_risk(1.0, 0.4, 0.1), atol=5e-3)


@pytest.mark.parametrize("level", [0.07, 0.1, 0.29, 0.57])  # level · 100 is not a whole number in floating point
def test_sampled_risk_takes_the_worst_share_and_no_more(level):
    samples = np.random.default_rng(0).permutation(100) + 1.0
    count = round(level * 100)
    assert risk.sampled(samples, level) == (count, (count + 1) / 2)


@pytest.mark.parametrize("samples", [[], [1.0, math.nan]])
def test_samples_must_be_numbers(samples):
    with pytest.raises(ValueError, match="needs at least one sample, none of them NaN"):
        risk.sampled(samples, 0.1)


def by_hand(splat_map, points, level, measure, spread, posterior=None):
    """Eq. (9) splat by splat; posterior (n, d): variances of the means, which add to the spread along the sight."""
    means, covariances = splat_map.means.numpy(), splat_map.covariances().numpy()
    wide = np.zeros_like(means) if posterior is None else posterior
    result = np.full(len(points), np.inf)
    for mean, covariance, variances in zip(means, covariances, wide, strict=True):
        away = points - mean
        distance = np.sqrt((away**2).sum(1))
        if spread == "largest":
            std = np.full(len(points), math.sqrt(np.linalg.eigvalsh(covariance)[-1]))
        else:
            sight = away / distance[:, None]
            std = np.sqrt(((sight @ covariance) * sight).sum(1))
        if posterior is not None:
            std = np.sqrt(std**2 + (away**2 / (distance**2)[:, None]) @ variances)
        quantile = norm.ppf(level)
        factor = {"avar": -norm.pdf(quantile) / level, "var": quantile, "mean": 0.0}[measure]
        result = np.minimum(result, distance + factor * std)
    return result


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("spread", ["largest", "along"])
@pytest.mark.parametrize("measure", ["avar", "var", "mean"])
def test_the_field_agrees_with_brute_force(dim, spread, measure, rng):
    for n in (1, 2, 7, 150):
        splat_map = random_map(rng, n, dim)
        splat_map = splats.union(splat_map, splat_map.select(torch.arange(n // 2)))  # some twice
        points = rng.uniform(-4, 4, (300, dim))
        for level in LEVELS:
            found = risk.field(splat_map, torch.from_numpy(points), level, measure, spread)
            assert_allclose(found, by_hand(splat_map, points, level, measure, spread), rtol=1e-9, atol=1e-9)


def test_the_measures_in_the_brute_force_are_all_there_are():
    assert {"avar", "var", "mean"} <= set(risk.MEASURES)


def test_a_hundred_thousand_points_against_ten_thousand_splats(rng):
    splat_map = random_map(rng, 10_000, 2, torch.float32, reach=20.0)
    splat_map = SplatMap(splat_map.means, splat_map.log_scales - 2, *splat_map.tensors()[2:])
    points = rng.uniform(-25, 25, (100_000, 2)).astype(np.float32)
    found = risk.field(splat_map, torch.from_numpy(points), 0.1)
    some = rng.choice(100_000, 200, replace=False)
    expected = by_hand(splat_map.to(torch.float64), points[some].astype(float), 0.1, "avar", "largest")
    assert_allclose(found[some], expected, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_few_points_and_many_take_the_same_values(dim, rng):
    splat_map, points = random_map(rng, 400, dim), torch.from_numpy(rng.uniform(-4, 4, (600, dim)))
    whole = risk.field(splat_map, points)
    assert torch.equal(whole[:10], risk.field(splat_map, points[:10]))
    order = torch.from_numpy(rng.permutation(400))
    assert_allclose(whole, risk.field(splat_map.select(order), points), rtol=1e-12)


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1), st.sampled_from([2, 3]), st.sampled_from(["largest", "along"]))
def test_more_splats_never_raise_the_field_and_far_ones_never_lower_it(seed, dim, spread):
    rng = np.random.default_rng(seed)
    some, more = random_map(rng, 6, dim), random_map(rng, 4, dim)
    points = torch.from_numpy(rng.uniform(-3, 3, (9, dim)))
    before = risk.field(some, points, spread=spread)
    assert (risk.field(splats.union(some, more), points, spread=spread) <= before).all()
    assert torch.equal(risk.field(splats.union(some, shifted(more, 100.0)), points, spread=spread), before)


@pytest.mark.parametrize("dim", [2, 3])
def test_the_field_scales_and_moves_with_the_world(dim, rng):
    splat_map, points = random_map(rng, 20, dim), torch.from_numpy(rng.uniform(-4, 4, (10, dim)))
    before = risk.field(splat_map, points)
    assert_allclose(risk.field(shifted(splat_map, 7.0), points + 7.0), before, atol=1e-9)
    larger = SplatMap(3 * splat_map.means, splat_map.log_scales + math.log(3), *splat_map.tensors()[2:])
    assert_allclose(risk.field(larger, 3 * points), 3 * before, rtol=1e-9)


@pytest.mark.parametrize("dim", [2, 3])
def test_the_field_differentiates(dim, rng):
    splat_map, points = random_map(rng, 20, dim), torch.from_numpy(rng.uniform(-4, 4, (5, dim)))
    points.requires_grad_(True)
    assert torch.autograd.gradcheck(lambda p: risk.field(splat_map, p), points)
    scales = splat_map.log_scales.clone().requires_grad_(True)

    def field(log_scales):
        return risk.field(SplatMap(splat_map.means, log_scales, *splat_map.tensors()[2:]), points.detach())

    assert torch.autograd.gradcheck(field, scales)


def test_on_a_mean_the_spread_along_the_sight_is_the_worst(rng):
    one = random_map(rng, 1, 2)
    on = risk.field(one, one.means, spread="along")
    assert_allclose(on, risk.field(one, one.means))
    around = one.means + 1e-6 * torch.from_numpy(np.stack([np.cos(np.arange(64) / 10), np.sin(np.arange(64) / 10)], 1))
    assert_allclose(on, risk.field(one, around, spread="along").min(), atol=1e-3)


@pytest.mark.parametrize("dim", [2, 3])
def test_an_empty_map_is_safe_and_no_points_have_no_risk(dim):
    assert torch.isinf(risk.field(SplatMap.empty(dim), torch.zeros(4, dim))).all()
    assert risk.field(SplatMap.empty(dim), torch.zeros(0, dim)).shape == (0,)
    assert risk.field(random_map(np.random.default_rng(0), 3, dim), torch.zeros(0, dim, dtype=torch.float64)).shape == (
        0,
    )


def test_the_total_risk_of_a_path_is_the_mean_over_its_waypoints(rng):
    splat_map, path = random_map(rng, 20, 2), torch.from_numpy(rng.uniform(-4, 4, (7, 2)))
    assert_allclose(
        risk.total(splat_map, path, 0.2, "var"), np.mean(by_hand(splat_map, path.numpy(), 0.2, "var", "largest"))
    )


def test_a_users_measure_serves_like_ours(rng, monkeypatch):
    monkeypatch.setattr(risk, "MEASURES", dict(risk.MEASURES))
    risk.register("entropic", lambda mean, std, level: mean - std**2 / (2 * level))
    risk.register("cautious", lambda mean, std, level: mean - 3 * std, linear=True)
    splat_map, points = random_map(rng, 30, 2), torch.from_numpy(rng.uniform(-4, 4, (50, 2)))
    distance = torch.cdist(points, splat_map.means)
    std = splat_map.scales.amax(1)
    assert_allclose(risk.field(splat_map, points, 0.3, "entropic"), (distance - std**2 / 0.6).amin(1), rtol=1e-9)
    assert_allclose(risk.field(splat_map, points, 0.3, "cautious"), (distance - 3 * std).amin(1), rtol=1e-9)
    risk.register("cautious", lambda mean, std, level: mean - 4 * std, linear=True)  # one's own may be replaced
    assert_allclose(risk.field(splat_map, points, 0.3, "cautious"), (distance - 4 * std).amin(1), rtol=1e-9)
    with pytest.raises(ValueError, match="'avar' is one of our own"):
        risk.register("avar", lambda mean, std, level: mean)


@pytest.mark.parametrize("level", [0.0, 1.0, -0.1, 1.5, math.nan])
def test_a_level_outside_the_open_interval_is_named(level):
    splat_map = random_map(np.random.default_rng(0), 3, 2)
    for call in (
        lambda: risk.value_at_risk(1.0, 0.1, level),
        lambda: risk.average_value_at_risk(1.0, 0.1, level),
        lambda: risk.sampled([1.0], level),
        lambda: risk.field(splat_map, torch.zeros(1, 2), level),
    ):
        with pytest.raises(ValueError, match="level must lie strictly between 0 and 1"):
            call()


def test_what_the_field_refuses(rng):
    splat_map, points = random_map(rng, 3, 2), torch.zeros(1, 2)
    with pytest.raises(ValueError, match="no measure 'doom'; known: avar"):
        risk.field(splat_map, points, measure="doom")
    with pytest.raises(ValueError, match="spread must be 'largest' or 'along'"):
        risk.field(splat_map, points, spread="wide")
    with pytest.raises(ValueError, match=r"points must be \(k, 2\)"):
        risk.field(splat_map, torch.zeros(1, 3))
    for spread in ("largest", "along"):
        with pytest.raises(ValueError, match="must be finite"):
            risk.field(splat_map, torch.tensor([[0.0, math.nan]]), spread=spread)
        broken = SplatMap(splat_map.means * math.nan, *splat_map.tensors()[1:])
        with pytest.raises(ValueError, match="must be finite"):
            risk.field(broken, points, spread=spread)


# ---- what is unsure of the means ------------------------------------------------------------------------------------


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("spread", ["largest", "along"])
@pytest.mark.parametrize("measure", ["avar", "var", "mean"])
def test_the_inflated_field_agrees_with_brute_force(dim, spread, measure, rng):
    for n in (1, 7, 150):
        splat_map, points = random_map(rng, n, dim), rng.uniform(-4, 4, (300, dim))
        posterior = rng.uniform(0, 0.3, (n, dim)) ** 2
        for level in LEVELS:
            found = risk.field(splat_map, torch.from_numpy(points), level, measure, spread, torch.from_numpy(posterior))
            expected = by_hand(splat_map, points, level, measure, spread, posterior)
            assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
            if measure != "mean" and level != 0.5:
                # neither the plain field nor one widened by the largest variance in all directions may pass for it
                for wrong in (None, posterior.max(1, keepdims=True) * np.ones(dim)):
                    other = by_hand(splat_map, points, level, measure, spread, wrong)
                    assert np.abs(other - expected).max() > 1e-5


@pytest.mark.parametrize("spread", ["largest", "along"])
def test_what_is_unsure_only_along_the_wall_does_not_bring_it_nearer(spread, rng):
    one = random_map(rng, 1, 2)
    one = SplatMap(torch.zeros(1, 2, dtype=torch.float64), *one.tensors()[1:])
    points = torch.tensor([[2.0, 0.0], [0.0, 2.0]], dtype=torch.float64)
    before = risk.field(one, points, spread=spread)
    along_y = torch.tensor([[0.0, 0.25]], dtype=torch.float64)
    after = risk.field(one, points, spread=spread, posterior=along_y)
    assert after[0] == before[0]
    assert after[1] < before[1] - 0.1


@pytest.mark.parametrize("dim", [2, 3])
def test_sure_means_change_nothing_and_unsure_ones_never_look_safer(dim, rng):
    splat_map, points = random_map(rng, 60, dim), torch.from_numpy(rng.uniform(-4, 4, (400, dim)))
    sure = torch.zeros(60, dim, dtype=torch.float64)
    for spread in ("largest", "along"):
        before = risk.field(splat_map, points, spread=spread)
        assert_allclose(risk.field(splat_map, points, spread=spread, posterior=sure), before, rtol=1e-12)
        last = before
        for variance in (1e-4, 1e-3, 1e-2):
            now = risk.field(splat_map, points, spread=spread, posterior=sure + variance)
            assert (now < last).all()
            last = now


def test_on_a_mean_the_inflated_spread_is_the_worst(rng):
    one, wide = random_map(rng, 1, 3), torch.tensor([[0.01, 0.09, 0.04]], dtype=torch.float64)
    covariance = one.covariances()[0].numpy()
    factor = norm.pdf(norm.ppf(0.1)) / 0.1
    for spread, worst in (
        ("largest", np.linalg.eigvalsh(covariance)[-1] + 0.09),
        ("along", np.linalg.eigvalsh(covariance + np.diag(wide[0].numpy()))[-1]),
    ):
        for points in (one.means, one.means.expand(2, 3)):
            assert_allclose(risk.field(one, points, 0.1, spread=spread, posterior=wide), -factor * math.sqrt(worst))


def test_the_inflated_field_is_the_same_for_few_and_many_points_and_differentiates(rng):
    splat_map, points = random_map(rng, 400, 3), torch.from_numpy(rng.uniform(-4, 4, (600, 3)))
    posterior = torch.from_numpy(rng.uniform(0, 0.05, (400, 3)))
    whole = risk.field(splat_map, points, posterior=posterior)
    assert torch.equal(whole[:10], risk.field(splat_map, points[:10], posterior=posterior))
    order = torch.from_numpy(rng.permutation(400))
    assert_allclose(whole, risk.field(splat_map.select(order), points, posterior=posterior[order]), rtol=1e-12)
    few = torch.from_numpy(rng.uniform(-4, 4, (5, 3))).requires_grad_()
    some, wide = splat_map.select(order[:20]), posterior[:20].clone().requires_grad_()
    for spread in ("largest", "along"):
        assert torch.autograd.gradcheck(lambda p, v, s=spread: risk.field(some, p, spread=s, posterior=v), (few, wide))


def test_risk_along_a_path_takes_the_variances_of_the_splats_in_reach(rng):
    splat_map, posterior = random_map(rng, 80, 3), torch.from_numpy(rng.uniform(0, 0.05, (80, 3)))
    config = Config(risk_opacity=0.5)
    path = torch.from_numpy(np.column_stack([rng.uniform(-2, 2, (9, 2)), np.full(9, 0.5)]))
    near = risk.in_reach(splat_map, path[0, 2:], config)
    assert 5 < near.sum() < 40
    chosen, variances = splat_map.select(near), posterior[near].numpy()
    expected = by_hand(chosen, path.numpy(), 0.1, "avar", "largest", variances)
    slantwise = config.replace(risk_from="camera")
    assert_allclose(risk.along(splat_map, path, slantwise, posterior), expected, rtol=1e-9)
    level = SplatMap(chosen.means * torch.tensor([1.0, 1.0, 0.0]) + torch.tensor([0, 0, 0.5]), *chosen.tensors()[1:])
    expected = by_hand(level, path.numpy(), 0.1, "avar", "largest", variances)
    assert_allclose(risk.along(splat_map, path, config, posterior), expected, rtol=1e-9)


@pytest.mark.parametrize("dim", [2, 3])
def test_the_variance_of_a_mean_is_that_of_the_inverse_information(dim, rng):
    splat_map, camera = random_map(rng, 30, dim), camera_for(dim, 24)
    poses = [random_pose(rng, dim) for _ in range(2)]
    diagonal, blocks = (information.prior(splat_map, camera, poses, block) for block in (False, True))
    damping = information.damping(dim).double()
    by_diagonal, by_blocks = information.mean_variances(diagonal), information.mean_variances(blocks)
    assert_allclose(by_diagonal, 1 / (diagonal + damping)[:, :dim], rtol=1e-12)
    inverse = np.linalg.inv(blocks.numpy() + np.diag(damping.numpy()))
    assert_allclose(by_blocks, np.diagonal(inverse, axis1=1, axis2=2)[:, :dim], rtol=1e-6)
    assert (by_blocks >= by_diagonal * (1 - 1e-9)).all()  # what else is unknown of a splat never helps
    assert float((by_blocks / by_diagonal).max()) > 1.01
    unseen = information.mean_variances(torch.zeros(2, len(damping)))
    assert_allclose(unseen, 0.01)  # 0.1 m before any view
    assert_allclose(information.mean_variances(diagonal, 7.0), 1 / (diagonal[:, :dim] + 7.0))
    for prior in (torch.zeros(1, len(damping)), torch.zeros(1, len(damping), len(damping))):
        with pytest.raises(ValueError, match="give a damping above 0"):
            information.mean_variances(prior, 0.0)


@pytest.mark.parametrize("dim", [2, 3])
def test_the_posterior_widens_the_field_as_far_as_samples_of_the_means_do(dim, rng):
    """The mean square of where a splat stands along a far sight is what nᵀ P n says."""
    variances = rng.uniform(0.01, 0.2, dim) ** 2
    point = rng.normal(size=dim) * 50
    means = rng.normal(0, np.sqrt(variances), (400_000, dim))
    spread = np.linalg.norm(point - means, axis=1).std()
    tensor = torch.from_numpy
    one = random_map(rng, 1, dim)
    one = SplatMap(torch.zeros(1, dim, dtype=torch.float64), one.log_scales * 0 - 20, *one.tensors()[2:])
    found = risk.field(one, tensor(point[None]), 0.1, posterior=tensor(variances[None]))
    assert_allclose(np.linalg.norm(point) - found, spread * norm.pdf(norm.ppf(0.1)) / 0.1, rtol=0.01)


def test_what_the_inflated_field_refuses(rng, unchecked):
    splat_map, points = random_map(rng, 3, 2), torch.zeros(1, 2)
    for bad, message in (
        (torch.zeros(2, 2), r"posterior must be \(3, 2\) beside this map, got \(2, 2\)"),
        (torch.full((3, 2), -1.0), "a variance of a mean must not be negative, got -1"),
        (torch.full((3, 2), math.nan), "must be finite"),
    ):
        with pytest.raises(ValueError, match=message):
            risk.field(splat_map, points, posterior=bad)
