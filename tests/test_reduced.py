import dataclasses
import importlib
import math

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose
from scipy import stats

from mannbv import episode, metrics, world
from mannbv.config import Config
from mannbv.lab import study

inside = importlib.import_module("mannbv.lab.study.reduced")  # the room's `reduced` is the function

NAMES = ["centralized", "distributed", "limited", "single"]
TINY = Config(max_cycles=3, fit_steps=4, image_width=24, image_height=16)


def results(dim: int, score, scenes=("a", "b", "c"), seeds=range(4), names=NAMES) -> list:
    """Contents of results.json with a score of two robots, score(scene, strategy, seed) in the mean."""
    parts = []
    for scene in scenes:
        keys = [(name, seed, robot) for name in names for seed in seeds for robot in (0, 1)]
        rows = [
            metrics.Row(name, seed, robot, psnr_db=score(scene, name, seed) + 2 * robot - 1)
            for name, seed, robot in keys
        ]
        parts.append(study.assemble(scene, dim, 2, TINY, rows))
    return parts


def changed(results: study.Results, psnr) -> study.Results:
    """Results with another PSNR in each row, psnr(row)."""
    return dataclasses.replace(results, rows=tuple(dataclasses.replace(row, psnr_db=psnr(row)) for row in results.rows))


def table(rng, shape=(3, 4, 4)) -> tuple[np.ndarray, object]:
    """Random scores (scenes, strategies, seeds), and the function that reads them."""
    values = rng.normal(size=shape)
    return values, lambda scene, name, seed: float(values["abc".index(scene), NAMES.index(name), seed])


def test_a_monotone_foretelling_is_perfect_in_rank_and_order_and_not_in_line(rng):
    values, score = table(rng)
    found = study.reduced(results(2, score), results(3, lambda *key: math.exp(3 * score(*key))), draws=100)
    assert list(found) == ["psnr_db"]
    agreement = found["psnr_db"]
    assert (agreement.n_cells, agreement.n_units) == (48, 12)
    assert [float(part) for part in agreement.spearman] == pytest.approx([1, 1, 1])
    assert agreement.pearson.value == pytest.approx(
        stats.pearsonr(values.ravel(), np.exp(3 * values).ravel()).statistic
    )
    assert agreement.pearson.value < 0.9
    upside_down = study.reduced(results(2, score), results(3, lambda *key: -score(*key)), draws=20)["psnr_db"]
    assert [float(part) for part in upside_down.spearman] == pytest.approx([-1, -1, -1])
    assert [float(part) for part in upside_down.order] == pytest.approx([-1, -1, -1])


def test_scores_agree_with_scipy(rng):
    (flat, in_flat), (space, in_space) = table(rng), table(rng)
    space[:, :2] = np.round(space[:, :2])  # some ties
    space += flat
    agreement = study.reduced(results(2, in_flat), results(3, in_space), draws=50)["psnr_db"]
    assert agreement.spearman.value == pytest.approx(stats.spearmanr(flat.ravel(), space.ravel()).statistic)
    assert agreement.pearson.value == pytest.approx(stats.pearsonr(flat.ravel(), space.ravel()).statistic)
    taus = [stats.kendalltau(flat[k].mean(1), space[k].mean(1)).statistic for k in range(3)]
    assert agreement.order.value == pytest.approx(np.mean(taus))
    flat[:, 1], space[:, 2] = flat[:, 0], space[:, 3]
    tied = study.reduced(results(2, in_flat), results(3, in_space), draws=20)["psnr_db"]
    taus = [stats.kendalltau(flat[k].mean(1), space[k].mean(1)).statistic for k in range(3)]
    assert tied.order.value == pytest.approx(np.mean(taus))


def test_buildings_that_differ_correlate_without_telling_strategies_apart(rng):
    level = {"a": 0.0, "b": 20.0, "c": 40.0}
    noise = {dim: table(rng, (3, 4, 30))[1] for dim in (2, 3)}
    sides = [results(dim, lambda s, *rest, d=dim: level[s] + noise[d](s, *rest), seeds=range(30)) for dim in (2, 3)]
    agreement = study.reduced(*sides, draws=200)["psnr_db"]
    assert agreement.pearson.low > 0.97
    assert agreement.order.low < 0 < agreement.order.high


def test_scores_that_have_nothing_in_common_hold_zero(rng):
    held = []
    for _ in range(20):
        sides = [results(dim, table(rng, (1, 4, 40))[1], "a", range(40)) for dim in (2, 3)]
        agreement = study.reduced(*sides, rng, draws=100)["psnr_db"]
        held.append([part.low < 0 < part.high for part in (agreement.spearman, agreement.pearson)])
    assert (np.mean(held, 0) >= 0.8).all()


def test_the_interval_of_a_correlation_is_that_of_fishers_transform(rng):
    both = rng.multivariate_normal([0, 0], [[1, 0.7], [0.7, 1]], 300)
    scores = [lambda scene, name, seed, k=k: both[seed, k] for k in (0, 1)]
    sides = [results(dim, score, "a", range(300), ["single"]) for dim, score in zip((2, 3), scores, strict=True)]
    agreement = study.reduced(*sides, rng, draws=2000)["psnr_db"]
    middle = math.atanh(np.corrcoef(both.T)[0, 1])
    ends = np.tanh([middle - 1.96 / math.sqrt(297), middle + 1.96 / math.sqrt(297)])
    assert_allclose([agreement.pearson.low, agreement.pearson.high], ends, atol=0.025)
    assert np.isnan(agreement.order.value)  # one strategy has no order


def test_what_is_missing_in_one_is_left_out_of_both(rng):
    _, score = table(rng)
    flat, space = results(2, score), results(3, score)
    gone = [row for row in space[0].rows if row.strategy == "single"]
    gone += [row for row in space[0].rows if (row.strategy, row.seed) == ("limited", 1)]
    space[0] = changed(space[0], lambda row: None if row in gone else row.psnr_db)
    space[1] = changed(space[1], lambda row: -row.psnr_db)
    flat[2] = dataclasses.replace(flat[2], rows=tuple(row for row in flat[2].rows if row.seed < 2))
    flat.append(dataclasses.replace(flat[0], scene="d"))
    agreement = study.reduced(flat, space, draws=20)["psnr_db"]
    assert (agreement.n_cells, agreement.n_units) == (16 - 5 + 16 + 8, 10)
    assert agreement.order.value == pytest.approx((1 - 1 + 1) / 3)
    one = study.reduced(results(2, score, "a", [0])[0], results(3, score, "a", [0])[0], draws=20)["psnr_db"]
    assert one.n_units == 1
    assert one.spearman.value == pytest.approx(1.0)
    assert np.isnan(one.spearman.low)


def test_what_reduced_refuses(rng):
    _, score = table(rng)
    flat, space = results(2, score), results(3, score)
    with pytest.raises(study.StudyError, match="both results are of one dimension"):
        study.reduced(flat, flat)
    with pytest.raises(study.StudyError, match="no building, strategy and seed is in both"):
        study.reduced(flat[0], space[1])
    with pytest.raises(study.StudyError, match="a, centralized, seed 0, is there twice"):
        study.reduced([*flat, flat[0]], space)


# ---- single views ---------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def place():
    return world.load("flat")


@pytest.fixture(scope="module")
def in_space():
    config = TINY.replace(insert_spacing=2, risk_opacity=0.5, block_opacity=0.5, moments="kept")
    return episode.run(world.load("flat", dim=3), "single", config, 1, 2)


def test_a_plane_foretells_itself(place):
    """A flat record stands for the 3-D one: both maps are then the same to the last bit."""
    record = episode.run(place, "single", TINY, 0, 2)
    found = study.same_views(record, place, TINY, every=1, draws=50)
    assert sorted(zip(found.robot, found.cycle, strict=True)) == [(r, c) for r in (0, 1) for c in range(3)]
    assert_allclose(found.correlation, 1.0, rtol=1e-12)
    assert (found.turn == 0).all()
    assert (found.share == 1).all()
    assert (found.chance < 0.8).all()
    assert_allclose(found.mean.value, [1, 0, 1, 1 - found.chance.mean()])
    # with other eyes it is not
    other = study.same_views(record, place, TINY.replace(fov=0.7), every=1, draws=50)
    assert (other.correlation < 0.99).all()


def test_a_robots_map_grows_again_as_it_did(in_space, place):
    for robot in in_space.robots:
        replay = inside._Replay.of(in_space, robot.index, place, TINY)
        for cycle, log in enumerate(in_space.logs(robot.index)):
            replay._observe(cycle)
            assert replay.space.local.splats.n_splats == log.splats
        assert len(replay.frames) in (1, 2)  # of the last move
        rng = np.random.default_rng([1, len(in_space.cycles), robot.index])
        for frame in replay.frames:
            replay.space.observe(frame, rng)
        again, own = replay.space.local.splats, robot.local.splats
        assert all(torch.equal(a, b) for a, b in zip(again.tensors(), own.tensors(), strict=True))


def test_views_in_space_and_in_the_plane(in_space, place):
    found = study.same_views(in_space, place, every=2, draws=50)
    assert sorted(zip(found.robot, found.cycle, strict=True)) == [(r, c) for r in (0, 1) for c in (0, 2)]
    assert (np.abs(found.correlation) <= 1).all()
    assert ((found.turn >= 0) & (found.turn <= math.pi)).all()
    for part in (found.share, found.chance):
        assert ((part >= 0) & (part <= 1)).all()
    assert_allclose(found.mean.value[3], (found.share - found.chance).mean())
    other = dataclasses.replace(in_space, strategy="limited")  # the same robots once more
    twice = study.same_views([in_space, other], place, every=2, draws=50)
    assert twice.robot.tolist() == found.robot.tolist() * 2
    assert_allclose(twice.share, np.tile(found.share, 2))
    more = study.same_views([in_space, dataclasses.replace(in_space, seed=7)], place, every=2, draws=50)
    assert sorted(set(more.robot)) == [0, 1, 2, 3]


def test_comparing_two_profiles():
    yaws = 2 * math.pi * np.arange(360) / 360
    space = 2 + np.cos(yaws)
    correlation, turn, share, chance = inside._compared(space, 5 + 3 * np.cos(yaws - 0.5 * math.pi))
    assert_allclose([correlation, turn, share, chance], [0, math.pi / 2, 2 / 3, 2 / 3], atol=1e-9)
    _, turn, _, _ = inside._compared(np.roll(space, 5), np.roll(space, -5))
    assert turn == pytest.approx(math.radians(10))  # and not 350°
    assert inside._compared(space, space[::-1])[0] == pytest.approx(stats.pearsonr(space, space[::-1]).statistic)


def test_what_same_views_refuses(in_space, place):
    with pytest.raises(study.StudyError, match="the record is of flat, the plan is corridor"):
        study.same_views(in_space, world.load("corridor"))
    with pytest.raises(study.StudyError, match="no view has a gain in both worlds"):
        study.same_views(dataclasses.replace(in_space, cycles=()), place)
